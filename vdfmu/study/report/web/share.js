// What is passed on: a link to what is shown, the command that makes it, a picture and a film of the arm.

import { copied, make, recorded, reducedMotion, simulated, view } from "./data.js";
import { address } from "./state.js";
import { handOver } from "./save.js";

const LONGEST_FILM = 10; // s
const FILM_TITLE = "Save a film of the whole run";
const FILM_TYPES = ["video/mp4;codecs=avc1.42E01E", "video/webm;codecs=vp9", "video/webm"];

/** The command of the run that is shown, with what a chosen point and the sliders have changed, in this order. */
export function commandOf(run, changes) {
  const parametersOf = (unit) => run.simulation.units.find(({ name }) => name === unit).parameters;
  const found = new Map();
  for (const { unit, name: asked, value, factor = 1 } of changes) {
    for (const [name, [, own]] of Object.entries(parametersOf(unit)).filter(
      ([one]) => one === asked || one.startsWith(`${asked}[`),
    )) {
      const key = `${unit}.${name}`;
      found.set(key, { unit, name, value: (value ?? found.get(key)?.value ?? own) * factor });
    }
  }
  const groups = Map.groupBy(found.values(), ({ unit, name }) => `${unit}.${name.split("[")[0]}`);
  const words = [...groups].flatMap(([group, own]) => {
    const values = own.map(({ value }) => String(Number(value.toPrecision(12))));
    const whole =
      Object.keys(parametersOf(own[0].unit)).filter(
        (name) => `${own[0].unit}.${name.split("[")[0]}` === group,
      ).length === own.length;
    if (whole && new Set(values).size === 1 && !run.command.includes(`${group}[`))
      return [`--set ${group}=${values[0]}`];
    return own.map(({ unit, name }, k) => `--set '${unit}.${name}=${values[k]}'`);
  });
  return [run.command, ...words].join(" ");
}

/** Buttons beside the title. */
export function shareButtons(simulation) {
  const said = make("small", { class: "note", role: "status" });
  const copy = (label, text) =>
    make(
      "button",
      {
        type: "button",
        click: async () => {
          said.textContent = (await copied(text())) ? "Copied." : text();
        },
      },
      label,
    );
  const run = () => simulated.of ?? recorded[0];
  const command = recorded.some((one) => one.command)
    ? [copy("Copy as command", () => commandOf(run(), simulation?.changes() ?? []))]
    : [];
  return make("div", { class: "actions" }, said, copy("Copy link", address), ...command);
}

/** Buttons that save the arm as it is drawn, and as a film of the whole run. */
export function pictureButtons(player) {
  const film = make(
    "button",
    { type: "button", title: FILM_TITLE, click: () => filmed(player, film) },
    "Film",
  );
  const able = globalThis.MediaRecorder && HTMLCanvasElement.prototype.captureStream;
  return [
    make(
      "button",
      { type: "button", title: "Save the arm as it is shown", click: () => savePoster(player) },
      "Picture",
    ),
    ...(able ? [film] : []),
  ];
}

/** A canvas that the arm is drawn into, on the colour of the page. */
function copyOf({ scene }) {
  const { domElement: source } = scene.renderer,
    canvas = make("canvas", { width: source.width, height: source.height }),
    pen = canvas.getContext("2d");
  const draw = () => {
    scene.render(); // of a frame before, nothing is kept
    pen.fillStyle = getComputedStyle(document.documentElement).getPropertyValue("--card");
    pen.fillRect(0, 0, canvas.width, canvas.height);
    pen.drawImage(source, 0, 0);
  };
  draw();
  return { canvas, draw };
}

function savePoster(player) {
  copyOf(player).canvas.toBlob((picture) => handOver(picture, `${player.scene.run.name}.png`));
}

/** Play the run once, in at most `LONGEST_FILM`, and record it. */
function filmed(player, button) {
  const { canvas, draw } = copyOf(player),
    type = FILM_TYPES.find((one) => MediaRecorder.isTypeSupported(one)),
    { time } = player.motion;
  const recorder = new MediaRecorder(canvas.captureStream(30), {
      mimeType: type,
      videoBitsPerSecond: 4e6,
    }),
    parts = [],
    before = view.time;
  const seconds = Math.min(LONGEST_FILM, time.at(-1) - time[0]),
    begun = performance.now();
  recorder.addEventListener("dataavailable", ({ data }) => parts.push(data));
  recorder.addEventListener("stop", () => {
    const film = new Blob(parts, { type });
    if (film.size) handOver(film, `${player.scene.run.name}.${type.slice(6, 10).replace(";", "")}`);
    button.title = film.size ? FILM_TITLE : "The browser recorded nothing: try again";
    button.disabled = false;
    view.change("time", before);
  });
  button.disabled = true;
  button.title = FILM_TITLE;
  player.play(false);
  recorder.start();
  const step = () => {
    const share = Math.min(1, (performance.now() - begun) / 1e3 / (seconds || 1));
    view.change("time", time[0] + share * (time.at(-1) - time[0]));
    draw();
    if (share < 1) requestAnimationFrame(step);
    else recorder.stop();
  };
  step();
}

/** Go to the time and the figure of a tile. */
export function follow(tile, charts) {
  const { figure, time } = tile.dataset;
  if (time !== undefined) view.change("time", Number(time));
  const target =
    document.getElementById(figure) ??
    charts.find(({ element }) => element.dataset.figure?.startsWith(figure))?.element;
  if (!target) return;
  target.scrollIntoView({
    block: target.tagName === "FIGURE" ? "center" : "start",
    behavior: reducedMotion.matches ? "auto" : "smooth",
  });
  for (const one of document.querySelectorAll(".found-now")) one.classList.remove("found-now");
  target.classList.add("found-now");
}
