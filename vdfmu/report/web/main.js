// Put the page together.

import { binaries, runs, unpack, view } from "./data.js";
import { Chain, Motion, toolErrors } from "./arm.js";
import { showFigures } from "./figures.js";
import { Player } from "./player.js";
import { showSystem } from "./system.js";
import { SimulationWorker, difference } from "./worker.js";

const section = (id) => document.getElementById(id);
view.time = view.full()[0];
const arms = runs.flatMap((run, k) => (run.arm && run.frames.error ? [k] : []));
const more = arms.length
  ? [{
    title: "Error of the end effector", unit: "mm",
    curves: () => arms.map((k) => ({ label: "distance", joint: 0, colour: 1, dashed: false, run: k, time: unpack(runs[k].frames.time, Float64Array), values: toolErrors(runs[k]) })),
  }]
  : [];
const player = runs.some((run) => run.arm) ? new Player(section("arm")) : null;
const charts = showFigures(section("figures"), more);
showSystem(section("system"));

/** For the console and for tests. */
globalThis.report = { binaries, charts, difference, player, runs, view, Chain, Motion, SimulationWorker, toolErrors };
