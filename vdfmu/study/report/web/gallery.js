// The list of runs in a folder.

import { sortTables } from "./sort.js";

sortTables();
