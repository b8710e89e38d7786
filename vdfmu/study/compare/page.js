const data = JSON.parse(document.getElementById("data").textContent);
const names = Object.keys(data.measures), matrices = document.getElementById("matrices"), shown = document.getElementById("cell");
const [measure, motion] = ["measure", "motion"].map(name => document.getElementById(name));
const plain = text => text.replaceAll("_", " ");
const make = (tag, text, more = {}) => Object.assign(document.createElement(tag), { textContent: text ?? "" }, more);
const number = (value, name) => {
  if (value === null) return "–";
  const one = value * data.measures[name].factor;
  return one && (Math.abs(one) < 1e-3 || Math.abs(one) >= 1e5) ? one.toExponential(1) : String(Number(one.toPrecision(3)));
};
const cellOf = (arm, mismatch, law) => data.cells[`${arm} ${motion.value} ${mismatch} ${law}`];
const good = cell => cell && data.good.includes(cell.verdict);

function draw() {
  const name = measure.value, place = names.indexOf(name), { title, unit, more } = data.measures[name];
  const laws = Object.keys(data.laws);
  matrices.replaceChildren(...data.arms.map(arm => {
    const table = make("table", "", { className: "heat" }), wide = make("div", "", { className: "wide" });
    table.style.setProperty("--laws", laws.length);
    table.createCaption().textContent = `${arm}: ${title}${unit ? ` [${unit}]` : ""}`;
    const head = table.createTHead().insertRow(), body = table.createTBody();
    head.append(make("th"), ...laws.map(law => make("th", plain(law), { scope: "col", title: data.laws[law] })));
    for (const [mismatch, text] of Object.entries(data.mismatches)) {
      const row = body.insertRow(), cells = laws.map(law => cellOf(arm, mismatch, law));
      const values = cells.filter(good).map(cell => cell.values[place]).filter(value => value !== null);
      const best = more ? Math.max(...values) : Math.min(...values);
      row.append(make("th", plain(mismatch), { scope: "row", title: text }));
      cells.forEach((cell, i) => {
        const box = row.insertCell(), value = cell?.values[place];
        if (!cell) return box.append(make("span", "not tuned", { className: "unit" }));
        const words = good(cell) ? number(value, name) : cell.verdict, button = make("button", words, { type: "button" });
        button.ariaPressed = "false";
        button.title = `${plain(laws[i])}, ${text}: ${cell.verdict}`;
        const ratio = good(cell) && value !== null && best > 0 ? (more ? best / value : value / best) : 1;
        button.style.setProperty("--heat", `${Math.min(75, 30 * Math.log10(ratio)).toFixed(0)}%`);
        button.classList.toggle("best", laws.length > 1 && good(cell) && value === best);
        button.classList.toggle("broken", !good(cell));
        button.onclick = () => show(button, arm, mismatch, laws[i], cell);
        box.append(button);
      });
    }
    wide.append(table);
    return wide;
  }));
  shown.hidden = true;
}

function show(button, arm, mismatch, law, cell) {
  for (const other of matrices.querySelectorAll("button")) other.ariaPressed = String(other === button);
  const list = make("dl"), command = data.command + cell.row, copy = make("button", "copy", { type: "button" });
  names.forEach((name, i) => {
    const pair = make("div"), { title, unit } = data.measures[name];
    pair.append(make("dt", title), make("dd", `${number(cell.values[i], name)} ${cell.values[i] === null ? "" : unit}`));
    list.append(pair);
  });
  copy.onclick = () => navigator.clipboard?.writeText(command).then(() => { copy.textContent = "copied"; });
  const values = Object.entries(data.tunings[arm][law].values).map(([name, value]) => `${name} = ${value}`);
  const settings = Object.entries(data.settings[`${arm} ${mismatch}`]).map(([name, value]) => `${name} = ${value}`);
  const more = make("details"), runs = cell.runs > 1 ? `, ${cell.runs} runs, seeds ${data.seed} to ${data.seed + cell.runs - 1}` : "";
  more.append(make("summary", `settings of the run, ${settings.length}, and tuned values, ${values.length}`), make("pre", [...settings, "", ...values].join("\n")));
  shown.replaceChildren(
    make("h3", `${plain(law)} on ${arm}, ${plain(motion.value)}: ${data.mismatches[mismatch]}`),
    make("p", `${cell.verdict}${runs}${cell.why ? `: ${cell.why}` : ""}`), list, make("pre", command), copy, more);
  button.closest(".wide").after(shown);
  shown.hidden = false;
  shown.scrollIntoView({ block: "nearest" });
}

for (const name of names) measure.append(new Option(data.measures[name].title, name));
for (const name of data.motions) motion.append(new Option(plain(name), name));
measure.value = data.by;
measure.onchange = motion.onchange = draw;
draw();
