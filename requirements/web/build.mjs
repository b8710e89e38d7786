// Pack three.js and uPlot, at the versions and hashes of package-lock.json, into the package with their licences.
import { createHash } from "node:crypto";
import { readFileSync, writeFileSync } from "node:fs";
import { build } from "esbuild";

const target = new URL("../../vdfmu/study/report/web/", import.meta.url);
const read = (path) => readFileSync(new URL(`node_modules/${path}`, import.meta.url), "utf8");
const packages = Object.keys(JSON.parse(readFileSync(new URL("package.json", import.meta.url))).dependencies);
const versions = Object.fromEntries(packages.map((name) => [name, JSON.parse(read(`${name}/package.json`)).version]));
const licences = packages.map((name) => `${name} ${versions[name]}\n\n${read(`${name}/LICENSE`).trim()}`).join("\n\n\n");

const { outputFiles } = await build({
  entryPoints: [new URL("entry.js", import.meta.url).pathname],
  bundle: true, minify: true, write: false, format: "iife", globalName: "vendor", target: "es2022", legalComments: "none",
  banner: { js: `/*!\n${licences}\n*/` },
});
const files = { "three_uplot.min.js": outputFiles[0].text, "uplot.min.css": `/*! uPlot ${versions.uplot}, MIT */\n${read("uplot/dist/uPlot.min.css").trim()}\n` };
const sha256 = {};
for (const [name, text] of Object.entries(files)) {
  writeFileSync(new URL(name, target), text);
  sha256[name] = createHash("sha256").update(text).digest("hex");
}
writeFileSync(new URL("vendor.json", target), `${JSON.stringify({ versions, sha256 }, null, 2)}\n`);
