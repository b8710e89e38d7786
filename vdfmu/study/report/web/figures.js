// The figures of the runs, with one selector of joints and one zoom for all.

import {
  button,
  COLOURS,
  curvesOf,
  make,
  merged,
  recorded,
  runs,
  simulated,
  toggle,
  view,
} from "./data.js";
import { Chart } from "./chart.js";
import { happened } from "./events.js";

/** Fill the section of the figures; `more` are calculated ones, for beside the tracking errors: key, title, unit and a function that gives the curves. */
export function showFigures(section, more) {
  const several = recorded.length > 1; // then dashes are for the runs, and what is desired is not drawn
  const packed = [...merged("figures")].map(([key, { title, unit }]) => ({
    key,
    unit,
    title: several ? title.replace(/, [^,]*dashed/, "") : title,
    curves: () => curvesOf("figures", key).filter(({ dashed }) => !several || !dashed),
  }));
  const place = 1 + packed.findLastIndex(({ key }) => key.startsWith("tracking."));
  const charts = packed
    .toSpliced(place || packed.length, 0, ...more)
    .map(({ key, title, unit, curves }) => {
      const chart = new Chart(title, unit, curves);
      chart.element.dataset.figure = key; // by which tiles and addresses find it
      return chart;
    });
  if (!charts.length) return charts;
  section.hidden = false;
  section.append(
    make(
      "div",
      { class: "bar sticky" },
      make("h2", {}, "Figures"),
      jointChips(),
      ...runChips(),
      zoomButton(),
    ),
    make("div", { class: "grid" }, ...charts.map((chart) => chart.element)),
    make(
      "p",
      { class: "note" },
      "Drag across a figure to zoom; double-click to see all. Point to read values" +
        (runs.some((run) => run.arm) ? ", click to move the arm there. " : ". ") +
        "Values are those of recorded rows; all peaks are shown." +
        (happened() ? " Thin vertical lines, or ticks where they are many, are events." : ""),
    ),
  );
  return charts;
}

function jointChips() {
  const count = Math.max(
    0,
    ...runs.flatMap((run) =>
      run.figures.flatMap((figure) => figure.curves.map(([, joint]) => joint)),
    ),
  );
  if (!count) return "";
  const chips = Array.from({ length: count }, (_, i) => jointChip(i + 1, count));
  view.addEventListener("shown", () =>
    chips.forEach((chip, i) =>
      chip.setAttribute("aria-pressed", String(!view.hiddenJoints.has(i + 1))),
    ),
  );
  return make(
    "div",
    { class: "chips", role: "group", "aria-label": "Joints shown" },
    make("span", {}, "Joints"),
    ...chips,
  );
}

/** Hides a joint and shows it again; pointed to, the others fade; with Alt or twice it shows this one alone. */
function jointChip(joint, count) {
  const focus = (one) => () => view.change("focus", one),
    alone = () => view.isolate(joint, count);
  return button(
    String(joint),
    ({ altKey }) =>
      altKey ? alone() : view.show("hiddenJoints", joint, view.hiddenJoints.has(joint)),
    {
      class: "chip",
      "aria-pressed": "true",
      "aria-label": `Joint ${joint}`,
      style: `--chip:var(--joint-${((joint - 1) % COLOURS) + 1})`,
      title: `A click hides joint ${joint}; a double click, or Alt and Enter, shows it alone`,
      dblclick: alone,
      mouseenter: focus(joint),
      mouseleave: focus(null),
      focus: focus(joint),
      blur: focus(null),
    },
  );
}

function runChips() {
  if (runs.length < 2) return [];
  const chips = runs.map((run, k) =>
    toggle(run.name, true, (on) => view.show("hiddenRuns", k, on), {
      class: `chip run${run === simulated ? " second" : k % 4}`,
    }),
  );
  const words = make("span"),
    group = make(
      "div",
      { class: "chips", role: "group", "aria-label": "Runs shown" },
      words,
      ...chips,
    );
  const offer = () => {
    const pale = simulated.result.time.length > 0;
    words.textContent = pale ? "Runs, recorded pale" : "Runs";
    chips.forEach((chip, k) => {
      chip.hidden = runs[k] === simulated && !pale;
    });
    group.hidden = chips.filter((chip) => !chip.hidden).length < 2;
  };
  view.addEventListener("simulated", offer);
  offer();
  return [group];
}

/** Ends a zoom. */
function zoomButton() {
  const title = "Show the whole run",
    all = button("All", () => view.change("range", null), { title, hidden: true });
  view.addEventListener("range", () => {
    all.hidden = !view.range;
  });
  return all;
}
