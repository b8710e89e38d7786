// The pictures of a study: points over two columns, contours, and columns side by side. Dragging in one chooses points in all.

import { largest, make } from "./data.js";
import { fitted, quantity, raised, text } from "./numbers.js";

const MARGIN = { left: 58, right: 14, top: 24, bottom: 42 };
const CELLS = 48,
  LEVELS = 8,
  REACH = 16; // of a contour: cells a side, lines; px between a click and a point
const STOPS = [
  [68, 1, 84],
  [59, 82, 139],
  [33, 145, 140],
  [94, 201, 98],
  [253, 231, 37],
]; // viridis

/** Colour of a share between 0 and 1: viridis; other values are not numbers. */
export function shade(share) {
  const place = Math.min(Math.max(share, 0), 1) * (STOPS.length - 1),
    k = Math.min(Math.floor(place), STOPS.length - 2);
  return `rgb(${STOPS[k].map((from, i) => Math.round(from + (place - k) * (STOPS[k + 1][i] - from)))})`;
}

/** A column of the study: values by point, its scale, and how its values are written. */
export class Column {
  /** Ends of its scale. */
  low = 0;
  high = 1;

  constructor(facts) {
    /** @type {{ name: string, unit: string, axis: boolean, log: boolean, words: string[], values: (number | null)[] }} */
    const { name, unit, axis, log, words, values } = facts;
    this.name = name;
    this.axis = axis;
    this.log = log;
    this.words = words;
    const [fit, power] = words.length || log ? [] : fitted(unit, largest(values));
    this.unit = fit || unit;
    this.values = fit ? values.map((v) => (v === null ? null : v / 10 ** power)) : values;
    const known = this.values.filter((v) => v !== null).map((v) => this.onScale(v));
    [this.low, this.high] = known.length
      ? [known.reduce((a, b) => Math.min(a, b)), known.reduce((a, b) => Math.max(a, b))]
      : [0, 1];
    if (this.high === this.low) [this.low, this.high] = [this.low - 0.5, this.high + 0.5];
    this.label = this.unit ? `${this.name} [${this.unit}]` : this.name;
  }

  onScale(value) {
    return this.log ? Math.log10(value) : value;
  }

  /** Share of the scale, NaN for a point without a value. */
  share(row) {
    return this.values[row] === null
      ? NaN
      : (this.onScale(this.values[row]) - this.low) / (this.high - this.low);
  }

  valueAt(share) {
    const found = this.low + share * (this.high - this.low);
    return this.log ? 10 ** found : found;
  }

  written(row) {
    return this.values[row] === null
      ? "no value"
      : this.wordsOf(this.values[row], !this.words.length);
  }

  wordsOf(value, unit = false) {
    return this.words.length
      ? this.words[Math.round(value)]
      : unit
        ? quantity(value, this.unit)
        : text(value, 3);
  }

  /** Values with room for their words. */
  ticks(most) {
    if (this.words.length) return this.words.map((_, k) => k);
    const low = this.valueAt(0),
      high = this.valueAt(1);
    if (this.log) {
      const powers = Array.from(
        { length: Math.ceil(this.high) - Math.floor(this.low) + 1 },
        (_, k) => 10 ** (Math.floor(this.low) + k),
      );
      const all =
        powers.length > most
          ? powers.filter((_, k) => k % Math.ceil(powers.length / most) === 0)
          : powers.flatMap((p) => (powers.length > most / 2 ? [p] : [p, 2 * p, 5 * p]));
      return all.filter((v) => v >= low * (1 - 1e-9) && v <= high * (1 + 1e-9));
    }
    const rough = (high - low) / most,
      power = 10 ** Math.floor(Math.log10(rough)),
      step = [1, 2, 5, 10].find((k) => k * power >= rough) * power;
    return Array.from(
      { length: Math.floor(high / step) - Math.ceil(low / step) + 1 },
      (_, k) => (Math.ceil(low / step) + k) * step,
    );
  }

  tickText(value) {
    if (this.words.length || !this.log || value >= 0.01)
      return this.wordsOf(Number(value.toPrecision(6)));
    const exponent = Math.floor(Math.log10(value) + 1e-9),
      digit = Math.round(value / 10 ** exponent);
    return `${digit === 1 ? "" : `${digit}·`}10${raised(exponent)}`;
  }
}

export function svg(tag, attributes = {}, ...children) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

/** A picture in a box: it draws itself again when its width or the study changes. */
class Picture {
  constructor(lab, title, height) {
    this.lab = lab;
    this.height = height;
    this.svg = svg("svg", { class: "study", role: "img", "aria-label": title });
    this.element = make(
      "figure",
      { class: "chart" },
      make("figcaption", {}, make("strong", {}, title)),
      this.svg,
    );
    new ResizeObserver(() => {
      if (this.svg.clientWidth !== this.width) this.draw();
    }).observe(this.element);
    lab.addEventListener("change", () => this.draw());
    this.svg.addEventListener("pointerdown", (event) => this.press(event));
    this.svg.addEventListener("dblclick", () => lab.clear());
  }

  draw() {
    this.width = this.svg.clientWidth;
    if (this.width <= MARGIN.left + MARGIN.right) return; // not laid out
    this.svg.setAttribute("viewBox", `0 0 ${this.width} ${this.height}`);
    this.svg.setAttribute("height", this.height);
    this.svg.replaceChildren(...this.parts());
  }

  /** What is drawn. @returns {Element[]} */
  parts() {
    return [];
  }

  /** The point at a place of the pointer. @returns {number | undefined} */
  nearestRow(_place) {
    return undefined;
  }

  /** Choose the points between two places of the pointer. */
  brush(_start, _end) {}

  placeOf({ clientX, clientY }) {
    const box = this.svg.getBoundingClientRect();
    return [clientX - box.left, clientY - box.top];
  }

  /** A drag marks a part, a click chooses a point. */
  press(event) {
    const start = this.placeOf(event),
      frame = svg("rect", { class: "brush" });
    let end = start;
    const move = (next) => {
      end = this.placeOf(next);
      if (!frame.isConnected) this.svg.append(frame);
      const [x, y, width, height] = this.frameOf(start, end);
      for (const [name, value] of Object.entries({ x, y, width, height }))
        frame.setAttribute(name, value);
    };
    const up = () => {
      removeEventListener("pointermove", move);
      frame.remove();
      if (Math.hypot(end[0] - start[0], end[1] - start[1]) < 5) {
        const row = this.nearestRow(start);
        if (row !== undefined) this.lab.choose(row);
      } else this.brush(start, end);
    };
    event.preventDefault();
    addEventListener("pointermove", move);
    addEventListener("pointerup", up, { once: true });
  }

  frameOf(start, end) {
    return [
      Math.min(start[0], end[0]),
      Math.min(start[1], end[1]),
      Math.abs(end[0] - start[0]),
      Math.abs(end[1] - start[1]),
    ];
  }

  x(share) {
    return MARGIN.left + share * (this.width - MARGIN.left - MARGIN.right);
  }

  y(share) {
    return this.height - MARGIN.bottom - share * (this.height - MARGIN.bottom - MARGIN.top);
  }

  shareOf([x, y]) {
    return [(x - this.x(0)) / (this.x(1) - this.x(0)), (y - this.y(0)) / (this.y(1) - this.y(0))];
  }
}

/** Points over two columns. */
export class Scatter extends Picture {
  constructor(lab, title, columns) {
    super(lab, title, 320);
    this.columns = columns; // a function that gives both
  }

  parts() {
    const [across, up] = this.columns(),
      { lab } = this;
    return [
      ...this.under(across, up),
      ...this.axes(across, up),
      ...lab.rows().map((row) => this.mark(row, across, up)),
    ];
  }

  /** What is drawn below the points. @returns {Element[]} */
  under(_across, _up) {
    return [];
  }

  axes(across, up) {
    const end = this.x(1),
      low = this.y(0),
      parts = [svg("path", { class: "line", d: `M${this.x(0)} ${this.y(1)}V${low}H${end}` })];
    for (const value of across.ticks(Math.floor((end - this.x(0)) / 70))) {
      const x = this.x((across.onScale(value) - across.low) / (across.high - across.low));
      parts.push(
        svg("path", { class: "line", d: `M${x} ${low}v4` }),
        svg("text", { x, y: low + 16, class: "middle" }, across.tickText(value)),
      );
    }
    for (const value of up.ticks(6)) {
      const y = this.y((up.onScale(value) - up.low) / (up.high - up.low));
      parts.push(
        svg("path", { class: "line", d: `M${this.x(0)} ${y}h-4` }),
        svg("text", { x: this.x(0) - 7, y: y + 4, class: "end" }, up.tickText(value)),
      );
    }
    return [
      ...parts,
      svg("text", { x: end, y: low + 34, class: "end name" }, across.label),
      svg("text", { x: 4, y: 10, class: "name" }, up.label),
    ];
  }

  /** Place of a point; one without a value is at the lower edge. */
  at(row, across, up) {
    const shares = [across.share(row), up.share(row)];
    return [
      this.x(Number.isNaN(shares[0]) ? 0 : shares[0]),
      this.y(Number.isNaN(shares[1]) ? 0 : shares[1]),
    ];
  }

  mark(row, across, up) {
    const { lab } = this,
      [x, y] = this.at(row, across, up),
      failed = Number.isNaN(lab.colour.share(row));
    const look = `${lab.passes(row) ? "" : " off"}${lab.chosen === row ? " chosen" : ""}`,
      title = svg("title", {}, lab.titleOf(row));
    return failed
      ? svg("path", { class: `cross${look}`, d: `M${x - 4} ${y - 4}l8 8m0 -8l-8 8` }, title)
      : svg(
          "circle",
          {
            class: `point${look}`,
            cx: x,
            cy: y,
            r: lab.chosen === row ? 7 : 4.5,
            fill: shade(lab.colour.share(row)),
          },
          title,
        );
  }

  nearestRow(place) {
    const [across, up] = this.columns(),
      far = (row) => {
        const [x, y] = this.at(row, across, up);
        return Math.hypot(x - place[0], y - place[1]);
      };
    return this.lab
      .rows()
      .filter((row) => this.lab.passes(row) && far(row) < REACH)
      .sort((a, b) => far(a) - far(b))[0];
  }

  brush(start, end) {
    const [a, b] = [this.shareOf(start), this.shareOf(end)];
    this.lab.limit(
      new Map(
        this.columns().map((column, k) => [column, [Math.min(a[k], b[k]), Math.max(a[k], b[k])]]),
      ),
    );
  }
}

/** The measure over two axes, as colours and lines between the points. */
export class Contour extends Scatter {
  under(across, up) {
    const field = this.lab.field(across, up),
      { colour } = this.lab;
    if (!field) return [];
    const canvas = make("canvas", { width: CELLS, height: CELLS }),
      pen = canvas.getContext("2d");
    field.forEach((line, j) =>
      line.forEach((share, i) => {
        if (Number.isNaN(share)) return;
        pen.fillStyle = shade(share);
        pen.fillRect(i, CELLS - 1 - j, 1, 1);
      }),
    );
    const at = (i, j) => [this.x((i + 0.5) / CELLS), this.y((j + 0.5) / CELLS)],
      paths = [];
    for (let k = 1; k < LEVELS; k += 1)
      paths.push(
        svg(
          "path",
          { class: "level", d: contourLines(field, k / LEVELS, at) },
          svg("title", {}, `${colour.name} = ${colour.wordsOf(colour.valueAt(k / LEVELS), true)}`),
        ),
      );
    const box = {
      x: this.x(0),
      y: this.y(1),
      width: this.x(1) - this.x(0),
      height: this.y(0) - this.y(1),
    };
    return [
      svg("image", { ...box, preserveAspectRatio: "none", href: canvas.toDataURL() }),
      ...paths,
    ];
  }
}

/** Lines at which a field has a level, by marching squares. */
function contourLines(field, level, at) {
  const parts = [];
  for (let j = 0; j + 1 < CELLS; j += 1) {
    for (let i = 0; i + 1 < CELLS; i += 1) {
      const corners = [
          [i, j],
          [i + 1, j],
          [i + 1, j + 1],
          [i, j + 1],
        ],
        values = corners.map(([a, b]) => field[b][a] - level),
        ends = [];
      if (values.some(Number.isNaN)) continue;
      for (let k = 0; k < 4; k += 1) {
        const next = (k + 1) % 4;
        if (values[k] < 0 === values[next] < 0) continue;
        const share = values[k] / (values[k] - values[next]);
        ends.push(
          at(...corners[k].map((from, axis) => from + share * (corners[next][axis] - from))),
        );
      }
      for (let k = 0; k + 1 < ends.length; k += 2)
        parts.push(`M${ends[k].map((v) => v.toFixed(1))}L${ends[k + 1].map((v) => v.toFixed(1))}`);
    }
  }
  return parts.join("");
}

/** Values between points, shares of the measure's scale: on a grid in each of its cells, else means of the points weighted by nearness. */
export function fieldOf(points) {
  const places = (axis) =>
      [...new Set(points.map((point) => point[axis].toFixed(9)))].map(Number).sort((a, b) => a - b),
    [xs, ys] = [places(0), places(1)];
  const cells = new Map();
  for (const [x, y, value] of points) {
    const key = `${x.toFixed(9)} ${y.toFixed(9)}`,
      [sum, count] = cells.get(key) ?? [0, 0];
    cells.set(key, [sum + value, count + 1]);
  }
  const full = xs.length > 1 && ys.length > 1 && cells.size === xs.length * ys.length;
  const own = (i, j) => {
    const [sum, count] = cells.get(`${xs[i].toFixed(9)} ${ys[j].toFixed(9)}`);
    return sum / count;
  };
  const below = (all, v) =>
    Math.max(
      0,
      Math.min(
        all.findLastIndex((one) => one <= v + 1e-12),
        all.length - 2,
      ),
    );
  const known = points.filter(([, , value]) => !Number.isNaN(value));
  const between = (x, y) => {
    const i = below(xs, x),
      j = below(ys, y),
      a = (x - xs[i]) / (xs[i + 1] - xs[i]),
      b = (y - ys[j]) / (ys[j + 1] - ys[j]);
    return (
      (1 - b) * ((1 - a) * own(i, j) + a * own(i + 1, j)) +
      b * ((1 - a) * own(i, j + 1) + a * own(i + 1, j + 1))
    );
  };
  const near = (x, y) => {
    let sum = 0,
      weights = 0;
    for (const [px, py, value] of known) {
      const weight = 1 / ((px - x) ** 2 + (py - y) ** 2 + 1e-4) ** 2;
      sum += weight * value;
      weights += weight;
    }
    return sum / weights;
  };
  return Array.from({ length: CELLS }, (_, j) =>
    Array.from({ length: CELLS }, (__, i) =>
      (full ? between : near)((i + 0.5) / CELLS, (j + 0.5) / CELLS),
    ),
  );
}

/** Columns side by side, a line a point. */
export class Parallel extends Picture {
  constructor(lab, title) {
    super(lab, title, 340);
  }

  get columns() {
    return [...this.lab.axes, this.lab.colour];
  }

  across(k) {
    return 70 + (k * (this.width - 150)) / Math.max(1, this.columns.length - 1);
  }

  parts() {
    const { lab, columns } = this,
      rows = [...lab.rows()].sort(
        (a, b) =>
          lab.passes(a) - lab.passes(b) || Number(lab.chosen === a) - Number(lab.chosen === b),
      );
    const lines = rows.map((row) => {
      const failed = Number.isNaN(lab.colour.share(row)),
        d = columns
          .flatMap((column, k) =>
            Number.isNaN(column.share(row))
              ? []
              : [`${this.across(k).toFixed(1)} ${this.y(column.share(row)).toFixed(1)}`],
          )
          .join("L");
      return svg(
        "path",
        {
          class: `way${failed ? " failed" : ""}${lab.passes(row) ? "" : " off"}${lab.chosen === row ? " chosen" : ""}`,
          d: `M${d}`,
          stroke: failed ? "var(--fail)" : shade(lab.colour.share(row)),
        },
        svg("title", {}, lab.titleOf(row)),
      );
    });
    const axes = columns.flatMap((column, k) => {
      const x = this.across(k),
        [low, high] = lab.ranges.get(column) ?? [],
        marks = column.ticks(6).map((value) =>
          svg(
            "text",
            {
              class: "end halo",
              x: x - 6,
              y: this.y((column.onScale(value) - column.low) / (column.high - column.low)) + 4,
            },
            column.tickText(value),
          ),
        );
      const range =
        low === undefined
          ? []
          : [
              svg("rect", {
                class: "brush",
                x: x - 7,
                width: 14,
                y: this.y(Math.min(high, 1.02)),
                height: this.y(Math.max(low, -0.02)) - this.y(Math.min(high, 1.02)),
              }),
            ];
      return [
        svg("path", { class: "axis", d: `M${x} ${this.y(0)}V${this.y(1)}` }),
        ...marks,
        ...range,
        svg(
          "text",
          {
            class: `${k === 0 ? "" : k === columns.length - 1 ? "end" : "middle"} name`,
            x: k === 0 ? 4 : k === columns.length - 1 ? this.width - 4 : x,
            y: this.height - (k % 2 && columns.length > 3 ? 4 : 20),
          },
          column.label,
        ),
      ];
    });
    return [...lines, ...axes];
  }

  nearestAxis([x]) {
    return this.columns.reduce(
      (best, _, k) => (Math.abs(this.across(k) - x) < Math.abs(this.across(best) - x) ? k : best),
      0,
    );
  }

  frameOf(start, end) {
    const x = this.across(this.nearestAxis(start));
    return [x - 7, Math.min(start[1], end[1]), 14, Math.abs(end[1] - start[1])];
  }

  brush(start, end) {
    const [a, b] = [this.shareOf(start)[1], this.shareOf(end)[1]];
    this.lab.limit(
      new Map([[this.columns[this.nearestAxis(start)], [Math.min(a, b), Math.max(a, b)]]]),
    );
  }

  nearestRow([x, y]) {
    const k = Math.max(
        0,
        Math.min(
          this.columns.length - 2,
          this.columns.findLastIndex((_, i) => this.across(i) <= x),
        ),
      ),
      share = (x - this.across(k)) / (this.across(k + 1) - this.across(k));
    const far = (row) => {
      const [a, b] = [this.columns[k].share(row), this.columns[k + 1].share(row)];
      return Math.abs(this.y(Number.isNaN(b) ? a : (1 - share) * a + share * b) - y);
    };
    return this.lab
      .rows()
      .filter((row) => this.lab.passes(row) && far(row) < REACH)
      .sort((a, b) => far(a) - far(b))[0];
  }
}
