// The libraries: `vendor`, with those of three_uplot.min.js.

import { unzip } from "./packed.js";

const libraries = document.createElement("script");
libraries.textContent = await unzip(document.getElementById("vendor").textContent).text();
document.head.append(libraries);
