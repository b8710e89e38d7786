// Put the page together.

import { binaries, curvesOf, make, recorded, runs, view } from "./data.js";
import { Chain, Motion, toolErrors } from "./arm.js";
import { differences, showComparison } from "./comparison.js";
import { showFigures } from "./figures.js";
import { quantity } from "./numbers.js";
import { Player } from "./player.js";
import { watchScrollers } from "./scrollers.js";
import { commandOf, follow, pictureButton, shareButtons } from "./share.js";
import { showSimulation } from "./simulation.js";
import { FILES } from "./save.js";
import { sortTables } from "./sort.js";
import { recalled, remember, whenRecalled } from "./state.js";
import { showSystem } from "./system.js";
import { SimulationWorker, difference } from "./worker.js";
import { check } from "./verdict.js";

const section = (id) => document.getElementById(id);
view.time = view.full()[0];
const places = [...runs.keys()].filter((k) => runs[k].arm && runs[k].frames.error);
const more = places.length
  ? [
      {
        key: "tool",
        title: "Error of the end effector",
        unit: "mm",
        curves: () =>
          places.map((k) => ({
            label: "distance",
            joint: 0,
            colour: 0,
            dashed: false,
            run: k,
            ...toolErrors(runs[k]),
          })),
      },
    ]
  : [];
const player = recorded.some((run) => run.arm) ? new Player(section("arm")) : null;
const charts = showFigures(section("figures"), more);
const simulation = showSimulation(section("simulate"), section("found"));
showSystem(section("system"));
showComparison(section("comparison"));
sortTables();
watchScrollers();

const title = document.querySelector("h1"),
  top = make("div", { class: "title" });
title.replaceWith(top);
top.append(title, shareButtons(simulation));
if (player?.tools) player.tools.prepend(pictureButton(player));

/** Show the time, and the figure, that the address has. */
function recall() {
  const [first, last] = view.full(),
    time = Number(recalled("t") ?? NaN);
  view.change("time", Number.isFinite(time) ? Math.min(Math.max(time, first), last) : first);
  if (recalled("figure")) follow({ dataset: { figure: recalled("figure") } }, charts);
}
for (const tile of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll(".tile"))) {
  tile.addEventListener("click", () => {
    follow(tile, charts);
    remember("figure", tile.dataset.figure);
  });
}
view.addEventListener("time", () => {
  if (!player?.playing)
    remember("t", view.time === view.full()[0] ? null : Number(view.time.toPrecision(6)));
});
whenRecalled(recall);
if (recalled("t") || recalled("figure")) recall();

/** For the console and for tests; what is around the page hears when it is there. */
globalThis.report = {
  binaries,
  charts,
  curvesOf,
  difference,
  differences,
  player,
  quantity,
  runs,
  simulation,
  view,
  Chain,
  FILES,
  Motion,
  check,
  commandOf,
  SimulationWorker,
  toolErrors,
};
dispatchEvent(new Event("report"));
