// The page of compared control laws: a matrix of cells for each arm, and a cell with the command that runs it again.

import { choice, compared, copyButton, make } from "./data.js";
import { text } from "./numbers.js";

const names = Object.keys(compared.measures), matrices = document.getElementById("matrices"), panel = document.getElementById("cell");
const shown = { measure: compared.by, motion: compared.motions[0] };
const plain = (name) => name.replaceAll("_", " ");
const valueOf = (cell, name) => cell.values[names.indexOf(name)];
const written = (cell, name) => (valueOf(cell, name) === null ? "–" : text(valueOf(cell, name) * compared.measures[name].factor, 3));
const cellOf = (arm, mismatch, law) => compared.cells[`${arm} ${shown.motion} ${mismatch} ${law}`];
const good = (cell) => cell && compared.good.includes(cell.verdict);

function draw() {
  const { title, unit } = compared.measures[shown.measure], columns = Object.entries(compared.laws);
  matrices.replaceChildren(...compared.arms.map((arm) => make("div", { class: "wide" }, make("table", { class: "matrix", style: `--laws:${columns.length}` },
    make("caption", {}, `${arm}: ${title}${unit && ` [${unit}]`}`),
    make("thead", {}, make("tr", {}, make("th"), ...columns.map(([law, words]) => make("th", { scope: "col", title: words }, plain(law))))),
    make("tbody", {}, ...Object.keys(compared.mismatches).map((mismatch) => rowOf(arm, mismatch)))))));
  panel.hidden = true;
}

/** The cells of an arm with a mismatch, coloured by how many times the best of them. */
function rowOf(arm, mismatch) {
  const laws = Object.keys(compared.laws), { more } = compared.measures[shown.measure], words = compared.mismatches[mismatch];
  const values = laws.map((law) => { const cell = cellOf(arm, mismatch, law); return good(cell) ? valueOf(cell, shown.measure) : null; });
  const known = values.filter((value) => value !== null), best = more ? Math.max(...known) : Math.min(...known);
  return make("tr", {}, make("th", { scope: "row", title: words }, plain(mismatch)), ...laws.map((law, i) => {
    const cell = cellOf(arm, mismatch, law), value = values[i];
    if (!cell) return make("td", {}, make("span", { class: "unit" }, "not tuned"));
    const ratio = value !== null && best > 0 ? (more ? best / value : value / best) : 1;
    const look = `${laws.length > 1 && value !== null && value === best ? "best" : ""} ${good(cell) ? "" : "broken"}`;
    const button = make("button", { type: "button", class: look, "aria-pressed": "false", title: `${plain(law)}, ${words}: ${cell.verdict}`,
      style: `--heat:${Math.min(75, 30 * Math.log10(ratio)).toFixed(0)}%`, click: () => show(button, arm, mismatch, law, cell) }, good(cell) ? written(cell, shown.measure) : cell.verdict);
    return make("td", {}, button);
  }));
}

function show(button, arm, mismatch, law, cell) {
  for (const other of matrices.querySelectorAll("button")) other.ariaPressed = String(other === button);
  const command = compared.command + cell.row;
  const [values, settings] = [compared.tunings[arm][law].values, compared.settings[`${arm} ${mismatch}`]].map((each) => Object.entries(each).map(([name, value]) => `${name} = ${value}`));
  const runs = cell.runs > 1 ? `, ${cell.runs} runs, seeds ${compared.seed} to ${compared.seed + cell.runs - 1}` : "";
  panel.replaceChildren(
    make("h3", {}, `${plain(law)} on ${arm}, ${plain(shown.motion)}: ${compared.mismatches[mismatch]}`),
    make("p", {}, `${cell.verdict}${runs}${cell.why ? `: ${cell.why}` : ""}`),
    make("dl", {}, ...names.map((name) => make("div", {}, make("dt", {}, compared.measures[name].title), make("dd", {}, `${written(cell, name)} ${valueOf(cell, name) === null ? "" : compared.measures[name].unit}`)))),
    make("pre", {}, command), copyButton(command),
    make("details", {}, make("summary", {}, `settings of the run, ${settings.length}, and tuned values, ${values.length}`), make("pre", {}, [...settings, "", ...values].join("\n"))));
  button.closest(".wide").after(panel);
  panel.hidden = false;
  panel.scrollIntoView({ block: "nearest" });
}

const chosen = (label, key, pairs) => choice(label, pairs, (value) => { shown[key] = value; draw(); });
const measure = chosen("measure", "measure", names.map((name) => [name, compared.measures[name].title]));
measure.querySelector("select").value = compared.by;
document.getElementById("choices").append(measure, chosen("motion", "motion", compared.motions.map((name) => [name, plain(name)])));
draw();
