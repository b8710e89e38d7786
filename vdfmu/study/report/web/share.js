// Ways to share a view: a link to it, the command that makes it, a picture of the arm.

import { button, copied, make, recorded, reducedMotion, simulated, view } from "./data.js";
import { address } from "./state.js";
import { handOver } from "./save.js";

/** The command of the run that is shown, with what a chosen point and the sliders have changed, in this order. */
export function commandOf(run, changes) {
  const parametersOf = (unit) => run.simulation.units.find(({ name }) => name === unit).parameters;
  const found = new Map();
  for (const { unit, name: asked, value, factor = 1 } of changes) {
    for (const [name, [, own]] of Object.entries(parametersOf(unit)).filter(
      ([one]) => one === asked || one.startsWith(`${asked}[`),
    )) {
      const key = `${unit}.${name}`;
      found.set(key, { unit, name, value: (value ?? found.get(key)?.value ?? own) * factor });
    }
  }
  const groups = Map.groupBy(found.values(), ({ unit, name }) => `${unit}.${name.split("[")[0]}`);
  const words = [...groups].flatMap(([group, own]) => {
    const values = own.map(({ value }) => String(Number(value.toPrecision(12))));
    const whole =
      Object.keys(parametersOf(own[0].unit)).filter(
        (name) => `${own[0].unit}.${name.split("[")[0]}` === group,
      ).length === own.length;
    if (whole && new Set(values).size === 1 && !run.command.includes(`${group}[`))
      return [`--set ${group}=${values[0]}`];
    return own.map(({ unit, name }, k) => `--set '${unit}.${name}=${values[k]}'`);
  });
  return [run.command, ...words].join(" ");
}

/** Buttons beside the title. */
export function shareButtons(simulation) {
  const said = make("small", { class: "note", role: "status" });
  const copy = (label, text) =>
    button(label, async () => {
      said.textContent = (await copied(text())) ? "Copied." : text();
    });
  const run = () => simulated.of ?? recorded[0];
  const command = recorded.some((one) => one.command)
    ? [copy("Copy as command", () => commandOf(run(), simulation?.changes() ?? []))]
    : [];
  return make("div", { class: "actions" }, said, copy("Copy link", address), ...command);
}

/** A button that saves the arm as it is drawn. */
export const pictureButton = ({ scene }) =>
  button(
    "Picture",
    () => {
      scene.render(); // of a frame before, nothing is kept
      const save = (picture) => handOver(picture, `${scene.run.name}.png`);
      scene.renderer.domElement.toBlob(save);
    },
    { title: "Save the arm as it is shown" },
  );

/** Go to the time and the figure of a tile. */
export function follow(tile, charts) {
  const { figure, time } = tile.dataset;
  if (time !== undefined) view.change("time", Number(time));
  const target =
    document.getElementById(figure) ??
    charts.find(({ element }) => element.dataset.figure?.startsWith(figure))?.element;
  if (!target) return;
  target.scrollIntoView({
    block: target.tagName === "FIGURE" ? "center" : "start",
    behavior: reducedMotion.matches ? "auto" : "smooth",
  });
  for (const one of document.querySelectorAll(".found-now")) one.classList.remove("found-now");
  target.classList.add("found-now");
}
