// The diagram of the system: its wires show the values at the time shown; a click on one, or the list, shows its signal.

import { bar, choice, curvesOf, make, merged, placeAt, runs, simulated, view } from "./data.js";
import { Chart } from "./chart.js";
import { quantity } from "./numbers.js";

/** Fill the section of the system. */
export function showSystem(section) {
  const signals = merged("signals");
  const diagrams = section.querySelector(".wide");
  if (!signals.size) return;
  section.hidden = false;
  const wires = [...section.querySelectorAll(".wire")]
    .map((element) => new Wire(element, signals))
    .filter(({ key }) => key);
  if (!diagrams.childElementCount) section.querySelector("h2").textContent = "Recorded signals";
  const place = make("div", { class: "grid single", "aria-live": "polite" }),
    error = make("b");
  const list = choice(
    "Signal",
    [...signals.keys()].map((key) => [key, key]),
    (key) => show(key),
  );
  const show = (key) => {
    list.querySelector("select").value = key;
    for (const wire of wires) wire.choose(wire.key === key);
    const { title, unit } = signals.get(key);
    error.textContent = wires.find((wire) => wire.key === key)?.element.dataset.error ?? "";
    place.replaceChildren(new Chart(title, unit, () => curvesOf("signals", key)).element);
  };
  for (const wire of wires) wire.listen(() => show(wire.key));
  section.append(
    bar(
      list,
      wires.length &&
        make(
          "small",
          { class: "note" },
          "On the wires: the largest element at the time shown. A click on a wire shows what it carries. ",
          error,
        ),
    ),
    place,
  );
  show(
    wires.find(({ key }) => key === "controller.tau")?.key ??
      wires[0]?.key ??
      [...signals.keys()][0],
  );
  if (wires.length) keepCurrent(diagrams, wires);
}

/** Write the values at the time shown, while the diagram is in sight. */
function keepCurrent(diagrams, wires) {
  let seen = false;
  for (const svg of diagrams.querySelectorAll("svg[role]")) svg.setAttribute("role", "group"); // its wires are buttons
  const update = () => {
    if (seen) for (const wire of wires) wire.update();
  };
  new IntersectionObserver(([entry]) => {
    seen = entry.isIntersecting;
    update();
  }).observe(diagrams);
  view.addEventListener("time", update);
  view.addEventListener("simulated", () => {
    for (const wire of wires) wire.curves = null;
    update();
  });
}

class Wire {
  constructor(element, signals) {
    this.element = element;
    this.title = element.querySelector("title");
    this.value = element.querySelector(".value");
    this.curves = null;
    this.words = this.title.textContent;
    const names = [element.dataset.signal, ...element.dataset.ends.split(" ")];
    this.key = [...signals.keys()].find((key) => names.includes(signals.get(key).title));
    this.unit = signals.get(this.key)?.unit;
  }

  listen(show) {
    const hit = this.element.querySelector(".line").cloneNode(); // a broad line that takes clicks
    hit.setAttribute("class", "hit");
    this.element.append(hit);
    for (const [name, value] of Object.entries({
      tabindex: 0,
      role: "button",
      "aria-pressed": "false",
      "aria-label": this.words,
    }))
      this.element.setAttribute(name, value);
    this.element.addEventListener("click", show);
    this.element.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      event.stopPropagation();
      show();
    });
  }

  choose(on) {
    this.element.classList.toggle("on", on);
    this.element.setAttribute("aria-pressed", String(on));
  }

  /** Values of the simulated run, if there is one, else of the first that has the signal. */
  update() {
    this.curves ??= newest(curvesOf("signals", this.key));
    const values = this.curves.map(({ time, values: own }) => {
      const [k, share] = placeAt(time, view.time + 1e-9);
      return own[share < 1 ? k : k + 1];
    });
    const place = values.reduce(
      (most, value, k) => (Math.abs(value) > Math.abs(values[most]) ? k : most),
      0,
    );
    this.value.textContent = quantity(values[place], this.unit === "1" ? "" : this.unit);
    this.title.textContent = `${this.words}; ${values.length > 1 ? "the largest, " : ""}${this.curves[place].label}, is ${this.value.textContent}`;
  }
}

function newest(curves) {
  const shown = curves.filter(({ time }) => time.length),
    mine = shown.filter(({ run }) => runs[run] === simulated);
  const run = (mine[0] ?? shown[0]).run;
  return shown.filter((curve) => curve.run === run);
}
