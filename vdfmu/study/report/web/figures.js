// The figures of the runs, with one selector of joints and one zoom for all.

import { colourOf, curvesOf, make, merged, recorded, runs, simulated, toggle, view } from "./data.js";
import { Chart } from "./chart.js";

/** Fill the section of the figures; `more` are figures that the page has calculated. */
export function showFigures(section, more) {
  const several = recorded.length > 1; // then dashes are for the runs, and what is desired is not drawn
  const charts = [...merged("figures")].map(([key, { title, unit }]) => new Chart(several ? title.replace(/, [^,]*dashed/, "") : title, unit,
    () => curvesOf("figures", key).filter(({ dashed }) => !several || !dashed)));
  charts.push(...more.map(({ title, unit, curves }) => new Chart(title, unit, curves)));
  if (!charts.length) return charts;
  section.hidden = false;
  section.append(
    make("div", { class: "bar sticky" }, make("h2", {}, "Figures"), jointChips(), ...runChips(), zoomButtons()),
    make("p", { class: "note" }, "Drag across a figure to zoom, or use + and −; double-click to see all. Point to read values" + (runs.some((run) => run.arm) ? ", click to move the arm there. " : ". ")
      + "Values are those of recorded rows; no peak is left out."),
    make("div", { class: "grid" }, ...charts.map((chart) => chart.element)),
  );
  return charts;
}

function jointChips() {
  const count = Math.max(0, ...runs.flatMap((run) => run.figures.flatMap((figure) => figure.curves.map(([, joint]) => joint))));
  const chips = Array.from({ length: count }, (_, i) =>
    toggle(String(i + 1), true, (on) => view.show("hiddenJoints", i + 1, on), { class: "chip", "aria-label": `Joint ${i + 1}`, style: `--chip:${colourOf(i + 1)}` }));
  return make("div", { class: "chips", role: "group", "aria-label": "Joints shown" }, make("span", {}, "Joints"), ...chips);
}

function runChips() {
  if (runs.length < 2) return [];
  const chips = runs.map((run, k) => toggle(run.name, true, (on) => view.show("hiddenRuns", k, on), { class: `chip run${run === simulated ? " second" : k % 4}` }));
  const words = make("span"), group = make("div", { class: "chips", role: "group", "aria-label": "Runs shown" }, words, ...chips);
  const offer = () => {
    const pale = simulated.result.time.length > 0;
    words.textContent = pale ? "Runs, recorded pale" : "Runs";
    chips.forEach((chip, k) => { chip.hidden = runs[k] === simulated && !pale; });
    group.hidden = chips.filter((chip) => !chip.hidden).length < 2;
  };
  view.addEventListener("simulated", offer);
  offer();
  return [group];
}

function zoomButtons() {
  const zoom = (factor) => () => {
    const [first, last] = view.full();
    const [min, max] = view.range ?? [first, last];
    const centre = view.time > min && view.time < max ? view.time : (min + max) / 2;
    const range = [Math.max(first, centre - factor * (centre - min)), Math.min(last, centre + factor * (max - centre))];
    view.change("range", range[0] <= first && range[1] >= last ? null : range);
  };
  const button = (label, name, click) => make("button", { type: "button", "aria-label": name, title: name, click }, label);
  return make("div", { class: "chips" }, button("+", "Zoom in on the time shown", zoom(0.5)), button("−", "Zoom out", zoom(2)),
    button("All", "Show the whole run", () => view.change("range", null)));
}
