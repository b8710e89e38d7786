// What a simulated run came to: its verdict at the top, its checks, and the numbers of the tiles beside the recorded ones.

import { make, recorded, rowsOf } from "./data.js";
import { quantity, text } from "./numbers.js";
import { UNJUDGED, lower, upper } from "./verdict.js";

/** Least change that is better or worse. */
const CLEAR = 0.05;

/** The first figure whose key begins with a text, with its rows. */
function figureOf(run, key) {
  const figure = [...run.figures, ...run.signals].find((one) => one.key.startsWith(key));
  return figure ? { ...figure, ...rowsOf(figure, run.result) } : null;
}

/** The row with the largest size of its value, and its joint. */
function most({ curves, time, values, unit }, size = (value, _) => Math.abs(value)) {
  let best = { value: -Infinity, unit, joint: 0, at_s: 0 };
  curves.forEach(([, joint, dashed], k) => {
    for (let i = 0; !dashed && i < time.length; i += 1)
      if (size(values[k][i], i) > best.value)
        best = { value: size(values[k][i], i), joint, at_s: time[i], unit };
  });
  return best;
}

/** Measure of a tile to its value in a figure; of the run's simulation is how late estimates are. */
const MEASURES = {
  largest: (figure) => most(figure),
  highest: (figure) => most(figure, (value) => value),
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
};

/**
 * The figure of a tile in a simulated run: of its verdict, or measured.
 * @param {any} tile
 */
function measured(run, figures, tile) {
  const { measure, figure } = tile;
  if (measure.startsWith("key ")) return figures[measure.slice(4)];
  const [name, signal] = measure.split(" "),
    shown = figureOf(run, signal ?? figure);
  return shown?.time.length && name in MEASURES ? MEASURES[name](shown, run.simulation) : null;
}

/** What an element was for the recorded run. */
const keep = (element, facts) => (element.recorded ??= facts());

/** Tell the verdict on a simulated run where the recorded one's was; null tells that again. */
export function tell(of, verdict) {
  const number = recorded.indexOf(of);
  /** @type {HTMLElement} */
  const line = document.querySelector(`.verdict[data-run="${number}"]`);
  if (!line) return;
  const was = keep(line, () => ({ content: [...line.childNodes], state: line.className }));
  line.className = verdict ? `verdict ${verdict.state}` : was.state;
  if (verdict)
    line.replaceChildren(
      `Simulated, ${lower(verdict.headline)} `,
      make("small", {}, verdict.results),
    );
  else line.replaceChildren(...was.content);
  const count = document.querySelector(`.checks[data-run="${number}"] summary`);
  if (!count) return;
  const words = keep(count, () => count.textContent);
  count.textContent = verdict ? `Recorded: ${words}` : words;
  count.parentElement.classList.toggle("other", !!verdict);
}

/** The checks of a verdict as a list. */
export const listed = ({ checks }) =>
  checks.map(({ state, sentence, more, limit, by }) =>
    make(
      "li",
      { class: state === UNJUDGED ? "not-judged" : state },
      make("b", {}, state),
      ` ${[upper(sentence), more].filter(Boolean).join("; ")} `,
      ...(by ? [make("small", {}, `limit ${text(limit, 3)}: ${by}`)] : []),
    ),
  );

/** Show recorded and simulated values in the tiles, better ones of a `whole` run only; null shows the recorded run. */
export function showTiles(of, run, figures, whole) {
  if (recorded.length > 1) return;
  for (const tile of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll(".tile"))) {
    const [value, note] = tile.querySelectorAll("b, small"),
      was = keep(tile, () => ({ value: value.textContent, note: note.textContent }));
    tile.classList.remove("worse", "better");
    note.textContent = was.note;
    value.textContent = was.value;
    if (!run) continue;
    const { measure } = tile.dataset,
      number = measure.startsWith("key ")
        ? Number(tile.dataset.value)
        : measured(of, {}, tile.dataset)?.value,
      now = measured(run, figures, tile.dataset) ?? {},
      { value: after = NaN, unit, joint, place, at_s: time } = now;
    const words = measure === "key margin" ? marginText(figures) : tileText(measure, after, unit);
    value.replaceChildren(make("i", {}, `${was.value} →`), ` ${words}`);
    note.textContent = [
      joint ? `joint ${joint}` : place,
      time !== undefined && `at ${text(time, 3)} s`,
    ]
      .filter(Boolean)
      .join(" ");
    const ratio = measure === "key margin" ? number / after : after / number;
    if (ratio > 1 + CLEAR) tile.classList.add("worse");
    if (ratio < 1 - CLEAR && whole) tile.classList.add("better");
  }
}

const marginText = ({ margin, unstable }) =>
  margin?.value ? text(margin.value, 2) : margin || unstable ? "none" : "not\u00a0judged";

function tileText(measure, value, unit) {
  const words =
    measure === "key saturated"
      ? `${text(100 * (value || 0), 3)} %`
      : quantity(value, measure === "key tool_error" ? "m" : unit);
  return words.replace(" ", "\u00a0");
}
