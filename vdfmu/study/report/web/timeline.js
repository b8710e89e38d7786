// The timeline below the arm: the error of the tool over time, and marks of events.

import { button, largest, make, simulated, view } from "./data.js";
import { toolErrors } from "./arm.js";
import { quantity } from "./numbers.js";

const SPARK = [1000, 30]; // of the line's picture

/** A slider of time with a picture of the run behind it. */
export class Timeline {
  constructor(slider) {
    this.line = make("div", { class: "spark", "aria-hidden": "true" });
    this.marks = make("div", { class: "marks" });
    this.element = make("div", { class: "timeline" }, this.line, slider, this.marks);
  }

  /** Draw the errors of a run, and of the one simulated beside it, from `first` to `last` [s]. */
  draw(run, first, last) {
    const pale = simulated.of === run && simulated.result.time.length,
      shown = [run, ...(pale ? [simulated] : [])].filter((one) => one.frames.error);
    const found = shown.map(toolErrors),
      most = Math.max(0, ...found.map(({ values }) => largest(values)));
    const share = (time) => Math.min(1, Math.max(0, (time - first) / (last - first || 1)));
    const paths = found.map(({ time, values }) =>
      Array.from(
        time,
        (t, k) =>
          `${(SPARK[0] * share(t)).toFixed(1)} ${(SPARK[1] * (1 - 0.96 * Math.min(1, (values[k] || 0) / (most || 1)))).toFixed(2)}`,
      ).join("L"),
    );
    this.line.innerHTML = `<svg viewBox="0 0 ${SPARK[0]} ${SPARK[1]}" preserveAspectRatio="none">${paths.map((path, k) => (path ? `<path class="${k ? "second" : ""}" d="M${path}"/>` : "")).join("")}</svg>`;
    this.marks.replaceChildren(
      ...(run.marks ?? []).map(({ time, words, bad }) => {
        const title = `Go to ${quantity(time, "s")}: ${words}`;
        return button("", () => view.change("time", time), {
          class: bad ? "bad" : "",
          style: `left:${100 * share(time)}%`,
          title,
          "aria-label": title,
        });
      }),
    );
  }
}
