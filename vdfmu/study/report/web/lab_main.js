// Put the page of a study together that simulates nothing.

import { study } from "./data.js";
import { showLab } from "./lab.js";

globalThis.report = { lab: showLab(document.getElementById("lab"), study, null) };
