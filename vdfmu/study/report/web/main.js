// Put the page together.

import { binaries, curvesOf, recorded, runs, study, view } from "./data.js";
import { Chain, Motion, toolErrors } from "./arm.js";
import { differences, showComparison } from "./comparison.js";
import { showFigures } from "./figures.js";
import { showLab } from "./lab.js";
import { Player } from "./player.js";
import { showSimulation } from "./simulation.js";
import { showSystem } from "./system.js";
import { SimulationWorker, difference } from "./worker.js";

const section = (id) => document.getElementById(id);
view.time = view.full()[0];
const places = [...runs.keys()].filter((k) => runs[k].arm && runs[k].frames.error);
const more = places.length
  ? [{
    title: "Error of the end effector", unit: "mm",
    curves: () => places.map((k) => ({ label: "distance", joint: 0, colour: 1, dashed: false, run: k, ...toolErrors(runs[k]) })),
  }]
  : [];
const player = recorded.some((run) => run.arm) ? new Player(section("arm")) : null;
const charts = showFigures(section("figures"), more);
const simulation = showSimulation(section("simulate"));
showSystem(section("system"));
showComparison(section("comparison"));
const lab = study ? showLab(section("lab"), study, simulation) : null;

/** For the console and for tests; what is around the page hears when it is there. */
globalThis.report = { binaries, charts, curvesOf, difference, differences, lab, player, runs, simulation, view, Chain, Motion, SimulationWorker, toolErrors };
dispatchEvent(new Event("report"));
