// The page of a robot: sliders of its joints, the layers that are shown, and its modes, which move it.

import {
  bar,
  barStyle,
  button,
  choice,
  make,
  reducedMotion,
  robot,
  runs,
  same,
  toggle,
} from "./data.js";
import { quantity, text } from "./numbers.js";
import { LINKS, RobotScene } from "./robot_scene.js";
import { viewChoice } from "./scene.js";
import { watchScrollers } from "./scrollers.js";

const CYCLE = 1500; // ms that any mode takes on the screen
const AMPLITUDE = 0.2; // of the link that moves most, rad or m
const LEAST = 0.005; // of a shape, whose largest is 1, that is written
const DEGREES = 180 / Math.PI;

const section = (id) => document.getElementById(id);
const host = make("div", { class: "canvas", role: "img", "aria-label": "The arm in 3D" });
const start = robot.sliders.map(({ start: position }) => position);
const motors = Object.keys(robot.modes);
const state = { q: [...start], motors: motors[0], chosen: -1 };
/** @type {RobotScene | null} */
let scene = null;

function showArm() {
  section("arm").append(make("h2", {}, "The arm"), make("div", { class: "stage" }, host));
  try {
    scene = new RobotScene(host, runs[0]);
  } catch (error) {
    host.replaceWith(make("p", {}, `The arm cannot be drawn here: ${error.message}`));
    return;
  }
  const part = (words, name) =>
    toggle(
      words,
      scene.chosen[name],
      (on) => {
        const inside = on && name !== "frames" && name !== "gravity"; // of solid links nothing is seen
        scene.apply({ [name]: on, ...(inside ? { links: "see-through" } : {}) });
        links.lastChild.value = scene.chosen.links;
      },
      { class: "chip" },
    );
  const links = choice(
    "Links",
    same(LINKS),
    (name) => scene.apply({ links: name }),
    scene.chosen.links,
  );
  section("arm").append(
    bar(
      links,
      make(
        "div",
        { class: "chips", role: "group", "aria-label": "Shown" },
        part("frames", "frames"),
        part("centres of mass", "centres"),
        part("ellipsoids of inertia", "ellipsoids"),
        ...(robot.weightless ? [] : [part("gravity", "gravity")]),
      ),
      viewChoice(scene),
      make("small", { class: "note" }, "Axes: x red, y green, z blue. Keys 1 to 4 are the views."),
    ),
  );
}

const number = (value, unit) => `${value.toFixed(1).replace("-", "−")} ${unit}`;

const sliders = robot.sliders.map(({ unit, factor, low, high }, i) => {
  const output = make("output");
  const input = make("input", {
    type: "range",
    min: low,
    max: high,
    step: 0.1,
    "aria-label": `Joint ${i + 1}`,
    input: () => {
      state.q[i] = Number(input.value) / factor;
      write();
      still();
    },
  });
  const write = () => {
    output.textContent = number(state.q[i] * factor, unit);
    input.setAttribute("aria-valuetext", output.textContent);
  };
  const show = () => {
    input.value = String(state.q[i] * factor);
    write();
  };
  show();
  const ends = make(
    "small",
    { class: "note ends" },
    make("span", {}, number(low, unit)),
    make("span", {}, number(high, unit)),
  );
  return {
    show,
    element: make(
      "div",
      { class: "slider" },
      make("span", {}, `Joint ${i + 1}`),
      output,
      input,
      ends,
    ),
  };
});

/** Move the arm to a pose. */
function pose(q) {
  state.q = [...q];
  sliders.forEach(({ show }) => show());
  still();
}

const tool = ["x", "y", "z", "roll", "pitch", "yaw"].map((name) => ({
  name,
  output: make("output", { "aria-live": "off" }),
}));
const pasted = make("output", { "aria-live": "off" });

/** Write where the end effector is, and the pose as the command line takes it. */
function showPose() {
  if (scene) {
    const { position, angles } = scene.toolPose();
    [...position.map((x) => 1e3 * x), ...angles.map((x) => DEGREES * x)].forEach((value, k) => {
      const shown = Math.abs(value) < 0.05 ? 0 : value; // no −0.0
      tool[k].output.textContent = number(shown, k < position.length ? "mm" : "deg");
    });
  }
  pasted.textContent = state.q.map((q) => String(Number(q.toFixed(4)))).join(" ");
}

section("joints").append(
  bar(
    make("h2", {}, "Joints"),
    button("Back to the start", () => pose(start)),
  ),
  make("div", { class: "sliders" }, ...sliders.map(({ element }) => element)),
  make("h3", {}, "End effector {O} in {I}"),
  make(
    "dl",
    { class: "tool" },
    ...tool.map(({ name, output }) =>
      make("div", {}, make("dt", {}, name), make("dd", {}, output)),
    ),
  ),
  make(
    "p",
    { class: "note" },
    robot.limits
      ? ""
      : "The robot file gives no joint limits, so the ends of the sliders are not limits of the arm. ",
    "Angles about the fixed axes x, y, z, as in URDF.",
  ),
  make("p", { class: "note" }, "This pose in rad and m: ", make("code", {}, pasted)),
);

const table = make("div", { class: "wide" });
function showModesPart() {
  section("modes").append(
    bar(
      make("h2", {}, "Modes"),
      choice("Motors", same(robot.modes), (name) => {
        state.motors = name;
        choose(-1);
      }),
    ),
    table,
    make(
      "p",
      { class: "note" },
      "Calculated at the start pose, about which a chosen mode moves the arm. For the modes at another pose, run vdfmu linear with the numbers above as its pose.",
    ),
  );
  showModes();
}

/** A part of a shape, as a bar and a number. */
function part(value) {
  const shown = Math.abs(value) < LEAST ? 0 : value;
  return make(
    "td",
    {},
    make("div", { class: "gauge" }, make("i", { style: barStyle(shown) })),
    make("small", {}, text(Number(shown.toFixed(2)), 2)),
  );
}

function modeRow({ frequency, damping, joint, share, real }, k) {
  const name = quantity(frequency, "Hz");
  const button = toggle(name, k === state.chosen, (on) => choose(on ? k : -1), {
    class: "chip mode",
    "aria-label": `Mode ${k + 1}, ${name}: moves the arm`,
  });
  return make(
    "tr",
    {},
    make("th", { scope: "row" }, button),
    make("td", {}, text(damping, 2)),
    make("td", {}, `${joint} (${(100 * share).toFixed(0)} %)`),
    ...real.map(part),
  );
}

function showModes() {
  const focus = [...table.querySelectorAll("button")].indexOf(document.activeElement);
  const column = (words, more = {}) => make("th", { scope: "col", ...more }, words);
  const heads = [
    ...["Mode", "Damping", "Spring of"].map((words) => column(words)),
    ...start.map((_, i) => column(String(i + 1), { "aria-label": `Link ${i + 1}` })),
  ];
  table.replaceChildren(
    make(
      "table",
      { class: "modes" },
      make("caption", {}, "1, 2 and so on: how far each link moves"),
      make("thead", {}, make("tr", {}, ...heads)),
      make("tbody", {}, ...robot.modes[state.motors].map(modeRow)),
    ),
  );
  table.querySelectorAll("button")[focus]?.focus();
}

/** Animate a mode at the start pose, at which it was calculated; -1 is none. */
function choose(k) {
  if (k >= 0) pose(start);
  state.chosen = k;
  showModes();
  draw();
}

/** Let no mode move the arm. */
function still() {
  if (state.chosen >= 0) choose(-1);
  else draw();
}

let moving = false;

/** Draw the arm at the pose, or the mode that is chosen: undamped, or still at its largest where motion is not wanted. */
function draw() {
  if (!scene || moving) {
    showPose();
    return;
  }
  const tick = (now) => {
    const mode = robot.modes[state.motors]?.[state.chosen],
      phase = reducedMotion.matches ? 0 : (2 * Math.PI * now) / CYCLE;
    scene.pose(
      mode
        ? state.q.map(
            (q, i) =>
              q +
              AMPLITUDE * (mode.real[i] * Math.cos(phase) - mode.imaginary[i] * Math.sin(phase)),
          )
        : state.q,
    );
    if (!mode) showPose();
    moving = !!mode && !reducedMotion.matches;
    if (moving) requestAnimationFrame(tick);
  };
  moving = true;
  requestAnimationFrame(tick);
}

showArm();
if (motors.length) showModesPart();
draw();
watchScrollers();

/** For the console and for tests. */
globalThis.report = { scene, state, pose };
dispatchEvent(new Event("report"));
