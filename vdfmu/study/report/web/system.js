// The diagram of the system: a click on a wire shows its signal, and so does the list below it.

import { choice, curvesOf, make, merged, runs } from "./data.js";
import { Chart } from "./chart.js";

const groupOf = (signal) => signal.replace(/\[[\d,]+\]$/, "");

/** Fill the section of the system. */
export function showSystem(section) {
  const signals = merged("signals");
  const svg = section.querySelector("svg.system");
  if (!signals.size) return;
  section.hidden = false;
  if (!svg) section.querySelector("h2").textContent = "Recorded signals";
  const copies = Object.assign({}, ...runs.map((run) => run.copies));
  const wires = svg ? [...svg.querySelectorAll(".wire")].map((wire) => wired(wire, copies, signals)) : [];
  const place = make("div", { class: "grid single", "aria-live": "polite" });
  const list = choice("Signal", [...signals.keys()].map((key) => [key, key]), (key) => show(key));
  const show = (key) => {
    list.querySelector("select").value = key;
    for (const wire of wires) wire.line.classList.toggle("on", wire.key === key);
    const { title, unit } = signals.get(key);
    place.replaceChildren(new Chart(title, unit, () => curvesOf("signals", key)).element);
  };
  for (const wire of wires) if (wire.key) wire.hit.addEventListener("click", () => show(wire.key));
  section.append(
    make("div", { class: "bar" }, list, ...(svg ? [make("small", { class: "note" }, "A click on a wire shows what it carries.")] : [])),
    place,
  );
  show(wires.find((wire) => wire.key === "controller.tau")?.key ?? [...signals.keys()][0]);
}

/** A wire with a broad line over it that takes clicks, and the group of the signal that it carries. */
function wired(line, copies, signals) {
  const [start, end] = line.querySelector("title").textContent.split(" to ");
  const groups = [start, end, copies[start], copies[end]].filter(Boolean).map(groupOf);
  const key = [...signals.keys()].find((one) => groups.includes(signals.get(one).title));
  const hit = line.cloneNode(true);
  hit.setAttribute("class", key ? "hit" : "hit none");
  line.after(hit);
  return { line, hit, key };
}
