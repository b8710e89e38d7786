// The page of a view that has words alone: it loads the next page when there is one.

import { hearServer } from "./server.js";

hearServer();
