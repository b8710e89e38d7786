// Pack the scripts and styles of the pages, and the libraries at the versions of package-lock.json
// with their licences, into the package: node build.mjs [FOLDER].
import { createHash } from "node:crypto";
import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { basename, dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const PAGES = ["run.js", "sweep.js", "study.js", "robot.js", "gallery.js", "master.js"];
const STYLES = ["report.css", "arm_alone.css"];

const here = dirname(fileURLToPath(import.meta.url));
const web = resolve(here, "../../vdfmu/study/report/web");
const target = resolve(process.argv[2] ?? join(web, "../bundles"));
const read = (path) => readFileSync(join(here, "node_modules", path), "utf8");
const sha256 = (...texts) =>
  texts.reduce((hash, text) => hash.update(text), createHash("sha256")).digest("hex");

/** The packed text of an entry, and the files that are in it. */
async function pack(entry, more = {}) {
  const { outputFiles, metafile } = await build({
    entryPoints: [entry],
    bundle: true,
    minify: true,
    write: false,
    metafile: true,
    charset: "utf8",
    target: "es2022",
    legalComments: "none",
    ...more,
  });
  return {
    text: outputFiles[0].text,
    sources: Object.keys(metafile.inputs).map((path) => resolve(path)),
  };
}

mkdirSync(target, { recursive: true });

// Each begins with the digest of its sources, sorted by name, which a test without node holds.
for (const entry of [...PAGES, ...STYLES]) {
  const { text, sources } = await pack(join(web, entry), {
    format: entry === "master.js" ? "iife" : "esm",
  });
  const named = sources.sort().flatMap((path) => [`${basename(path)}\n`, readFileSync(path)]);
  writeFileSync(join(target, entry), `/* sources ${sha256(...named)} */\n${text}`);
}

const { dependencies } = JSON.parse(readFileSync(join(here, "package.json")));
const names = Object.keys(dependencies);
const versions = Object.fromEntries(
  names.map((name) => [name, JSON.parse(read(`${name}/package.json`)).version]),
);
const licences = names
  .map((name) => `${name} ${versions[name]}\n\n${read(`${name}/LICENSE`).trim()}`)
  .join("\n\n\n");
const { text: libraries } = await pack(join(here, "vendor.js"), {
  format: "iife",
  globalName: "vendor",
  charset: "ascii",
  banner: { js: `/*!\n${licences}\n*/` },
});
const files = {
  "three_uplot.min.js": libraries,
  "uplot.min.css": `/*! uPlot ${versions.uplot}, MIT */\n@layer libraries{${read("uplot/dist/uPlot.min.css").trim()}}\n`,
};
for (const [name, text] of Object.entries(files)) writeFileSync(join(target, name), text);
const digests = Object.fromEntries(
  Object.entries(files).map(([name, text]) => [name, sha256(text)]),
);
writeFileSync(
  join(target, "vendor.json"),
  `${JSON.stringify({ versions, sha256: digests }, null, 2)}\n`,
);
