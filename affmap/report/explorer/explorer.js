// Affordance maps: the code at the node under the pointer.

for (const root of document.querySelectorAll(".explorer")) {
  const data = JSON.parse(root.querySelector("script").textContent);
  const part = (name) => root.querySelector(`.${name}`);
  const canvas = part("arena");
  const picture = new Picture(canvas);
  const painted = new Image();
  let map, codes;
  let node = null; // column and row

  choose(part("choices"), data.keys, data.maps, data.first, (chosen) => {
    map = chosen;
    codes = unpack(chosen.codes);
    const [rows, columns] = chosen.codes.shape;
    node ??= [columns >> 1, rows >> 1];
    painted.src = chosen.picture;
    point(node);
  });
  painted.addEventListener("load", draw);

  /** Show a node, or where there is none the nearest one. */
  function point([column, row]) {
    const [rows, columns, size] = map.codes.shape;
    node = [Math.min(columns - 1, Math.max(0, column)), Math.min(rows - 1, Math.max(0, row))];
    const [x, y] = position(node);
    const first = (node[1] * columns + node[0]) * size;
    Object.assign(canvas.dataset, { column: node[0], row: node[1] });
    part("place").textContent = `at x ${number(x, 2)} u, y ${number(y, 2)} u`;
    showCode(part("bars"), codes.subarray(first, first + size));
    draw();
  }

  function position(place) {
    return place.map((index, axis) => map.origin[axis] + index * map.spacing[axis]);
  }

  function draw() {
    const { world, edges: [[left, low], [right, high]] } = map;
    picture.begin(world);
    const { context } = picture;
    context.imageSmoothingEnabled = false;
    context.save();
    context.scale(1, -1); // pictures go downwards
    if (painted.complete) context.drawImage(painted, left, -high, right - left, high - low);
    context.restore();
    const ring = (color, width, points, radii) => picture.mark({ layer: { color, width, opacity: 1 }, points, radii });
    for (const { points, radii } of world.circles) if (radii) ring("black", 0.8, points, radii);
    ring("white", 3.3, [position(node)], [0.03, 0.03]);
    ring("black", 1.5, [position(node)], [0.03, 0.03]);
  }

  function follow(event) {
    point(picture.at(event).map((along, axis) => Math.round((along - map.origin[axis]) / map.spacing[axis])));
  }
  canvas.addEventListener("pointermove", follow);
  canvas.addEventListener("pointerdown", follow);
  canvas.addEventListener("keydown", (event) => {
    const move = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowDown: [0, -1], ArrowUp: [0, 1] }[event.key];
    if (!move || event.altKey || event.ctrlKey || event.metaKey) return;
    point([node[0] + move[0], node[1] + move[1]]);
    event.preventDefault();
  });
  new ResizeObserver(draw).observe(canvas.parentElement);
}
