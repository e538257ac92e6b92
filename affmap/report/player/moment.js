// The picture of one moment of a run, in the colours of the report's figures.

function drawMoment(picture, { colors, throttles, jet, deviations, extent }, run, step) {
  const [x, y] = run.position(step);
  picture.begin(run.world);
  picture.circles(run.world);
  const half = extent / 2;
  const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]];
  picture.line(corners.map(([right, up]) => [x + half * right, y + half * up]), colors.frame, 1);
  picture.line(Array.from({ length: step + 1 }, (_, past) => run.position(past)), colors.path, 1.6);
  const [startX, startY] = run.position(0);
  picture.disc(startX, startY, 0.02, colors.path);
  if (step < run.steps) { // nothing is decided at the end
    const lost = step > 0 && run.in_fog[step - 1]; // then the plan starts where the vehicle is told to be
    drawPlan(picture, lost ? [] : [[x, y]], pairs(run.planned(step)), pairs(run.std(step)), deviations, colors.plan);
    run.action(step).forEach((opening, index) => {
      // The jet leaves on the side opposite to where it pushes.
      const ends = [run.world.radius, run.world.radius + jet * opening];
      const line = ends.map((away) => [x - away * throttles[index][0], y - away * throttles[index][1]]);
      if (opening > 0) picture.line(line, colors.jet, 4);
    });
  }
  picture.disc(x, y, run.world.radius, colors.vehicle);
  const [goalX, goalY] = run.goal;
  for (const side of [1, -1]) {
    picture.line([-0.035, 0.035].map((end) => [goalX + end, goalY + side * end]), colors.goal, 2.5);
  }
}

function drawPlan(picture, from, means, stds, deviations, color) {
  means.forEach(([x, y], index) => {
    picture.ring(x, y, deviations * stds[index][0], deviations * stds[index][1], color, 0.8, 0.45);
    picture.disc(x, y, 0.009, color);
  });
  picture.line([...from, ...means], color, 1.6);
}

function pairs(values) {
  return Array.from({ length: values.length / 2 }, (_, index) => [values[2 * index], values[2 * index + 1]]);
}
