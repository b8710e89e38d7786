// The libraries, which the page has compressed: three.js and uPlot, as requirements/web/vendor.js chooses from them.

import { unzip } from "./packed.js";

const libraries = document.createElement("script");
libraries.textContent = await unzip(document.getElementById("vendor").textContent).text();
document.head.append(libraries);

/** @type {any} */
export const vendor = globalThis["vendor"];
