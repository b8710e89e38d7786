// What a simulated run came to: the sentence at the top, and the numbers of the tiles beside the recorded ones.

import { largest, make, recorded, rowsOf } from "./data.js";
import { toolErrors } from "./arm.js";
import { quantity, text } from "./numbers.js";

/** Unit, curves, times and values of the first figure whose key begins with a text. */
function figureOf(run, key) {
  if (key === "tool") {
    if (!run.arm || !run.frames.error) return null;
    const { time, values } = toolErrors(run);
    return { unit: "mm", curves: [["", 0, 0]], time, values: [values] };
  }
  const figure = [...run.figures, ...run.signals].find((one) => one.key.startsWith(key));
  return figure ? { ...figure, ...rowsOf(figure, run.result) } : null;
}

/** The row with the largest size of its value, and its joint. */
function most({ curves, time, values, unit }, size = (value, _) => Math.abs(value)) {
  let best = { value: -Infinity, unit, joint: 0, time: 0 };
  curves.forEach(([, joint, dashed], k) => {
    for (let i = 0; !dashed && i < time.length; i += 1)
      if (size(values[k][i], i) > best.value)
        best = { value: size(values[k][i], i), joint, time: time[i], unit };
  });
  return best;
}

/** Measure of a tile to its value in a figure; of the run's simulation are the limits, and how late estimates are. */
const MEASURES = {
  largest: (figure) => most(figure),
  highest: (figure) => most(figure, (value) => value),
  length: (figure) => most(figure, (_, i) => Math.hypot(...figure.values.map((row) => row[i]))),
  apart({ curves, values, unit }, { late }) {
    const own = curves.flatMap(([, joint, dashed], k) => (dashed ? [] : [[joint, k]]));
    const errors = own.map(([joint, k]) => {
      const true_ = values[curves.findIndex(([, one, dashed]) => dashed && one === joint)];
      const squares = values[k].map((value, i) =>
        i ? (value - late * true_[i - 1] - (1 - late) * true_[i]) ** 2 : 0,
      );
      return { joint, unit, value: Math.sqrt(squares.reduce((a, b) => a + b, 0) / squares.length) };
    });
    return errors.reduce((worst, one) => (one.value > worst.value ? one : worst));
  },
  limited({ curves, values, time }, { limits }) {
    const shares = curves.flatMap(([, joint, dashed], k) => {
      if (dashed || !(limits[joint - 1] < Infinity)) return [];
      const at = values[k].filter((value) => Math.abs(value) >= (1 - 1e-9) * limits[joint - 1]);
      return [{ joint, unit: "%", value: (100 * at.length) / time.length }];
    });
    return shares.reduce((worst, one) => (one.value > worst.value ? one : worst), shares[0]);
  },
};

/**
 * The measure of a tile in a run.
 * @param {any} tile
 */
function measured(run, tile) {
  const { measure, figure } = tile;
  const [name, signal] = measure.split(" "),
    shown = figureOf(run, signal ?? figure);
  return shown?.time.length && name in MEASURES ? MEASURES[name](shown, run.simulation) : null;
}

/** State and words of a run: when it became unstable, how it stopped, or by its errors and margin, as Python tells them. */
export function outcomeOf(run, { failure, departure, unstable, margin }) {
  const { path, limits, saturated } = run.simulation,
    { time } = run.result,
    words = [];
  let state = "good";
  if (unstable && departure) {
    state = "failed";
    words.push(`unstable from ${text(departure.time, 3)} s, joint ${departure.joint}`);
  } else if (unstable) {
    state = "doubtful";
    words.push(`its linearised loops are unstable${failure ? "" : ", though errors stay small"}`);
  }
  if (failure) {
    state = "failed";
    words.push(time.length ? `stopped at ${text(time.at(-1), 3)} s` : failure);
  }
  if (state === "failed") return { state, words };
  const limited = limits.length ? measured(run, { measure: "limited", figure: "torque" }) : null;
  if (limited?.value >= 100 * saturated) {
    state = "doubtful";
    words.push(`saturated, joint ${limited.joint} for ${text(limited.value, 3)} % of the time`);
  }
  const off = path && errorAt(run, path);
  if (off >= path?.doubtful * path?.size) {
    if (off >= path.failed * path.size) state = "failed";
    else state = "doubtful";
    const [error, size] = [off, path.size].map((value) => quantity(value, path.unit));
    words.push(`off its path, ${path.place} off by ${error}, in a motion of ${size}`);
    return { state, words };
  }
  if (state === "good") words.push(margin ? "stable" : "ran to its end");
  for (const [figure, name] of [
    ["tool", "tool error"],
    ["tracking", "worst joint"],
  ]) {
    const one = measured(run, { measure: "largest", figure });
    if (one) words.push(`${name} ${quantity(one.value, one.unit)}`);
  }
  if (margin) words.push(`modulus margin ${text(margin, 2)}`);
  return { state, words };
}

/** Largest error of the tool or the joint of a path, in its unit. */
function errorAt(run, { place }) {
  if (place === "tool") return measured(run, { measure: "largest", figure: "tool" })?.value / 1e3;
  const joint = Number(place.replace("joint ", ""));
  const rows = run.figures
    .filter(({ key }) => key.startsWith("tracking."))
    .flatMap((figure) =>
      rowsOf(figure, run.result).values.filter((_, k) => figure.curves[k][1] === joint),
    );
  return Math.max(...rows.map(largest));
}

const kept = new WeakMap(); // element to what it was for the recorded run

function keep(element, facts) {
  if (!kept.has(element)) kept.set(element, facts());
  return kept.get(element);
}

/** Tell the outcome of a simulated run where the recorded one's verdict was; null tells that again. */
export function tell(of, outcome) {
  /** @type {HTMLElement} */
  const line = document.querySelector(`.verdict[data-run="${recorded.indexOf(of)}"]`);
  if (!line) return;
  const was = keep(line, () => ({ words: line.textContent, state: line.className }));
  line.className = outcome ? `verdict ${outcome.state}` : was.state;
  line.textContent = outcome ? `Simulated: ${outcome.words.join("; ")}` : was.words;
  line.title = outcome ? `Recorded: ${was.words}` : "";
}

/** Show in each tile the recorded value, an arrow and the value of a simulated run; null shows the recorded run alone. */
export function showTiles(of, run, margin) {
  if (recorded.length > 1) return;
  for (const tile of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll(".tile"))) {
    const [value, note] = tile.querySelectorAll("b, small"),
      { measure } = tile.dataset;
    const was = keep(tile, () => ({
      value: value.textContent,
      note: note.textContent,
      number: measure === "margin" ? of.simulation.margin : measured(of, tile.dataset)?.value,
    }));
    tile.classList.remove("worse", "better");
    note.textContent = was.note;
    value.textContent = was.value;
    if (!run) continue;
    const now =
      measure === "margin" ? { value: margin ?? NaN, unit: "" } : measured(run, tile.dataset);
    const { value: after, unit, joint, time } = now ?? { value: NaN };
    const words =
      measure === "margin" ? (margin === 0 ? "none" : text(after, 2)) : quantity(after, unit);
    value.replaceChildren(make("i", {}, `${was.value} →`), ` ${words.replaceAll(" ", "\u00a0")}`);
    note.textContent = [joint && `joint ${joint}`, time !== undefined && `at ${text(time, 3)} s`]
      .filter(Boolean)
      .join(" ");
    const ratio = measure === "margin" ? was.number / after : after / was.number;
    if (Math.abs(ratio - 1) > 0.01) tile.classList.add(ratio > 1 ? "worse" : "better");
  }
}
