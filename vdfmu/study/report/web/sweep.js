// The page of a study with the run of its scenario, which simulates the chosen point.

import "./run.js";
import "./study.js";
