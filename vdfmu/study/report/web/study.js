// Put the part of a study together: above the run that the page can simulate, if there is one.

import { study } from "./data.js";
import { showLab } from "./lab.js";
import { watchScrollers } from "./scrollers.js";

globalThis.report = {
  ...globalThis.report,
  lab: showLab(document.getElementById("lab"), study, globalThis.report?.simulation ?? null),
};
watchScrollers();
