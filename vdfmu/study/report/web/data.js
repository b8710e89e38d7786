// The numbers of the page, its elements, and functions that its parts share.

import { unzip } from "./packed.js";

const content = JSON.parse(document.getElementById("data").textContent);
export const runs = content.runs;
/** The study, in the page of a sweep. */
export const study = content.study;
/** The robot, in the page of one. */
export const robot = content.robot;
/** Digest to module, of the systems that can be simulated. */
export const binaries = content.binaries;

/** The result of no simulation. */
export const NOTHING = { time: new Float64Array(), signals: new Map() };

/** The run that the page simulates: it shows what the recorded run that it is `of` shows, from its `result`. @type {any} */
export const simulated = new Proxy(
  { name: "simulated", of: runs.find((run) => run.simulation?.units), result: NOTHING },
  { get: (own, key) => (key in own ? own[key] : own.of?.[key]) },
);
if (simulated.of) runs.push(simulated);

/** The runs whose numbers are in the file. */
export const recorded = runs.filter((run) => run !== simulated);

const FRAMES = 1000;

export const reducedMotion = matchMedia("(prefers-reduced-motion: reduce)");
export const darkScheme = matchMedia("(prefers-color-scheme: dark)");

/** A colour of the page by the name of its variable. */
export const inkOf = (name) =>
  getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

export const COLOURS = Number(inkOf("joints")); // of vdfmu/base/page.py

/** Colour of a joint, from 1; ink for 0, for everything that is not a joint. */
export const colourOf = (number) => inkOf(number ? `joint-${((number - 1) % COLOURS) + 1}` : "ink");

const packed = document.getElementById("numbers");
const numbers = packed ? new Uint8Array(await unzip(packed.textContent).arrayBuffer()) : null;

/**
 * An array of the page: its place among the numbers, and its length. They were packed as changes of their bits.
 * @param {number[]} place
 * @param {any} Kind
 */
export function unpack(place, Kind = Float32Array) {
  const [first, count] = place,
    size = Kind.BYTES_PER_ELEMENT,
    bytes = new Uint8Array(size * count);
  for (let byte = 0; byte < size; byte += 1)
    for (let i = 0; i < count; i += 1) bytes[size * i + byte] = numbers[first + count * byte + i];
  /** @type {any} */
  const bits = size === 8 ? new BigUint64Array(bytes.buffer) : new Uint32Array(bytes.buffer);
  for (let i = 1; i < count; i += 1) bits[i] += bits[i - 1];
  return new Kind(bytes.buffer);
}

/** A row at or before a time, and the share of the way to the next. */
export function placeAt(time, t) {
  let low = 0,
    high = time.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (time[middle] <= t) low = middle;
    else high = middle;
  }
  const share = (t - time[low]) / (time[high] - time[low]);
  return [low, Math.min(1, Math.max(0, share || 0))];
}

/** Largest absolute value. */
export const largest = (values) =>
  values.reduce((most, value) => Math.max(most, Math.abs(value) || 0), 0);

/** Split numbers that stand curve by curve. */
export const split = (array, count) =>
  Array.from({ length: count }, (_, k) =>
    array.subarray((k * array.length) / count, ((k + 1) * array.length) / count),
  );

/** Entries of all runs under `kind`, "figures" or "signals": key to title, unit and the part of each run. */
export function merged(kind) {
  const found = new Map();
  runs.forEach((run, place) => {
    for (const figure of run[kind]) {
      if (!found.has(figure.key))
        found.set(figure.key, { title: figure.title, unit: figure.unit, parts: [] });
      found.get(figure.key).parts.push({ run: place, figure });
    }
  });
  return found;
}

/** Curves of a figure of all runs. */
export function curvesOf(kind, key) {
  return merged(kind)
    .get(key)
    .parts.flatMap(({ run, figure }) => {
      const { time, values } = rowsOf(figure, runs[run].result);
      return figure.curves.map(([label, joint, dashed], k) => ({
        label,
        joint,
        colour: joint || k + 1,
        dashed: !!dashed,
        run,
        time,
        values: values[k],
      }));
    });
}

/** Times and values of the curves of a figure: as recorded, or of the result of a simulation. */
export function rowsOf(figure, result) {
  if (!result)
    return {
      time: unpack(figure.time, Float64Array),
      values: split(unpack(figure.values), figure.curves.length),
    };
  const { time, signals } = result;
  return { time, values: figure.recipes.map((recipe) => summed(recipe, signals, time.length)) };
}

/** Times of the frames of a run, and by name the values of each joint; of a simulated run those at the recorded times. */
export function framesOf(run) {
  const { time: times, recipes, ...packed } = run.frames,
    found = {},
    taken = unpack(times, Float64Array);
  if (!run.result) {
    for (const [name, values] of Object.entries(packed))
      found[name] = split(unpack(values), recipes[name].length);
    return { time: taken, ...found };
  }
  const { time, signals } = run.result,
    last = time.length - 1,
    rows = [];
  if (last <= FRAMES) rows.push(...time.keys());
  else if (taken.at(-1) < time[last] - 1e-9)
    rows.push(...Array.from({ length: FRAMES + 1 }, (_, k) => Math.round((k * last) / FRAMES)));
  else
    for (let k = 0, row = 0; row < last; k += 1) {
      while (row < last && !(time[row] >= taken[k] - 1e-9)) row += 1;
      if (row !== rows.at(-1)) rows.push(row);
    }
  const thinned = (values) => Float64Array.from(rows, (row) => values[row]);
  for (const [name, sums] of Object.entries(recipes))
    found[name] = sums.map((recipe) => thinned(summed(recipe, signals, time.length)));
  return { time: thinned(time), ...found };
}

/** A recipe is a scale, and the terms whose sum it scales: a factor, and a signal, or 1 for no name. */
function summed([scale, terms], signals, rows) {
  const sum = new Float64Array(rows);
  for (const [factor, name] of terms) {
    const values = signals.get(name) ?? [];
    for (let k = 0; k < rows; k += 1) sum[k] += factor * (name ? (values[k] ?? NaN) : 1);
  }
  return sum.map((value) => scale * value);
}

/** Make an element: attributes, of which functions listen to events, and children. */
export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name, value);
    else if (value !== false && value !== null && value !== undefined)
      element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children);
  return element;
}

/** Head and body of a table: words of its columns, and rows that begin with their names; cells are words or elements. */
export function tableParts(heads, rows) {
  const cell = (one) => (one?.tagName === "TD" ? one : make("td", {}, one));
  const body = rows.map(([name, ...cells]) =>
    make("tr", {}, make("th", { scope: "row" }, name), ...cells.map(cell)),
  );
  return [
    make("thead", {}, make("tr", {}, ...heads.map((head) => make("th", { scope: "col" }, head)))),
    make("tbody", {}, ...body),
  ];
}

/** A button with a text and the function of a click. */
export const button = (words, click, attributes = {}) =>
  make("button", { type: "button", click, ...attributes }, words);

/** A row of controls; false entries are skipped. */
export const bar = (...children) => make("div", { class: "bar" }, ...children.filter(Boolean));

/** Style of a bar from the middle of its box, to the right for positive shares. */
export const barStyle = (share) =>
  `width:${50 * Math.abs(share)}%;${share < 0 ? "right" : "left"}:50%;background:var(--${share < 0 ? "negative" : "positive"})`;

/** Pairs for a choice of the keys of an object. */
export const same = (one) => Object.keys(one).map((name) => [name, name]);

/** Pairs for a choice of runs. */
export const names = (shown) => shown.map(({ name }, k) => [k, name]);

/** Copy a text; whether the browser lets a page do it. */
export const copied = (text) =>
  Promise.resolve(navigator.clipboard?.writeText(text)).then(
    () => !!navigator.clipboard,
    () => false,
  );

/** A button that copies a command. */
export const copyButton = (command) =>
  button("Copy", async ({ target }) => {
    target.textContent = (await copied(command)) ? "Copied" : "Not allowed here: select it";
  });

/** A labelled choice: pairs of value and words; `value` is chosen at first. */
export function choice(label, pairs, change, value = pairs[0]?.[0]) {
  const select = make("select", { change: () => change(select.value) });
  select.append(...pairs.map(([one, words]) => make("option", { value: one }, words)));
  select.value = String(value);
  return make("label", { class: "choice" }, ...(label ? [make("span", {}, label)] : []), select);
}

/** A button that stays down. */
export const toggle = (label, pressed, change, attributes = {}) =>
  button(
    label,
    ({ currentTarget: self }) => {
      const now = self.getAttribute("aria-pressed") !== "true";
      self.setAttribute("aria-pressed", String(now));
      change(now);
    },
    { "aria-pressed": String(pressed), ...attributes },
  );

/** State that charts and arm share: time shown, stretch of time that is zoomed in on, joints and runs that are hidden. */
export const view = new (class extends EventTarget {
  time = 0;
  range = null;
  /** Joint, or name of a curve, beside which the others are pale. */
  focus = null;
  hiddenJoints = new Set();
  hiddenRuns = new Set();
  /** The run that is shown, if a reader chose it. */
  run = null;
  /** Words at times, in each figure. @type {{ time: number, words: string }[]} */
  marks = [];
  /** First and last time of all runs. */
  limits = null;

  full() {
    const times = this.limits ? [] : recorded.map((run) => unpack(run.frames.time, Float64Array));
    this.limits ??= [Math.min(...times.map((t) => t[0])), Math.max(...times.map((t) => t.at(-1)))];
    const [first, last] = this.limits; // a simulated run may go on where the recorded one failed
    return [first, Math.max(last, simulated.result.time.at(-1) ?? last)];
  }

  change(what, value) {
    this[what] = value;
    this.dispatchEvent(new Event(what));
  }

  /** Show one joint of those up to `count`, or all again if it is alone. */
  isolate(joint, count) {
    const others = Array.from({ length: count }, (_, i) => i + 1).filter((one) => one !== joint);
    const alone =
      !this.hiddenJoints.has(joint) && others.every((one) => this.hiddenJoints.has(one));
    this.hiddenJoints = new Set(alone ? [] : others);
    this.dispatchEvent(new Event("shown"));
  }

  show(what, entry, shown) {
    if (shown) this[what].delete(entry);
    else this[what].add(entry);
    this.dispatchEvent(new Event("shown"));
  }
})();
