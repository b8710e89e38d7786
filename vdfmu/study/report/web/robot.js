// The page of a robot: sliders of its joints, what is shown of it, and its modes, which move it.

import { choice, make, reducedMotion, robot, runs, toggle, unpack } from "./data.js";
import { stateLine } from "./live.js";
import { askServer, hearServer } from "./server.js";
import { quantity, text } from "./numbers.js";
import { LINKS, RobotScene } from "./robot_scene.js";
import { VIEWS } from "./scene.js";
import { watchScrollers } from "./scrollers.js";

const CYCLE = 1500; // ms that any mode takes on the screen
const SENT = 40; // ms between two poses that are sent
const LEAST = 0.005; // of a shape, whose largest is 1, that is written
const own = String(Math.random());

const section = (id) => document.getElementById(id);
const host = make("div", { class: "canvas", role: "img", "aria-label": "The arm in 3D" });
const state = {
  q: [...unpack(runs[0].frames.q)],
  motors: robot.motors[0],
  modes: [],
  chosen: -1,
  amplitude: 0.2,
};
const say = stateLine();
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
        links.querySelector("select").value = scene.chosen.links;
      },
      { class: "chip" },
    );
  const links = choice(
    "Links",
    Object.keys(LINKS).map((name) => [name, name]),
    (name) => scene.apply({ links: name }),
  );
  links.querySelector("select").value = scene.chosen.links;
  section("arm").append(
    make(
      "div",
      { class: "bar" },
      links,
      make(
        "div",
        { class: "chips", role: "group", "aria-label": "Shown" },
        part("frames", "frames"),
        part("centres of mass", "centres"),
        part("ellipsoids of inertia", "ellipsoids"),
        ...(robot.weightless ? [] : [part("gravity", "gravity")]),
      ),
      choice(
        "View",
        Object.keys(VIEWS)
          .reverse()
          .map((name) => [name, name]),
        (name) => scene.look(name),
      ),
      make("small", { class: "note" }, "Axes: x red, y green, z blue. Keys 1 to 4 are the views."),
    ),
  );
}

let sending = null;

/** Send the pose as it is soon. */
function send() {
  sending ??= setTimeout(() => {
    sending = null;
    askServer({ q: state.q, motors: state.motors, from: own });
  }, SENT);
}

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
      draw();
      send();
    },
  });
  const write = () => {
    output.textContent = `${(state.q[i] * factor).toFixed(1).replace("-", "−")} ${unit}`;
    input.setAttribute("aria-valuetext", output.textContent);
  };
  const show = () => {
    input.value = state.q[i] * factor;
    write();
  };
  show();
  return {
    show,
    element: make("div", { class: "knob" }, make("span", {}, `Joint ${i + 1}`), output, input),
  };
});

function pose(q) {
  state.q = [...q];
  sliders.forEach(({ show }) => show());
  draw();
}

section("joints").append(
  make(
    "div",
    { class: "bar" },
    make("h2", {}, "Joints"),
    make(
      "button",
      {
        type: "button",
        click: () => {
          pose(robot.sliders.map(({ start, factor }) => start / factor));
          send();
        },
      },
      "Back to the start",
    ),
  ),
  make("div", { class: "knobs" }, ...sliders.map(({ element }) => element)),
);

const motors = choice(
  "Motors",
  robot.motors.map((name) => [name, name]),
  (name) => {
    state.motors = name;
    send();
  },
);
const table = make("div", { class: "wide" }),
  words = make("p", { class: "note", role: "status" });
const amplitude = make("input", {
    type: "range",
    min: 0,
    max: 0.5,
    step: 0.01,
    value: state.amplitude,
    "aria-label": "Amplitude",
    input: () => {
      state.amplitude = Number(amplitude.value);
      far();
      draw();
    },
  }),
  reach = make("output");

function far() {
  reach.textContent = `${state.amplitude.toFixed(2)} rad or m`;
  amplitude.setAttribute("aria-valuetext", reach.textContent);
}

far();
section("modes").append(
  make("div", { class: "bar" }, make("h2", {}, "Modes"), motors),
  words,
  table,
  make(
    "div",
    { class: "knob" },
    make("span", {}, "Amplitude of the link that moves most"),
    reach,
    amplitude,
  ),
);

/** A part of a shape, as a bar and a number. */
function bar(value) {
  const shown = Math.abs(value) < LEAST ? 0 : value;
  return make(
    "td",
    {},
    make(
      "div",
      { class: "gauge" },
      make("i", {
        style: `width:${50 * Math.abs(shown)}%;${shown < 0 ? "right" : "left"}:50%;background:var(--${shown < 0 ? "negative" : "positive"})`,
      }),
    ),
    make("small", {}, text(Number(shown.toFixed(2)), 2)),
  );
}

function showModes() {
  const rows = state.modes.map(({ frequency, damping, joint, share, real }, k) =>
    make(
      "tr",
      {},
      make(
        "th",
        { scope: "row" },
        toggle(
          quantity(frequency, "Hz"),
          k === state.chosen,
          (on) => {
            state.chosen = on ? k : -1;
            showModes();
            draw();
          },
          {
            class: "chip mode",
            "aria-label": `Mode ${k + 1}, ${quantity(frequency, "Hz")}: moves the arm`,
          },
        ),
      ),
      make("td", {}, text(damping, 2)),
      make("td", {}, `${joint} (${(100 * share).toFixed(0)} %)`),
      ...real.map(bar),
    ),
  );
  const focus = [...table.querySelectorAll("button")].indexOf(document.activeElement);
  table.replaceChildren(
    ...(rows.length
      ? [
          make(
            "table",
            { class: "modes" },
            make(
              "caption",
              {},
              "At the pose of the sliders; 1, 2 and so on: how far each link moves",
            ),
            make(
              "thead",
              {},
              make(
                "tr",
                {},
                ...["Mode", "Damping", "Spring of"].map((head) =>
                  make("th", { scope: "col" }, head),
                ),
                ...robot.sliders.map((_, i) =>
                  make("th", { scope: "col", "aria-label": `Link ${i + 1}` }, String(i + 1)),
                ),
              ),
            ),
            make("tbody", {}, ...rows),
          ),
        ]
      : []),
  );
  table.querySelectorAll("button")[focus]?.focus();
}

let moving = false;

/** Draw the arm at the pose, or the mode that is chosen about it: undamped, or still at its largest where motion is not wanted. */
function draw() {
  if (!scene || moving) return;
  const tick = (now) => {
    const mode = state.modes[state.chosen],
      phase = reducedMotion.matches ? 0 : (2 * Math.PI * now) / CYCLE;
    scene.pose(
      mode
        ? state.q.map(
            (q, i) =>
              q +
              state.amplitude *
                (mode.real[i] * Math.cos(phase) - mode.imaginary[i] * Math.sin(phase)),
          )
        : state.q,
    );
    moving = !!mode && !reducedMotion.matches;
    if (moving) requestAnimationFrame(tick);
  };
  moving = true;
  requestAnimationFrame(tick);
}

showArm();
draw();
watchScrollers();
hearServer(
  ({ q, motors: chosen, from, modes, words: why }) => {
    if (q && from !== own) {
      state.motors = motors.querySelector("select").value = chosen;
      pose(q);
    }
    if (!modes) return;
    state.modes = modes;
    if (state.chosen >= modes.length) state.chosen = -1;
    words.textContent = why;
    showModes();
    draw();
  },
  (lost) => say(lost ? "The view has ended, or cannot be reached." : ""),
);

/** For the console and for tests. */
globalThis.report = { scene, state };
dispatchEvent(new Event("report"));
