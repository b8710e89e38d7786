// The panel that simulates: sliders, the page's own run, and what it found beside what was recorded.

import { binaries, choice, make, NOTHING, recorded, rowsOf, simulated, text, toggle, view } from "./data.js";
import { toolErrors } from "./arm.js";
import { SimulationWorker, difference } from "./worker.js";

const NOTCHES = 100; // of a slider to either side
const PATIENCE = 1000; // ms; a run that takes longer is stopped for a newer one

/** A slider of factors around 1, for all joints and for each. */
class Knob {
  constructor(knob, changed) {
    Object.assign(this, { knob, places: Array(knob.values.length + 1).fill(0), chosen: 0, known: false });
    this.output = make("output");
    this.slider = make("input", { type: "range", min: -NOTCHES, max: NOTCHES, "aria-label": knob.words,
      input: () => { this.places[this.chosen] = Number(this.slider.value); this.show(); changed(); },
      dblclick: () => { this.slider.value = 0; this.slider.dispatchEvent(new Event("input")); } });
    const joints = knob.values.length > 1 ? [choice("", [[0, "all joints"], ...knob.values.map((_, i) => [i + 1, `joint ${i + 1}`])], (k) => { this.chosen = Number(k); this.show(); })] : [];
    joints[0]?.querySelector("select").setAttribute("aria-label", `${knob.words}: joint`);
    const known = knob.known.length ? [toggle("feedforward knows it", false, (on) => { this.known = on; changed(); }, { class: "chip", "aria-label": `${knob.words}: the feedforward knows it` })] : [];
    this.element = make("div", { class: "knob" }, make("span", {}, knob.words), this.output, this.slider, make("div", { class: "chips" }, ...joints, ...known));
    this.show();
  }

  /** Factor of a place of the slider, with three digits. */
  factor(place) {
    const { least, most } = this.knob, share = Math.abs(place) / NOTCHES;
    return Number((place > 0 ? most ** share : least ? least ** share : 1 - share).toPrecision(3));
  }

  show() {
    const [all, ...own] = this.places.map((place) => this.factor(place)), { values, units } = this.knob, joint = this.chosen - 1;
    const found = values.map((value, i) => all * own[i] * value), one = joint >= 0 ? found[joint] : found.every((value, i) => value === found[0] && units[i] === units[0]) ? found[0] : null;
    this.slider.value = this.places[this.chosen];
    this.output.textContent = `× ${text(joint < 0 ? all : all * own[joint], 3)}${one === null ? "" : ` = ${text(one, 4)} ${units[Math.max(joint, 0)]}`}`;
    this.slider.setAttribute("aria-valuetext", this.output.textContent.replace("×", "times"));
    this.element.querySelectorAll("option").forEach((option, k) => { option.textContent = `${k ? `joint ${k}` : "all joints"}${this.places[k] ? ` × ${text(this.factor(this.places[k]), 3)}` : ""}`; });
  }

  reset() {
    this.places.fill(0);
    this.show();
  }

  /** Changes of the parameters of units, by their full names. */
  changes({ units }) {
    const { targets, known } = this.knob, [all, ...own] = this.places.map((place) => this.factor(place));
    return own.flatMap((factor, i) => (all * factor === 1 ? [] : [...targets, ...(this.known ? known : [])].flatMap(({ unit, name }) =>
      Object.keys(units.find((one) => one.name === unit).parameters)
        .filter((one) => one === name || one.startsWith(`${name}[${i + 1}]`) || one.startsWith(`${name}[${i + 1},`))
        .map((one) => ({ unit, name: one, factor: all * factor })))));
  }
}

class Simulation {
  constructor(section, able) {
    Object.assign(this, { worker: new SimulationWorker(binaries), busy: false, again: false, given: [] });
    this.status = make("p", { class: "note", role: "status" });
    this.bar = make("progress", { max: 1, "aria-label": "Progress of the simulation" });
    this.verdict = make("ul");
    this.failure = make("p", { class: "failure", role: "alert", hidden: true });
    this.knobs = make("div", { class: "knobs" });
    this.results = make("table");
    section.append(
      make("div", { class: "bar" }, make("h2", {}, "Simulate"), ...(able.length > 1 ? [choice("Run", able.map((run, k) => [k, run.name]), (k) => this.choose(able[k]))] : []), make("button", { type: "button", click: () => this.reset() }, "Reset"), this.status, this.bar),
      make("p", { class: "note" }, "Move a slider: this browser runs the C of the FMUs again, and draws the simulated run over the recorded one. A double click puts a slider back."),
      this.knobs, this.failure, make("div", { class: "found" }, this.results, make("div", { class: "checks" }, this.verdict)),
    );
    this.choose(able[0], false);
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
    this.before = null;
    view.change("run", run);
    this.sliders = run.simulation.knobs.map((knob) => new Knob(knob, () => this.rerun()));
    this.knobs.replaceChildren(...this.sliders.map(({ element }) => element));
    if (start) this.rerun();
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
    if (this.busy) {
      this.stopping ??= setTimeout(() => this.worker.cancel(), PATIENCE + this.began - performance.now());
      return;
    }
    this.busy = true;
    this.bar.classList.add("on");
    while (this.again) {
      this.again = false;
      const changes = this.changes(), { of } = this;
      this.bar.value = 0;
      this.began = performance.now();
      const run = this.worker.run(of.simulation, changes, (part) => { this.bar.value = part; });
      const [found, error] = await run.then((one) => [one, null], (one) => [one.found ?? NOTHING, one]);
      this.stopping = clearTimeout(this.stopping);
      if (error?.name !== "AbortError" && of === this.of) this.take(found, changes, error?.message);
    }
    this.busy = false;
    this.bar.classList.remove("on");
  }

  /** Show what a run found, up to its failure if it has failed. */
  take(found, changes, failure = "") {
    const { time } = found, { stop, start } = this.of.simulation;
    this.failure.textContent = failure;
    this.failure.hidden = !failure;
    this.status.textContent = failure ? `Stopped${time.length ? ` at ${text(time.at(-1), 4)} s` : ""}.` : `${text(stop - start, 4)} s simulated in ${text(found.seconds, 2)} s.`;
    if (!changes.length) this.judge(found, failure);
    this.tabulate(found);
    this.show(changes.length ? found : NOTHING);
  }

  show(found) {
    simulated.result = found;
    view.dispatchEvent(new Event("simulated"));
  }

  /** Hold the page's own run against the recorded one. */
  judge(found, failure) {
    const { position, limit } = failure ? {} : difference(this.of.simulation, found), passed = position <= limit, { unit, note, doubt } = this.of.simulation.recorded, why = note || (passed ? "" : doubt);
    this.apart = position;
    this.verdict.replaceChildren(make("li", { class: passed ? "pass" : "fail" }, make("b", {}, passed ? "pass" : "fail"), " The page's own run equals the recorded one ",
      make("small", {}, failure || `with all sliders at 1, they differ by ${text(position, 2)} ${unit} at most in the rows that the page has in double precision; limit ${text(limit, 2)} ${unit}${why && `. ${why}`}`)));
  }

  tabulate(found) {
    this.before ??= peaksOf(this.of);
    const { before } = this, after = found.time.length ? peaksOf({ ...this.of, result: found }) : before.map(() => ({ value: NaN }));
    const cell = ({ value, joint }) => make("td", {}, text(value, 3), ...(joint ? [make("small", {}, ` joint ${joint}`)] : []));
    this.results.replaceChildren(make("thead", {}, make("tr", {}, ...["Largest", "recorded", "simulated", "change"].map((head) => make("th", { scope: "col" }, head)))),
      make("tbody", {}, ...before.map((was, k) => make("tr", {}, make("th", { scope: "row" }, was.words, make("small", {}, ` ${was.unit}`)), cell(was), cell(after[k]), make("td", {}, changeOf(was.value, after[k].value))))));
  }
}

/** Largest absolute values of the figures of a run, and of the error of its end effector. */
export function peaksOf(run) {
  const largest = (values) => values.reduce((most, value) => Math.max(most, Math.abs(value)), 0);
  const found = run.figures.filter(({ peak }) => peak).map((figure) => {
    const peaks = rowsOf(figure, run.result).values.map((values, k) => (figure.curves[k][2] ? 0 : largest(values)));
    const value = largest(peaks);
    return { words: figure.peak, unit: figure.unit, value, joint: value ? figure.curves[peaks.indexOf(value)][1] : 0 };
  });
  if (run.arm && run.frames.error) found.push({ words: "Error of the end effector", unit: "mm", value: largest(toolErrors(run).values) });
  return found;
}

export function changeOf(before, after) {
  const ratio = after / before;
  if (!Number.isFinite(ratio)) return "–";
  if (Math.abs(ratio - 1) < 1e-6) return "none";
  return ratio >= 2 || ratio <= 0.5 ? `× ${text(ratio, 3)}` : `${ratio > 1 ? "+" : ""}${text(100 * (ratio - 1), 2)} %`;
}

/** Fill the section of the simulation: sliders, and why runs without them have none. */
export function showSimulation(section) {
  const able = recorded.filter((run) => run.simulation?.units), others = recorded.filter((run) => run.simulation?.reason);
  section.hidden = !able.length && !others.length;
  const simulation = able.length ? new Simulation(section, able) : null;
  if (!able.length) section.append(make("h2", {}, "Simulate"));
  section.append(...others.map((run) => make("p", { class: "note" }, recorded.length > 1 ? `${run.name}: ${run.simulation.reason}` : run.simulation.reason)));
  return simulation;
}
