// What limits a run: its error at the tool, again and again with one cause taken away.

import { bar, binaries, button, largest, make, tableParts } from "./data.js";
import { toolErrors } from "./arm.js";
import { SimulationWorker } from "./worker.js";
import { quantity, text } from "./numbers.js";

/** A run of a system that exchanges values `split` times in each communication step. */
function finer(simulation, split) {
  const steps = simulation.steps * split,
    step = simulation.step / split,
    { start, stop } = simulation;
  let last = stop - (start + (steps - 1) * step);
  while (start + (steps - 1) * step + last > stop) last *= 1 - Number.EPSILON;
  return { ...simulation, steps, step, last };
}

export class Budget {
  constructor(section) {
    this.worker = new SimulationWorker(binaries);
    this.button = button("Find out", () => this.find());
    this.status = make("span", { class: "note", role: "status" });
    this.table = make("table", { class: "numbers", hidden: true });
    this.element = make(
      "div",
      { class: "budget", hidden: true },
      bar(make("h3", {}, "What limits it"), this.button, this.status),
      make(
        "p",
        { class: "note" },
        "The recorded system runs again with one cause of its error changed at a time. The smaller the error becomes, the more it is due to this cause.",
      ),
      this.table,
    );
    section.append(this.element);
  }

  /** Be about a run: it needs an arm that follows a motion. */
  of(run) {
    this.cancel();
    this.run = run;
    this.element.hidden = !(run.arm && run.frames.error && run.simulation.causes.length);
    this.table.hidden = true;
    this.status.textContent = "";
  }

  cancel() {
    this.worker.cancel();
  }

  async find() {
    const { run, worker } = this,
      { simulation } = run,
      rows = [];
    this.button.disabled = true;
    const all = [{ words: "As recorded", changes: [] }, ...simulation.causes];
    try {
      for (const cause of all) {
        this.status.textContent = `${rows.length + 1} of ${all.length}: ${cause.words.toLowerCase()}`;
        const left = await worker
          .run(cause.split ? finer(simulation, cause.split) : simulation, cause.changes)
          .then(
            (result) => errorsOf({ ...run, result }),
            (error) => {
              if (error.name === "AbortError") throw error;
              return { failure: error.message };
            },
          );
        rows.push({ ...cause, ...left });
        this.show(rows);
      }
      this.status.textContent = "";
    } catch (error) {
      this.status.textContent =
        error.name === "AbortError" ? "Stopped for a slider." : error.message;
    }
    this.button.disabled = false;
  }

  show(rows) {
    const most = Math.max(...rows.map(({ max }) => max ?? 0)),
      [whole] = rows;
    const share = (value) =>
      make("td", { class: "share" }, make("i", { style: `width:${(100 * value) / most}%` }));
    this.table.hidden = false;
    this.table.replaceChildren(
      make("caption", {}, "Error of the end effector"),
      ...tableParts(
        ["", "", "largest", "RMS", "change"],
        rows.map((row) =>
          row.failure
            ? [row.words, make("td", { colspan: 4 }, make("small", {}, row.failure))]
            : [
                row.words,
                share(row.max),
                quantity(row.max, "m", most),
                quantity(row.rms, "m", most),
                row === whole ? "" : changeOf(whole.max, row.max),
              ],
        ),
      ),
    );
  }
}

/** Largest error of the end effector and its root mean square, in m. */
function errorsOf(run) {
  const { values } = toolErrors(run);
  return {
    max: 1e-3 * largest(values),
    rms: 1e-3 * Math.sqrt(values.reduce((sum, value) => sum + value * value, 0) / values.length),
  };
}

/** The factor by which a value differs from another, with three digits. */
function changeOf(before, after) {
  const ratio = after / before;
  if (!Number.isFinite(ratio)) return "–";
  return Math.abs(ratio - 1) < 1e-6 ? "none" : `× ${text(ratio, 3)}`;
}
