// What player and explorer share: numbers, select boxes, bars, and pictures of the arena (lengths in u, y upwards).

/** Numbers as packing.py packs them; NaN where there is none. */
function unpack({ data, step }) {
  const view = new DataView(bytes(data).buffer);
  return Float64Array.from({ length: view.byteLength / 2 }, (_, place) => {
    const whole = view.getInt16(2 * place, true);
    return whole === -32768 ? NaN : whole * step;
  });
}

/** Truth values as packing.py packs them. */
function unpackBits({ data, shape }) {
  const packed = bytes(data);
  const count = shape.reduce((product, length) => product * length, 1);
  return Uint8Array.from({ length: count }, (_, place) => (packed[place >> 3] >> (7 - (place & 7))) & 1);
}

function bytes(text) {
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}

function number(value, digits) {
  return Number.isFinite(value) ? value.toFixed(digits).replace("-", "−") : "–";
}

/** Select boxes, one for each key that differs; a later one offers what the earlier ones leave. Calls `show(item)`. */
function choose(place, keys, items, first, show) {
  const boxes = keys.map((key, index) => {
    const label = document.createElement("label");
    const box = document.createElement("select");
    label.append(`${key} `, box);
    label.hidden = items.every((item) => item.choice[index] === items[0].choice[index]);
    box.addEventListener("change", () => change(index));
    place.append(label);
    return box;
  });
  const agrees = (item, index) => item.choice[index] === boxes[index].value;

  function change(index) {
    const possible = items.filter((item) => boxes.every((_, place) => place > index || agrees(item, place)));
    const likeness = (item) => boxes.filter((_, place) => agrees(item, place)).length;
    set(possible.reduce((best, item) => (likeness(item) > likeness(best) ? item : best)));
  }

  function set(chosen) {
    let left = items;
    boxes.forEach((box, index) => {
      const values = [...new Set(left.map((item) => item.choice[index]))];
      box.replaceChildren(...values.map((value) => new Option(value)));
      box.value = chosen.choice[index];
      left = left.filter((item) => agrees(item, index));
    });
    show(chosen);
  }

  set(items[first]);
}

/** A context code as bars from −1 to 1, with numbers. */
function showCode(place, code) {
  if (place.childElementCount !== code.length) {
    place.replaceChildren(...Array.from(code, (_, index) => {
      const row = document.createElement("div");
      row.className = "bar";
      row.innerHTML = "<span></span><span class=\"track\"><span class=\"fill\"></span></span><output></output>";
      row.firstChild.textContent = index + 1;
      return row;
    }));
  }
  code.forEach((value, index) => {
    const row = place.children[index];
    const fill = row.querySelector(".fill");
    fill.style.left = `${50 + 50 * Math.min(0, value || 0)}%`;
    fill.style.width = `${50 * Math.abs(value || 0)}%`;
    row.lastChild.textContent = number(value, 2);
  });
}

const WIDE = 200; // pens are in pixels where a unit has so many; they are at least a pixel

/** A canvas that shows a world of some size. */
class Picture {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
  }

  /** An empty picture of a world, as wide as the page gives. */
  begin(world) {
    const width = Math.round(this.canvas.clientWidth * devicePixelRatio);
    this.scale = width / world.size[0];
    this.height = world.size[1];
    this.canvas.width = width;
    this.canvas.height = Math.round(this.scale * this.height);
    this.context.setTransform(this.scale, 0, 0, -this.scale, 0, this.canvas.height);
    this.context.lineJoin = this.context.lineCap = "round";
  }

  /** The position under the pointer. */
  at(event) {
    const { left, top, width, height } = this.canvas.getBoundingClientRect();
    const size = [this.canvas.width / this.scale, this.height];
    return [((event.clientX - left) / width) * size[0], (1 - (event.clientY - top) / height) * size[1]];
  }

  /** A shape, see scene.py: an ellipse where it has radii, else a line or, without a pen, the area inside. */
  mark({ layer: { color, width, opacity }, points, radii }) {
    const { context } = this;
    context.beginPath();
    if (radii) context.ellipse(...points[0], ...radii, 0, 0, 2 * Math.PI);
    else for (const [x, y] of points) context.lineTo(x, y);
    context.globalAlpha = opacity;
    context.fillStyle = context.strokeStyle = color;
    context.lineWidth = Math.max(width / WIDE, devicePixelRatio / this.scale);
    if (width) context.stroke();
    else context.fill();
    context.globalAlpha = 1;
  }
}
