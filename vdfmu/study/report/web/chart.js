// A figure: curves over time that zoom together, show their values under the pointer, and have a logarithmic scale.

import {
  COLOURS,
  colourOf,
  darkScheme,
  inkOf,
  make,
  recorded,
  runs,
  simulated,
  toggle,
  view,
} from "./data.js";
import { drawEvents, eventAt } from "./events.js";
import { drawEnds, endsOf, keyOf, roomForNames, worstOf } from "./labels.js";
import { saveMenu } from "./save.js";
import { fitted, raised, text } from "./numbers.js";
import { decades, nearest, padded } from "./scales.js";
import { vendor } from "./vendor.js";

const { uPlot } = vendor;
const DASHES = [[], [9, 4], [9, 3, 2, 3], [2, 3]]; // as `DASHES` of vdfmu/extras/pictures/style.py
const HEIGHT = 240;
const PALE = 0.4,
  FADED = 0.15;
const NEAR = 14; // px, of the pointer to a curve

export class Chart {
  /** `curves` gives them: called when the chart first comes into sight, and when simulated ones change. */
  constructor(title, unit, curves) {
    this.title = title;
    this.unit = unit;
    this.curves = curves;
    this.log = false;
    this.seen = false;
    this.stale = true;
    /** See `worstOf`. @type {number[] | null} */
    this.worst = null;
    this.unitText = make("span", { class: "unit" }, unit);
    this.place = make("div", {
      class: "plot",
      tabindex: 0,
      role: "group",
      "aria-label": `${title}: values at the time shown`,
      focus: () => this.moveMark(),
      blur: () => this.plot?.setCursor({ left: -10, top: -10 }),
    });
    this.tip = make("div", { class: "tip", hidden: true });
    this.mark = make("div", { class: "mark" });
    this.element = make(
      "figure",
      { class: "chart", "aria-label": `${title} in ${unit || "no unit"} over time in seconds` },
      make(
        "figcaption",
        {},
        make("span", {}, make("strong", {}, title), " ", this.unitText),
        saveMenu(this),
        toggle(
          "log",
          false,
          (on) => {
            this.log = on;
            this.build();
          },
          { "aria-label": `log scale of absolute values: ${title}` },
        ),
      ),
      this.place,
      (this.words = make("p", { class: "note", hidden: true })),
    );
    new IntersectionObserver(
      ([entry]) => {
        this.seen = entry.isIntersecting;
        if (this.seen && this.stale) this.build();
        if (this.seen) this.moveMark();
      },
      { rootMargin: "200px" },
    ).observe(this.element);
    new ResizeObserver(
      () => this.plot && this.plot.setSize({ width: this.place.clientWidth, height: HEIGHT }),
    ).observe(this.place);
    addEventListener("beforeprint", () => {
      if (this.stale) this.build();
    });
    for (const event of ["time", "marks"]) view.addEventListener(event, () => this.moveMark());
    view.addEventListener("focus", () => this.refocus());
    for (const event of ["range", "shown"]) view.addEventListener(event, () => this.refresh());
    view.addEventListener("simulated", () => this.update());
    darkScheme.addEventListener("change", () => this.rebuild());
  }

  update() {
    const before = this.unpacked;
    this.unpacked = undefined;
    if (!this.seen || !this.plot) {
      this.stale = true;
      return;
    }
    this.unpacked = this.curves();
    if (this.unpacked.length !== before?.length || this.worst) {
      this.build();
      return;
    }
    const [min, max] = view.range ?? view.full();
    this.unpacked.forEach((curve, k) => {
      this.plot.series[k + 1].alpha = this.alpha(curve);
    });
    this.plot.setData(this.table(), false);
    this.plot.setScale("x", { min, max });
  }

  rebuild() {
    this.stale = true;
    if (this.seen) this.build();
  }

  refresh() {
    if (!this.seen || !this.plot) {
      this.stale = true;
      return;
    }
    this.unpacked.forEach((curve, k) => {
      const show = this.shows(curve);
      if (this.plot.series[k + 1].show !== show) this.plot.setSeries(k + 1, { show });
    });
    const [min, max] = view.range ?? view.full();
    if (this.plot.scales.x.min !== min || this.plot.scales.x.max !== max)
      this.plot.setScale("x", { min, max });
  }

  /** Fade what is not pointed to; of many joints, show the one that is. */
  refocus() {
    if (!this.seen || !this.plot || !this.unpacked) return;
    this.unpacked.forEach((curve, k) => {
      this.plot.series[k + 1].alpha = this.alpha(curve);
    });
    if (this.worst) this.refresh();
    this.plot.redraw(false);
  }

  /** Of many joints those with the largest values, until the reader chooses. */
  shows(curve) {
    if (view.hiddenRuns.has(curve.run)) return false;
    if (!this.worst || !curve.joint || view.hiddenJoints.size)
      return !view.hiddenJoints.has(curve.joint);
    return this.worst.includes(curve.joint) || curve.joint === view.focus;
  }

  /** Recorded lines are pale beside simulated ones, and all beside what is pointed to. */
  alpha(curve) {
    const pale = runs[curve.run] !== simulated && simulated.result.time.length ? PALE : 1;
    return this.faded(curve) ? FADED : pale;
  }

  /** Whether another curve is pointed to. */
  faded(curve) {
    return (
      view.focus !== null &&
      keyOf(curve) !== view.focus &&
      this.unpacked.some((one) => keyOf(one) === view.focus && this.shows(one))
    );
  }

  strokeOf(curve) {
    return curve.dashed ? inkOf("ink") : colourOf(curve.colour);
  }

  dashOf({ dashed, run, colour }) {
    if (dashed) return [5, 4];
    return DASHES[
      (recorded.length > 1 && runs[run] !== simulated
        ? run
        : Math.floor(Math.max(colour - 1, 0) / COLOURS)) % DASHES.length
    ];
  }

  ends() {
    return endsOf(this);
  }

  fit(most) {
    const [fit, exponent] = fitted(this.unit, most);
    return [fit || !exponent ? fit : `10${raised(exponent)} ${this.unit}`, exponent];
  }

  /** Columns of one table: time, and a column a curve with nulls where it has no number. */
  table(log = this.log) {
    const seen = (v) => (Number.isFinite(v) && !(log && v === 0) ? (log ? Math.abs(v) : v) : null);
    const byTime = new Map();
    for (const curve of this.unpacked) {
      if (!byTime.has(curve.time)) byTime.set(curve.time, []);
      byTime.get(curve.time).push(Array.from(curve.values, seen));
    }
    const tables = [...byTime].map(([time, columns]) => [Array.from(time), ...columns]);
    return tables.length > 1 ? uPlot.join(tables) : tables[0];
  }

  build() {
    this.stale = false;
    this.unpacked ??= this.curves();
    this.plot?.destroy();
    this.worst = worstOf(this.unpacked);
    this.words.hidden = !this.worst;
    this.words.textContent = `Joints ${this.worst?.join(", ")} have the largest values; choose others above.`;
    const [ink, line, names] = ["muted", "line", "ink"].map(inkOf);
    const axis = {
      stroke: ink,
      grid: { stroke: line, width: 1 },
      ticks: { stroke: line, width: 1, size: 4 },
      font: "12px system-ui, sans-serif",
    };
    const [min, max] = view.range ?? view.full();
    this.plot = new uPlot(
      {
        width: this.place.clientWidth || 300,
        height: HEIGHT,
        legend: { show: false },
        padding: [8, roomForNames(this), 0, 0],
        pxAlign: 0, // else curves become stairs, each point in the middle of a pixel
        cursor: { y: false, points: { size: 7 }, drag: { x: true, y: false }, dataIdx: nearest },
        scales: { x: { time: false, min, max }, y: this.log ? { distr: 3 } : { range: padded } },
        axes: [
          {
            ...axis,
            size: 30,
            space: 60,
            values: (_, splits) => splits.map((v, k) => `${text(v)}${k ? "" : " s"}`),
          },
          {
            ...axis,
            size: 54,
            ...(this.log && {
              grid: { ...axis.grid, filter: decades },
              ticks: { ...axis.ticks, filter: decades },
            }),
            values: (_, splits) => this.labels(splits),
          },
        ],
        series: [
          {},
          ...this.unpacked.map((curve) => ({
            label: curve.label,
            stroke: this.strokeOf(curve),
            width: curve.dashed ? 1 : this.unpacked.some((one) => one.dashed) ? 2.6 : 1.4,
            dash: this.dashOf(curve),
            alpha: this.alpha(curve),
            points: { show: false },
            spanGaps: true,
            show: this.shows(curve),
          })),
        ],
        hooks: {
          drawAxes: [(plot) => drawEvents(plot, this)],
          setCursor: [() => this.unpacked && this.showTip()],
          draw: [(plot) => this.unpacked && drawEnds(plot, this, names), () => this.moveMark()],
          setScale: [(plot, key) => key === "x" && plot.status && this.zoomed(plot.scales.x)],
        },
      },
      this.table(),
      this.place,
    );
    this.plot.over.append(this.mark, this.tip);
    this.plot.over.addEventListener("mousemove", ({ buttons }) => buttons || this.point());
    this.plot.over.addEventListener("mouseleave", () => view.change("focus", null));
    this.plot.over.addEventListener(
      "click",
      () =>
        this.plot.select.width < 2 &&
        this.plot.cursor.idx !== null &&
        view.change("time", this.plot.posToVal(this.plot.cursor.left, "x")),
    );
    this.plot.over.addEventListener(
      "touchmove",
      (event) => {
        const box = this.plot.over.getBoundingClientRect();
        this.plot.setCursor({ left: event.touches[0].clientX - box.left, top: 0 });
      },
      { passive: true },
    );
  }

  zoomed({ min, max }) {
    const [first, last] = view.full();
    const range = min <= first && max >= last ? null : [min, max];
    if (String(range) !== String(view.range)) view.change("range", range);
  }

  /** Point to the curve that is nearest to the pointer. */
  point() {
    const { top, idxs } = this.plot.cursor;
    const far = (k) =>
      this.plot.series[k + 1].show && (this.plot.data[k + 1][idxs?.[k + 1]] ?? null) !== null
        ? Math.abs(this.plot.valToPos(this.plot.data[k + 1][idxs[k + 1]], "y") - top)
        : Infinity;
    const nearby = [...this.unpacked.keys()].map((k) => [far(k), k]).sort(([a], [b]) => a - b)[0];
    const focus = nearby?.[0] < NEAR ? keyOf(this.unpacked[nearby[1]]) : null;
    if (focus !== view.focus) view.change("focus", focus);
  }

  /** Numbers of the vertical axis, in a unit that fits them. */
  labels(splits) {
    const largest = Math.max(...splits.map((v) => Math.abs(v ?? 0)));
    const [unit, scaled] = this.log ? [this.unit, 0] : this.fit(largest);
    this.unitText.textContent = unit;
    if (this.log)
      return decades(null, splits).map((v) =>
        v === null ? "" : `10${raised(Math.round(Math.log10(v)))}`,
      );
    return splits.map((v) => text(v / 10 ** scaled, 5));
  }

  /** A value and the unit of the axis that it is in, with three digits of the stretch that this spans. */
  written(value) {
    if (this.log) return [text(value, 3), this.unit];
    const { min, max } = this.plot.scales.y,
      [unit, scaled] = this.fit(Math.max(Math.abs(min), Math.abs(max)));
    const digits = Math.max(0, Math.min(9, 2 - Math.floor(Math.log10((max - min) / 10 ** scaled))));
    return [text(Number((value / 10 ** scaled).toFixed(digits)), 9), unit];
  }

  showTip() {
    const { left, idxs } = this.plot.cursor;
    const found = this.unpacked.flatMap((curve, k) => {
      const value =
        this.plot.series[k + 1].show && idxs[k + 1] !== null
          ? this.plot.data[k + 1][idxs[k + 1]]
          : null;
      return value === null || value === undefined
        ? []
        : [{ ...curve, value, time: this.plot.data[0][idxs[k + 1]] }];
    });
    this.tip.setAttribute(
      "role",
      document.activeElement === this.place ? "status" : "presentation",
    ); // said where keys read, not at every move of the pointer
    this.tip.hidden = left < 0 || !found.length;
    if (this.tip.hidden) return;
    const places = [...new Set(found.map(({ run }) => run))],
      several = places.length > 1,
      rows = Map.groupBy(found, ({ label }) => label);
    this.tip.style.gridTemplateColumns = `repeat(${places.length + 1}, auto)`;
    this.tip.replaceChildren(
      make("b", {}, `${text(found[0].time)} s${several ? ` [${this.written(0)[1]}]` : ""}`),
      ...places.map((place) => make("b", {}, several ? runs[place].name : "")),
      ...[...rows].flatMap(([label, [first, ...more]]) => [
        make(
          "span",
          {},
          make("i", {
            style: `background:${first.dashed ? "var(--ink)" : colourOf(first.colour)}`,
          }),
          label,
        ),
        ...places
          .map((place) => [first, ...more].find(({ run }) => run === place))
          .map((one) =>
            make(
              "output",
              {},
              one
                ? this.written(one.value)
                    .slice(0, several ? 1 : 2)
                    .join(" ")
                : "",
            ),
          ),
      ]),
    );
    const event = eventAt(this, left);
    if (event) this.tip.append(make("span", { class: "happened" }, event));
    const free = this.plot.over.clientWidth - this.tip.offsetWidth; // a broad one reaches over the axis
    this.tip.style.left = `${Math.max(Math.min(0, free), 2 * left > this.plot.over.clientWidth ? left - this.tip.offsetWidth - 12 : Math.min(left + 12, free))}px`;
  }

  moveMark() {
    if (!this.plot || !this.seen || this.plot.scales.x.min === null) return;
    const place = this.plot.valToPos(view.time, "x");
    this.mark.hidden = place < 0 || place > this.plot.over.clientWidth;
    this.mark.style.transform = `translateX(${place}px)`;
    this.events?.forEach((event) => event.remove());
    this.events = (view.marks ?? [])
      .filter(({ time }) => time >= this.plot.scales.x.min && time <= this.plot.scales.x.max)
      .map(({ time, words }) =>
        make(
          "div",
          { class: "event", style: `transform:translateX(${this.plot.valToPos(time, "x")}px)` },
          make("span", {}, words),
        ),
      );
    this.plot.over.append(...this.events);
    if (document.activeElement === this.place) this.plot.setCursor({ left: place, top: 0 }); // keys read values too
  }
}
