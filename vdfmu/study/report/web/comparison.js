// What runs do differently: a figure for each joint with the runs over each other, or their difference.

import {
  bar,
  choice,
  COLOURS,
  curvesOf,
  make,
  merged,
  placeAt,
  recorded,
  runs,
  simulated,
  toggle,
} from "./data.js";
import { Chart } from "./chart.js";

const LEAST = 50; // common times, of which a difference needs no values between rows

/** Curves whose colour is that of their run; dashes are for what is desired alone. */
class RunsChart extends Chart {
  dashOf({ dashed }) {
    return dashed ? [5, 4] : [];
  }
}

/** Fill the section of a page of several runs. */
export function showComparison(section) {
  if (!section) return;
  const figures = [...merged("figures")];
  if (!figures.length) return;
  const others = recorded.slice(1);
  const grid = make("div", { class: "grid triple" });
  let key = figures.find(([one]) => one.startsWith("tracking."))?.[0] ?? figures[0][0],
    apart = false;
  const show = () => grid.replaceChildren(...chartsOf(key, apart).map(({ element }) => element));
  const chosen = choice(
    "Joint by joint",
    figures.map(([one, { title }]) => [one, title]),
    (one) => {
      key = one;
      show();
    },
    key,
  );
  section.querySelector(".tables").before(
    bar(
      chosen,
      toggle(
        others.length > 1 ? `minus ${recorded[0].name}` : `${others[0].name} − ${recorded[0].name}`,
        false,
        (on) => {
          apart = on;
          show();
        },
      ),
      legend(),
    ),
    grid,
  );
  show();
}

function legend() {
  const style = (k) => `background:var(--joint-${(k % COLOURS) + 1})`;
  return make(
    "div",
    { class: "keys" },
    ...recorded.map(({ name }, k) => make("span", {}, make("i", { style: style(k) }), name)),
  );
}

function chartsOf(key, apart) {
  const { unit } = merged("figures").get(key),
    of = () => curvesOf("figures", key).filter(({ run }) => runs[run] !== simulated);
  const joints = [...new Set(of().map(({ joint, label }) => joint || label))];
  return joints.map((joint) => {
    const mine = () =>
      of()
        .filter((curve) => (curve.joint || curve.label) === joint)
        .map(ofRun);
    const words = typeof joint === "number" ? `Joint ${joint}` : joint;
    return new RunsChart(words, unit, () => (apart ? differences(mine()) : mine()));
  });
}

/** A curve as that of its run: its name, its colour. What is desired is drawn once, that of the first run. */
function ofRun(curve) {
  return {
    ...curve,
    joint: 0,
    label: curve.dashed ? curve.label.replace(/^joint \d+, /, "") : runs[curve.run].name,
    colour: curve.run + 1,
  };
}

/** The solid curves minus the first, at the times that both have: where these are few, A between its rows. */
export function differences(curves) {
  const [first, ...others] = curves.filter(({ dashed }) => !dashed);
  const last = first ? first.time.length - 1 : -1,
    at = new Map(Array.from(first?.time ?? [], (t, k) => [t.toFixed(9), k]));
  return others.map((curve) => {
    const common = [...curve.time.keys()].filter((k) => at.has(curve.time[k].toFixed(9)));
    const rows =
      common.length >= LEAST
        ? common
        : [...curve.time.keys()].filter(
            (k) => curve.time[k] >= first.time[0] && curve.time[k] <= first.time[last],
          );
    const base = (t) => {
      const [k, share] = placeAt(first.time, t),
        row = at.get(t.toFixed(9));
      if (row !== undefined) return first.values[row];
      return (1 - share) * first.values[k] + share * first.values[k + 1];
    };
    return {
      ...curve,
      time: Float64Array.from(rows, (k) => curve.time[k]),
      values: Float64Array.from(rows, (k) => curve.values[k] - base(curve.time[k])),
    };
  });
}
