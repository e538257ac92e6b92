// One moment of a run as marks, the lowest first: for a flight that is played, the same as `Scene.marks` in scene.py.

function moment({ layers, throttles }, run, step) {
  const size = (name) => layers[name].size;
  const square = [[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]];
  const line = (...points) => ({ points });
  const at = ([x, y], scale, corners) => line(...corners.map(([right, up]) => [x + scale * right, y + scale * up]));
  const ellipse = (center, radii) => ({ points: [center], radii });
  const disc = (center, radius) => ellipse(center, [radius, radius]);
  const here = run.position(step);
  const { radius } = run.world;
  const made = (values) => (step < run.steps ? [...values(step)] : []); // nothing is decided at the end
  const [path, std] = [run.planned, run.std].map((values) => pairs(made(values)));
  const lost = step > 0 && run.in_fog[step - 1]; // then the plan starts where the vehicle is told to be
  const jet = (opening, index) => { // which leaves on the side opposite to where it pushes
    const ends = [radius, radius + size("throttles") * opening];
    return opening > 0 ? [at(here, -1, ends.map((end) => throttles[index].map((part) => end * part)))] : [];
  };
  const shapes = {
    view: [at(here, size("view"), square)],
    uncertainty: path.map((point, index) => ellipse(point, std[index].map((each) => size("uncertainty") * each))),
    past: step ? [line(...Array.from({ length: step + 1 }, (_, past) => run.position(past)))] : [],
    start: [at(run.position(0), size("start"), square)],
    plan: path.length ? [line(...(lost ? [] : [here]), ...path)] : [],
    steps: path.map((point) => disc(point, size("steps"))),
    throttles: made(run.action).flatMap(jet),
    vehicle: [disc(here, radius)],
    goal: [1, -1].map((side) => at(run.goal, size("goal"), [[-1, -side], [1, side]])),
  };
  const marks = Object.entries(layers).map(([name, layer]) => (shapes[name] ?? []).map((each) => ({ layer, ...each })));
  const { circles } = step < run.opens ? run.world : run.opened;
  return [...circles, ...marks.flat()];
}

/** Rows of two numbers, without those that are missing. */
function pairs(values) {
  const rows = Array.from({ length: values.length / 2 }, (_, index) => [values[2 * index], values[2 * index + 1]]);
  return rows.filter((row) => row.every(Number.isFinite));
}
