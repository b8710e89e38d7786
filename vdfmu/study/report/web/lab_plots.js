// The pictures of a study: points over two columns, contours, and columns side by side. Dragging in one chooses points in all.

import { make } from "./data.js";
import { shade } from "./lab_column.js";
import { levelPaths } from "./lab_field.js";

const MARGIN = { left: 58, right: 14, top: 24, bottom: 42 };
const LEVELS = 8, // lines of a contour; two colours between them
  LABEL = 48, // px of a tick
  NARROW = 560, // px, from which labels of columns are in two rows
  REACH = 16; // px between a click and a point

/** Looks of a point by its role. */
const SHAPES = { start: { rx: 0 }, infeasible: { "fill-opacity": 0 } };

function svg(tag, attributes = {}, ...children) {
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
      ...lab.rows(true).flatMap((row) => this.mark(row, across, up)),
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
    for (const value of across.ticks(Math.floor((end - this.x(0)) / LABEL))) {
      const x = this.x(across.shareOf(value));
      parts.push(
        svg("path", { class: "line", d: `M${x} ${low}v4` }),
        svg("text", { x, y: low + 16, class: "middle" }, across.tickText(value)),
      );
    }
    for (const value of up.ticks(6)) {
      const y = this.y(up.shareOf(value));
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

  /** A point: a circle, a ring if it misses a limit, a square for the start; a cross if it failed. */
  mark(row, across, up) {
    const { lab } = this,
      [x, y] = this.at(row, across, up),
      role = lab.roleOf(row),
      named = role !== "" && role !== "infeasible",
      size = named || lab.chosen === row ? 7 : 4.5,
      share = lab.colour.share(row),
      look = lab.lookOf(row),
      title = svg("title", {}, lab.titleOf(row));
    if (Number.isNaN(share))
      return [svg("path", { class: `cross${look}`, d: `M${x - 4} ${y - 4}l8 8m0 -8l-8 8` }, title)];
    const place = { x: x - size, y: y - size, width: 2 * size, height: 2 * size, rx: size };
    const mark = svg(
      "rect",
      { class: `point${look}`, ...place, fill: shade(share), ...SHAPES[role] },
      title,
    );
    if (!named) return [mark];
    const end = x > this.width / 2,
      words = { class: `halo${end ? " end" : ""} name`, x: x + (end ? -11 : 11), y: y + 4 };
    return [mark, svg("text", words, role)];
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
    const { colour } = this.lab,
      { places, triangles } = this.lab.field(across, up),
      at = ([x, y]) => [this.x(x), this.y(y)],
      parts = [];
    for (let k = 0; k < 2 * LEVELS; k += 1) {
      const share = k / 2 / LEVELS,
        { area, line } = levelPaths(places, triangles, share, at);
      parts.push(svg("path", { d: area, fill: shade(share + 0.25 / LEVELS) }));
      if (k && k % 2 === 0)
        parts.push(
          svg(
            "path",
            { class: "level", d: line },
            svg("title", {}, `${colour.name} = ${colour.wordsOf(colour.valueAt(share), true)}`),
          ),
        );
    }
    return parts;
  }
}

/** Parallel coordinates: one line per point. */
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
      rows = lab
        .rows(true)
        .sort(
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
          class: `way${failed ? " failed" : ""}${lab.lookOf(row)}`,
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
              y: this.y(column.shareOf(value)) + 4,
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
            y: this.height - (k % 2 && (columns.length > 3 || this.width < NARROW) ? 4 : 20),
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
