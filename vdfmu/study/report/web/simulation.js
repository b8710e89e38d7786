// The panel that simulates: sliders, the page's own run, and what it found beside what was recorded.

import {
  binaries,
  choice,
  largest,
  make,
  NOTHING,
  recorded,
  rowsOf,
  simulated,
  view,
} from "./data.js";
import { recalled, remember, whenRecalled } from "./state.js";
import { toolErrors } from "./arm.js";
import { Knob } from "./knob.js";
import { Budget, changeOf } from "./budget.js";
import { SimulationWorker, difference } from "./worker.js";
import { quantity, text } from "./numbers.js";

const PATIENCE = 1000; // ms; a run that takes longer is stopped for a newer one

class Simulation {
  constructor(section, able) {
    this.worker = new SimulationWorker(binaries);
    this.busy = false;
    this.again = false;
    this.given = [];
    this.status = make("p", { class: "note", role: "status" });
    this.bar = make("progress", { max: 1, "aria-label": "Progress of the simulation" });
    this.verdict = make("ul");
    this.failure = make("div", { class: "failure", role: "alert", hidden: true });
    this.back = make("button", { type: "button", click: () => this.reset() }, "Reset");
    this.hint = make(
      "p",
      { class: "note" },
      "Move a slider: this browser runs the equations of the FMUs again, and draws the simulated run over the recorded one. A double click puts a slider back.",
    );
    this.legend = make("p", { class: "note" });
    this.knobs = make("div", { class: "knobs" });
    this.results = make("table");
    section.append(
      make(
        "div",
        { class: "bar" },
        make("h2", {}, "Simulate"),
        ...(able.length > 1
          ? [
              choice(
                "Run",
                able.map((run, k) => [k, run.name]),
                (k) => this.choose(able[k]),
              ),
            ]
          : []),
        this.back,
        this.status,
        this.bar,
      ),
      this.hint,
      this.legend,
      this.knobs,
      this.failure,
      make("div", { class: "found" }, this.results, make("div", { class: "checks" }, this.verdict)),
    );
    this.budget = new Budget(section);
    this.choose(able[0], false);
    whenRecalled(() => {
      this.recall();
      this.rerun();
    });
    const seen = new IntersectionObserver(([entry]) => {
      if (!entry.isIntersecting) return;
      seen.disconnect();
      this.rerun();
    });
    seen.observe(section);
  }

  choose(run, start = true) {
    this.show(NOTHING);
    this.of = simulated.of = run;
    view.change("run", run);
    const {
      knobs,
      margins: { good, poor },
    } = run.simulation;
    this.sliders = knobs.map((knob) => new Knob(knob, run.simulation.margins, () => this.rerun()));
    this.knobs.replaceChildren(...this.sliders.map(({ element }) => element));
    this.hint.hidden = this.back.hidden = !knobs.length;
    this.legend.hidden = !this.sliders.some(({ judged }) => judged);
    this.legend.replaceChildren(
      `Tracks: modulus margin of the loops, linearised along the recorded run${this.sliders.some(({ still }) => still) ? " without its dry friction" : ""}, with this slider alone moved: `,
      ...[
        ["good", `from ${good}`],
        ["fair", `from ${poor}`],
        ["poor", "below, or unstable"],
      ].map(([colour, words]) =>
        make("span", { class: "key" }, make("i", { class: colour }), words),
      ),
      "A line marks where the loops become unstable.",
    );
    this.budget.of(run);
    this.recall();
    if (start || this.changes().length) this.rerun();
  }

  /** Set the sliders as the address has them. */
  recall() {
    for (const slider of this.sliders) slider.state = recalled(slider.knob.key) ?? "";
  }

  reset() {
    for (const slider of this.sliders) slider.reset();
    this.rerun();
  }

  /** Run with values of parameters, {unit, name, value}, under the sliders, which start at 1 again. */
  open(changes) {
    this.given = changes;
    this.reset();
  }

  changes() {
    return [...this.given, ...this.sliders.flatMap((slider) => slider.changes(this.of.simulation))];
  }

  /** Run with the sliders as they are: after the run that is under way, which is stopped if it is slow. */
  async rerun() {
    this.again = true;
    this.budget.cancel();
    for (const slider of this.sliders) remember(slider.knob.key, slider.state);
    if (this.busy) {
      this.stopping ??= setTimeout(
        () => this.worker.cancel(),
        PATIENCE + this.began - performance.now(),
      );
      return;
    }
    this.busy = true;
    this.bar.classList.add("on");
    while (this.again) {
      this.again = false;
      const changes = this.changes(),
        { of } = this;
      this.bar.value = 0;
      this.began = performance.now();
      const run = this.worker.run(of.simulation, changes, (part) => {
        this.bar.value = part;
      });
      const [found, error] = await run.then(
        (one) => [one, null],
        (one) => [one.found ?? NOTHING, one],
      );
      this.stopping = clearTimeout(this.stopping);
      if (error?.name !== "AbortError" && of === this.of) this.take(found, changes, error?.message);
    }
    this.busy = false;
    this.bar.classList.remove("on");
  }

  /** Show what a run found, up to its failure if it has failed. */
  take(found, changes, failure = "") {
    const { time } = found,
      { stop, start } = this.of.simulation;
    this.explain(found, failure);
    this.status.textContent = failure
      ? `Stopped${time.length ? ` at ${text(time.at(-1), 4)} s` : ""}.`
      : `${text(stop - start, 4)} s simulated in ${quantity(found.seconds, "s")}.`;
    if (!changes.length) this.judge(found, failure);
    this.verdict.classList.toggle("other", changes.length > 0);
    this.tabulate(found, failure);
    this.show(changes.length ? found : NOTHING);
  }

  /** Say when the run became unstable, by which sliders, and mark the time in the figures. */
  explain(found, failure) {
    const moved = this.sliders.flatMap((slider) => slider.moved()),
      unstable = moved.filter((one) => one.unstable),
      end = found.time.at(-1);
    const begin =
      (unstable.length ? departure({ ...this.of, result: found }, this.of) : null) ??
      (failure && found.time.length ? end : null);
    const words = (list) =>
      list
        .map(
          (one) =>
            one.words +
            (one.limit
              ? `, stable ${one.above ? "up" : "down"} to about × ${text(one.limit, 2)}`
              : ""),
        )
        .join("; ");
    let said = "";
    if (unstable.length)
      said = `${begin === null ? "Unstable if linearised, though errors stay small here" : `Unstable from ${text(begin, 3)} s`}: ${words(unstable)} (by the loops linearised along the recorded run).`;
    else if (failure && moved.length && begin !== null)
      said = `Stopped at ${text(end, 3)} s with ${words(moved)}${moved.length > 1 && moved.every((one) => one.judged) ? "; each of them alone is stable" : ""}.`;
    this.failure.replaceChildren(
      ...(said ? [make("strong", {}, said)] : []),
      ...(failure ? [make(said ? "small" : "span", {}, failure)] : []),
    );
    this.failure.hidden = !said && !failure;
    view.change(
      "marks",
      begin === null || !(said || failure)
        ? []
        : [{ time: begin, words: unstable.length ? "unstable" : "stopped" }],
    );
  }

  show(found) {
    simulated.result = found;
    view.dispatchEvent(new Event("simulated"));
  }

  /** Hold the page's own run against the recorded one. */
  judge(found, failure) {
    const { position, limit } = failure ? {} : difference(this.of.simulation, found),
      passed = position <= limit,
      { unit, note, doubt } = this.of.simulation.recorded,
      why = note || (passed ? "" : doubt);
    this.apart = position;
    this.verdict.replaceChildren(
      make(
        "li",
        { class: passed ? "good" : "failed" },
        make("b", {}, passed ? "good" : "failed"),
        " The page's own run equals the recorded one ",
        make(
          "small",
          {},
          failure ||
            `with all sliders at 1, they differ by ${text(position, 2)} ${unit} at most in the rows that the page has in double precision; limit ${text(limit, 2)} ${unit}${why && `. ${why}`}`,
        ),
      ),
    );
  }

  tabulate(found, failure) {
    const until = failure && found.time.length ? found.time.at(-1) : Infinity,
      part = until < Infinity ? ` to ${text(until, 3)} s` : "";
    const before = peaksOf(this.of, until),
      after = found.time.length
        ? peaksOf({ ...this.of, result: found }, until)
        : before.map(() => ({ value: NaN }));
    const cell = ({ value, joint, unit }, most) =>
      make(
        "td",
        {},
        quantity(value, unit, most),
        ...(joint ? [make("small", {}, ` joint ${joint}`)] : []),
      );
    this.results.hidden = !before.length;
    this.results.replaceChildren(
      make(
        "thead",
        {},
        make(
          "tr",
          {},
          ...[`Largest${part}`, "recorded", "simulated", "change"].map((head) =>
            make("th", { scope: "col" }, head),
          ),
        ),
      ),
      make(
        "tbody",
        {},
        ...before.map((was, k) =>
          make(
            "tr",
            {},
            make("th", { scope: "row" }, was.words),
            cell(was),
            cell(after[k], was.value),
            make("td", {}, changeOf(was.value, after[k].value)),
          ),
        ),
      ),
    );
  }
}

const WORSE = 2; // times its largest error in the recorded run that a joint is off when it has left the motion

/** Time from which on a joint of a run is further off than ever in another run; null if it never is. */
function departure(run, other) {
  const times = run.figures
    .filter(({ key }) => key.startsWith("tracking."))
    .flatMap((figure) => {
      const { time, values } = rowsOf(figure, run.result),
        limits = rowsOf(figure, other.result).values.map((row) => WORSE * largest(row));
      return values.map(
        (row, joint) => time[row.findIndex((value) => Math.abs(value) > limits[joint])] ?? Infinity,
      );
    });
  const first = Math.min(Infinity, ...times);
  return first < Infinity ? first : null;
}

/** Largest absolute values of the figures of a run up to a time, and of the error of its end effector. */
export function peaksOf(run, until = Infinity) {
  const peak = ({ time, values }) =>
    largest(until < time.at(-1) ? values.filter((_, k) => time[k] <= until) : values);
  const found = run.figures
    .filter((figure) => figure.peak)
    .map((figure) => {
      const { time, values } = rowsOf(figure, run.result),
        peaks = values.map((row, k) => (figure.curves[k][2] ? 0 : peak({ time, values: row })));
      const value = largest(peaks);
      return {
        words: figure.peak,
        unit: figure.unit,
        value,
        joint: value ? figure.curves[peaks.indexOf(value)][1] : 0,
      };
    });
  if (run.arm && run.frames.error)
    found.push({ words: "Error of the end effector", unit: "mm", value: peak(toolErrors(run)) });
  return found;
}

/** Fill the section of the simulation: sliders, and why runs without them have none. */
export function showSimulation(section) {
  const able = recorded.filter((run) => run.simulation?.units),
    others = recorded.filter((run) => run.simulation?.reason);
  section.hidden = !able.length && !others.length;
  const simulation = able.length ? new Simulation(section, able) : null;
  if (!able.length) section.append(make("h2", {}, "Simulate"));
  section.append(
    ...others.map((run) =>
      make(
        "p",
        { class: "note" },
        recorded.length > 1 ? `${run.name}: ${run.simulation.reason}` : run.simulation.reason,
      ),
    ),
  );
  return simulation;
}
