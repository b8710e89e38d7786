// A map of many curves: a row a joint, the time to the right, values below zero and above it in the page's two colours.

import { inkOf, largest, make, view } from "./data.js";
import { text } from "./numbers.js";

export const MOST_CURVES = 8; // most joints that are drawn as curves only
const WORST_JOINTS = 3,
  HEAT_ROW = 7; // curves below a map; px

export class Heat {
  constructor(chart) {
    this.chart = chart;
    this.canvas = make("canvas", {
      class: "heat",
      role: "img",
      mousemove: (event) => this.point(event),
      mouseleave: () => view.change("focus", null),
      click: (event) => view.change("time", chart.plot.posToVal(event.offsetX, "x")),
    });
    this.words = make("p", { class: "note" });
    chart.place.before(this.canvas, this.words);
  }

  /** Choose the joints with the largest values among all curves. */
  static worst(curves) {
    const peaks = new Map();
    for (const { joint, dashed, values } of curves) {
      if (joint && !dashed) peaks.set(joint, Math.max(peaks.get(joint) ?? 0, largest(values)));
    }
    return peaks.size > MOST_CURVES
      ? [...peaks]
          .sort((a, b) => b[1] - a[1])
          .slice(0, WORST_JOINTS)
          .map(([joint]) => joint)
      : null;
  }

  draw(plot) {
    const { chart, canvas } = this,
      { min, max } = plot.scales.x,
      width = plot.over.clientWidth,
      asked = [chart.unpacked, plot, min, max, width, view.hiddenJoints.size];
    if (!width || asked.every((one, k) => one === this.asked?.[k])) return;
    this.asked = asked;
    this.rows = chart.unpacked.filter(
      ({ joint, dashed, run }) => joint && !dashed && run === chart.unpacked[0].run,
    );
    const count = this.rows.length;
    Object.assign(canvas, { width, height: count });
    canvas.style.cssText = `margin-left:${plot.over.offsetLeft}px;width:${width}px;height:${HEAT_ROW * count}px`;
    const cells = this.rows.map(({ time, values }) => {
      const found = new Float64Array(width);
      let column = -1;
      for (let k = 0; k < time.length; k += 1) {
        // of each column the value furthest from zero; a value holds up to the next
        const next = Math.floor(((time[k] - min) / (max - min)) * width);
        if (next < 0) {
          found.fill(values[k]);
          continue;
        }
        if (next >= width) break;
        if (next > column || Math.abs(values[k]) > Math.abs(found[next]))
          found.fill(values[k], next);
        column = next;
      }
      return found;
    });
    const most = Math.max(...cells.map(largest)) || 1;
    const [zero, below, above] = ["card", "negative", "positive"].map((name) =>
      [1, 3, 5].map((k) => parseInt(inkOf(name).slice(k, k + 2), 16)),
    );
    const image = new ImageData(width, count);
    cells.forEach((row, i) =>
      row.forEach((v, column) => {
        const share = Math.sqrt(Math.min(1, Math.abs(v) / most || 0)),
          end = v < 0 ? below : above; // a root: small values show too
        for (let k = 0; k < 3; k += 1)
          image.data[4 * (i * width + column) + k] = zero[k] + share * (end[k] - zero[k]);
        image.data[4 * (i * width + column) + 3] = 255;
      }),
    );
    canvas.getContext("2d").putImageData(image, 0, 0);
    const [unit, exponent] = chart.fit(most);
    const words = `Joint 1 (top) to ${count}; blue −${text(most / 10 ** exponent, 3)} to orange ${text(most / 10 ** exponent, 3)} ${unit}, by the square root.`;
    this.words.textContent = `${words} ${view.hiddenJoints.size ? "Curves: the joints chosen." : `Curves: the largest, joints ${[...chart.worst].sort((a, b) => a - b).join(", ")}, and the one pointed to.`}`;
    canvas.setAttribute("aria-label", `${chart.title}: map of all joints over time. ${words}`);
  }

  point({ offsetY }) {
    const joint =
      this.rows[Math.min(this.rows.length - 1, Math.max(0, Math.floor(offsetY / HEAT_ROW)))].joint;
    if (joint !== view.focus) view.change("focus", joint);
  }
}
