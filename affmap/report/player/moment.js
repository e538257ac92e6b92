// One moment of a run as marks, the lowest first: for a flight that is played, the same as `Scene.marks` in scene.py.

function moment({ layers, throttles }, run, step) {
  const { start, goal, view, steps, uncertainty, throttles: jets } = layers;
  const at = ([x, y], size, corners) => corners.map(([right, up]) => [x + size * right, y + size * up]);
  const square = [[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]];
  const here = run.position(step);
  const plans = step < run.steps; // nothing is decided at the end
  const path = plans ? pairs(run.planned(step)) : [];
  const std = plans ? pairs(run.std(step)) : [];
  const lost = step > 0 && run.in_fog[step - 1]; // then the plan starts where the vehicle is told to be
  const line = (points) => ({ points });
  const ellipse = (center, radii) => ({ points: [center], radii });
  const jet = (opening, index) =>
    line([0, jets.size * opening].map((length) => at(here, -run.world.radius - length, [throttles[index]])[0]));
  const shapes = {
    view: [line(at(here, view.size, square))],
    uncertainty: path.map((point, index) => ellipse(point, std[index].map((each) => uncertainty.size * each))),
    past: step ? [line(Array.from({ length: step + 1 }, (_, past) => run.position(past)))] : [],
    start: [line(at(run.position(0), start.size, square))],
    plan: path.length ? [line(lost ? path : [here, ...path])] : [],
    steps: path.map((point) => ellipse(point, [steps.size, steps.size])),
    throttles: plans ? Array.from(run.action(step), jet).filter((_, index) => run.action(step)[index] > 0) : [],
    vehicle: [ellipse(here, [run.world.radius, run.world.radius])],
    goal: [1, -1].map((side) => line(at(run.goal, goal.size, [[-1, -side], [1, side]]))),
  };
  const marks = Object.entries(layers).map(([name, layer]) => (shapes[name] ?? []).map((each) => ({ layer, ...each })));
  return [...run.world.circles, ...marks.flat()];
}

/** Rows of two numbers, without those that are missing. */
function pairs(values) {
  const rows = Array.from({ length: values.length / 2 }, (_, index) => [values[2 * index], values[2 * index + 1]]);
  return rows.filter((row) => row.every(Number.isFinite));
}
