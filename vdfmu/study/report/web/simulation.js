// The panel that simulates: sliders, the page's own run, and its results next to the recorded ones.

import {
  bar,
  binaries,
  button,
  choice,
  make,
  names,
  NOTHING,
  recorded,
  simulated,
  view,
} from "./data.js";
import { recalled, remember, whenRecalled } from "./state.js";
import { Slider } from "./slider.js";
import { Budget } from "./budget.js";
import { keyFigures } from "./key_figures.js";
import { listed, showTiles, tell } from "./outcome.js";
import { commandOf } from "./share.js";
import { judge } from "./verdict.js";
import { SimulationWorker, difference } from "./worker.js";
import { quantity, text } from "./numbers.js";

const PATIENCE = 1000; // ms; a run that takes longer is stopped for a newer one

const TOGETHER = 700; // ms in which changes of one slider are a single step of Undo

class Simulation {
  /** `section` has the sliders and the message, `found` the tables below the figures. */
  constructor(section, found, able) {
    this.worker = new SimulationWorker(binaries);
    this.busy = false;
    this.again = false;
    this.given = [];
    this.zoomed = null;
    this.status = make("p", { class: "note", role: "status" });
    this.bar = make("progress", { max: 1, "aria-label": "Progress of the simulation" });
    this.equal = make("ul");
    this.judged = make("ul");
    this.failure = make("div", { class: "failure", role: "alert", hidden: true });
    this.detail = make("p", { class: "failure", hidden: true });
    this.moment = 0;
    this.back = button("Reset", () => this.reset());
    this.undone = button("Undo", () => this.undo(), {
      title: "Undo the last change of a slider",
    });
    this.legend = make("p", { class: "note" });
    this.board = make("div", { class: "sliders" });
    this.joint = choice("", [], (k) => this.chooseJoint(Number(k)));
    this.joint.firstChild.setAttribute("aria-label", "Joint of the sliders");
    section.append(
      bar(
        make("h2", {}, "Simulate"),
        able.length > 1 && choice("Run", names(able), (k) => this.choose(able[k])),
        this.joint,
        this.back,
        this.undone,
        this.status,
        this.bar,
      ),
      make("div", { class: "said" }, this.failure, this.legend),
      this.board,
    );
    found.append(
      make("h2", {}, "Simulated and recorded"),
      make(
        "p",
        { class: "note" },
        "This browser runs the equations of the FMUs again when a slider moves. A double click resets a slider.",
      ),
      this.detail,
      make("div", { class: "checks" }, this.equal),
      make(
        "div",
        { class: "checks", hidden: true },
        make("h3", {}, "Checks, simulated"),
        this.judged,
      ),
    );
    this.budget = new Budget(found);
    section.hidden = found.hidden = false;
    const { style } = document.documentElement; // a figure that is asked for stays below the panel
    new ResizeObserver(() => style.setProperty("--panel", `${section.offsetHeight}px`)).observe(
      section,
    );
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
    const { sliders, rows, why } = run.simulation;
    this.sliders = sliders.map((parameter) => new Slider(parameter, rows, () => this.rerun()));
    this.board.replaceChildren(...this.sliders.map(({ element }) => element));
    const joints = Math.max(0, ...sliders.map(({ values }) => values.length));
    this.joint.firstChild.replaceChildren(
      ...Array.from({ length: joints + 1 }, (_, k) => make("option", { value: k })),
    );
    this.joint.hidden = joints < 2;
    this.back.hidden = this.undone.hidden = !sliders.length;
    const tracks = sliders.map(({ track }) => track).filter(Boolean);
    this.tracked = why || tracks.length;
    const [margin, delay] = [rows.margin, rows.delay].map(({ value }) => text(value, 2)),
      good = `margin at least ${margin}, delay ${delay} ${delay === "1" ? "sample" : "samples"}`;
    this.legend.replaceChildren(
      ...(why
        ? [`No margins along the sliders: ${why}.`]
        : Object.entries({ good, fair: "less", poor: "none" }).map(([colour, words]) =>
            make("span", { class: "key" }, make("i", { class: colour }), words),
          )),
    );
    this.legend.title = `Modulus margin of the loops, linearised along the recorded run${tracks.some(({ still }) => still) ? " without its dry friction" : ""}, with this slider alone moved`;
    this.legend.hidden = !this.tracked;
    this.budget.of(run);
    this.recall();
    this.past = [];
    this.last = this.states();
    this.note();
    if (start || this.changes().length) this.rerun();
  }

  chooseJoint(k) {
    for (const slider of this.sliders) slider.choose(k);
  }

  /** Mark the joints that a slider has moved. */
  markJoints() {
    this.joint.querySelectorAll("option").forEach((option, k) => {
      const moved = this.sliders.some(({ places }) => places[k]);
      option.textContent = `${k ? `joint ${k}` : "all joints"}${moved ? ", moved" : ""}`;
    });
  }

  /** Set the sliders as the address has them. */
  recall() {
    for (const slider of this.sliders) slider.state = recalled(slider.parameter.key) ?? "";
    this.markJoints();
  }

  states() {
    return this.sliders.map(({ state }) => state);
  }

  /** Keep the sliders as they were before a change; a drag of one slider is one change. */
  note() {
    const states = this.states(),
      moved = states.map((state, k) => (state === this.last[k] ? "" : k)).join("_"),
      now = performance.now();
    if (states.some((state, k) => state !== this.last[k])) {
      if (moved !== this.moved || now - this.moment > TOGETHER) this.past.push(this.last);
      Object.assign(this, { last: states, moved, moment: now });
      if (String(states) === String(this.past.at(-1))) {
        this.past.pop(); // a drag back to where it began is no change
        this.moved = "";
      }
    }
    this.undone.disabled = !this.past.length;
  }

  /** Undo the last change of a slider. */
  undo() {
    this.last = this.past.pop();
    this.sliders.forEach((slider, k) => {
      slider.state = this.last[k];
    });
    this.moved = "";
    this.rerun();
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
    this.note();
    this.budget.cancel();
    for (const slider of this.sliders) remember(slider.parameter.key, slider.state);
    this.markJoints();
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
      { stop, start, recorded: own } = this.of.simulation;
    this.status.textContent = failure
      ? `Stopped${time.length ? ` at ${text(time.at(-1), 4)} s` : ""}.`
      : `${text(stop - start, 4)} s simulated in ${quantity(found.seconds, "s")}.`;
    if (!changes.length) this.judge(found, failure);
    this.equal.classList.toggle("other", changes.length > 0);
    this.show(changes.length ? found : NOTHING);
    this.explain(found, changes.length || own.ended ? failure : "", changes);
  }

  /** Judge the run, at the top, in the tiles and above the sliders; show in the figures when it failed. */
  explain(found, failure, changes) {
    const { of } = this,
      moved = this.sliders.flatMap((slider) => slider.moved()),
      run = { ...of, result: found },
      end = found.time.length ? found.time.at(-1) : null;
    const { loops, why } = this.loopsAt(moved),
      figures = end === null ? { end: 0 } : keyFigures(run, changes),
      verdict = changes.length
        ? judge(of.simulation, { figures, loops, why: this.told(why, changes), failure, end })
        : null;
    Object.assign(this, { verdict, figures: { ...figures, ...loops } });
    tell(of, verdict);
    showTiles(of, verdict && end !== null ? run : null, { ...figures, ...loops }, !failure);
    this.judged.replaceChildren(...(verdict ? listed(verdict) : []));
    this.judged.parentElement.hidden = !verdict;
    const unstable = loops?.unstable ?? (loops?.margin.value === 0 ? loops.margin : null),
      begin = unstable ? Math.min(unstable.at_s, end ?? 0) : end;
    let said = "";
    if (unstable || failure) {
      said = `${loops?.unstable ? "Unstable" : unstable ? "Without a margin" : "Stopped"} with ${moved.map(({ words }) => words).join("; ")}`;
      const { limit, above } = moved[0] ?? {};
      if (unstable && limit)
        said += `, stable ${above ? "up" : "down"} to about × ${text(limit, 2)}`;
      said += end === null ? `: ${failure}` : ".";
    }
    this.failure.textContent = said;
    this.failure.hidden = !said;
    this.legend.hidden = !!said || !this.tracked;
    this.detail.textContent = failure;
    this.detail.hidden = !failure;
    this.zoom(said ? begin : null, found.time.at(-1), failure);
    view.change(
      "marks",
      begin === null || !said ? [] : [{ time: begin, words: unstable ? "unstable" : "stopped" }],
    );
  }

  /** Key figures of the loops with these sliders moved, by the track of the one that is; else null, and why. */
  loopsAt(moved) {
    const { simulation } = this.of,
      [one] = moved;
    if (moved.length === 1 && !this.given.length && one.figures)
      return { loops: { ...simulation.figures, ...one.figures }, why: "" };
    let why = "a point is shown";
    if (simulation.why) why = simulation.why;
    else if (moved.length > 1) why = "several sliders are moved";
    else if (moved.length) why = "this slider has no track of margins";
    return { loops: null, why };
  }

  /** Why something is not judged, with the command that judges it. */
  told(why, changes) {
    const { command } = this.of;
    return command ? `${why}; this command judges it: ${commandOf(this.of, changes)}` : why;
  }

  /** Zoom in on the time at which a run began to fail, unless the reader has zoomed; null zooms out again. */
  zoom(begin, end, failure) {
    if (view.range && view.range !== this.zoomed) return;
    const [first, last] = view.full(),
      span = failure ? Math.max(end - begin, (last - first) / 100) : (last - first) / 10;
    this.zoomed =
      begin === null ? null : [Math.max(first, begin - 2 * span), Math.min(last, begin + 2 * span)];
    view.change("range", this.zoomed);
  }

  show(found) {
    simulated.result = found;
    view.dispatchEvent(new Event("simulated"));
  }

  /** Hold the page's own run against the recorded one; if that failed, this has to fail in the same step. */
  judge(found, failure) {
    const { recorded: own } = this.of.simulation,
      { position, limit } = difference(this.of.simulation, found),
      steps = Math.abs(found.time.length - 1 - own.rows.at(-1)),
      passed = own.ended ? !failure && position <= limit : steps <= 1,
      why = own.note || (passed ? "" : own.doubt);
    this.apart = position;
    let words = failure;
    if (!own.ended) words = `with all sliders at 1, they stop ${steps} steps apart`;
    else if (!failure)
      words = `with all sliders at 1, they differ by ${text(position, 2)} ${own.unit} at most in the rows that the page has in double precision; limit ${text(limit, 2)} ${own.unit}${why && `. ${why}`}`;
    this.equal.replaceChildren(
      make(
        "li",
        { class: passed ? "good" : "failed" },
        make("b", {}, passed ? "good" : "failed"),
        " The page's own run equals the recorded one ",
        make("small", {}, words),
      ),
    );
  }
}

/** Fill the sections of the simulation, and say among the facts why a run has no sliders. */
export function showSimulation(section, found) {
  const able = recorded.filter((run) => run.simulation?.units),
    others = recorded.filter((run) => run.simulation?.reason);
  document
    .getElementById("facts")
    ?.append(
      ...others.map((run) =>
        make(
          "p",
          { class: "note" },
          recorded.length > 1 ? `${run.name}: ${run.simulation.reason}` : run.simulation.reason,
        ),
      ),
    );
  return able.length ? new Simulation(section, found, able) : null;
}
