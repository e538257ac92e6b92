// Plays runs: a picture of one moment, what the vehicle sees there, its context code, and numbers.

const STEPS_PER_SECOND = 30; // as fast as the vehicle flies
const FLAGS = { reached: "at the goal", touching: "touching a surface", in_fog: "in fog" };

for (const root of document.querySelectorAll(".player")) {
  const data = JSON.parse(root.querySelector("script").textContent);
  const part = (name) => root.querySelector(`.${name}`);
  const [canvas, slider, button] = ["arena", "slider", "play"].map(part);
  const picture = new Picture(canvas);
  let run;
  let playing = null; // or when the step was that it started from, and which

  choose(part("choices"), data.keys, data.runs, data.first, (chosen) => {
    run = open(chosen, data);
    slider.max = run.steps;
    part("views").replaceChildren(...run.world.channels.map(channelPicture));
    part("without").textContent = run.without && `None: ${run.without}.`;
    go(Number(slider.value));
  });

  function go(step) {
    slider.value = step;
    const [x, y] = run.position(step);
    Object.assign(canvas.dataset, { step, x, y });
    picture.begin(run.world);
    for (const mark of moment(data, run, step)) picture.mark(mark);
    part("views").querySelectorAll("canvas").forEach((channel, index) => drawView(channel, run, step, index));
    showCode(part("bars"), run.code ? run.code(step) : []);
    tell(step, Math.hypot(x - run.goal[0], y - run.goal[1]));
  }

  function tell(step, distance) {
    const states = step ? Object.keys(FLAGS).filter((name) => run[name][step - 1]) : [];
    const told = {
      step: `${step} of ${run.steps}`,
      distance: `${number(distance, 2)} u`,
      error: step ? `${number(run.error(step - 1)[0], 2)} nats` : "–",
      state: states.map((name) => FLAGS[name]).join(", ") || "flying",
    };
    for (const [name, words] of Object.entries(told)) part(name).textContent = words;
    slider.setAttribute("aria-valuetext", `step ${told.step}, ${told.distance} from the goal`);
  }

  function pause() {
    playing = null;
    button.textContent = "Play";
  }

  function play() {
    const step = Number(slider.value) % run.steps; // at the end it begins anew
    playing = { step, time: performance.now() };
    button.textContent = "Pause";
    requestAnimationFrame(advance);
  }

  function advance(now) {
    if (!playing) return;
    const step = playing.step + Math.floor(Math.max(0, now - playing.time) * STEPS_PER_SECOND / 1000);
    if (step !== Number(slider.value)) go(Math.min(step, run.steps));
    if (step >= run.steps) pause();
    else requestAnimationFrame(advance);
  }

  button.addEventListener("click", () => (playing ? pause() : play()));
  slider.addEventListener("input", () => {
    if (playing) playing = { step: Number(slider.value), time: performance.now() };
    go(Number(slider.value));
  });
  root.addEventListener("keydown", (event) => {
    const move = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (event.target.matches("select, button") || event.altKey || event.ctrlKey || event.metaKey) return;
    if (event.key === " ") button.click();
    else if (move && event.target !== slider) { // which moves by itself
      pause();
      go(Math.min(run.steps, Math.max(0, Number(slider.value) + move)));
    } else return;
    event.preventDefault();
  });
  new ResizeObserver(() => go(Number(slider.value))).observe(canvas.parentElement);
}

/** A chosen run with its numbers unpacked: functions of the step, and flags. */
function open(chosen, { worlds }) {
  const rows = (packed) => {
    const values = unpack(packed);
    const width = packed.shape.slice(1).reduce((product, length) => product * length, 1);
    return (step) => values.subarray(step * width, (step + 1) * width);
  };
  const [world, opened] = [worlds[chosen.world], worlds[chosen.opened]];
  const run = { ...chosen, world, opened, steps: chosen.action.shape[0], viewShape: chosen.view.shape };
  for (const name of ["position", "planned", "std", "action", "error"]) run[name] = rows(chosen[name]);
  for (const name of ["touching", "in_fog", "reached", "view"]) run[name] = unpackBits(chosen[name]);
  run.code = chosen.code && rows(chosen.code);
  return run;
}

/** A place for a channel of the view. */
function channelPicture(name) {
  const place = document.createElement("div");
  place.append(document.createElement("canvas"), name.replaceAll("_", " "));
  return place;
}

/** A channel of the view at a step, a pixel a pixel; its rows go upwards. */
function drawView(canvas, { view, viewShape }, step, channel) {
  const [, channels, rows, columns] = viewShape;
  const first = (step * channels + channel) * rows * columns;
  const context = canvas.getContext("2d");
  [canvas.width, canvas.height] = [columns, rows]; // which empties it
  context.fillStyle = "#444";
  for (let place = 0; place < rows * columns; place++) {
    if (view[first + place]) context.fillRect(place % columns, rows - 1 - Math.floor(place / columns), 1, 1);
  }
}
