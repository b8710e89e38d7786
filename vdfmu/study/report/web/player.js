// The section of the arm: picture, values of the joints, and the controls that replay the run.

import {
  bar,
  barStyle,
  button,
  choice,
  make,
  names,
  recorded,
  simulated,
  toggle,
  view,
} from "./data.js";
import { armsOf } from "./arm.js";
import { quantity, text } from "./numbers.js";
import { Scene3D, viewChoice } from "./scene.js";
import { Timeline } from "./timeline.js";

const UNITS = {
  // factor and unit for revolute and prismatic joints
  torque: { words: "Control torque", revolute: [1, "N.m"], prismatic: [1, "N"] },
  torsion: { words: "Torsion", revolute: [180 / Math.PI, "deg"], prismatic: [1e3, "mm"] },
  power: { words: "Power into the link", revolute: [1, "W"], prismatic: [1, "W"] },
  force: { words: "Force along the axis", revolute: [1, "N.m"], prismatic: [1, "N"] },
  error: { words: "Tracking error", revolute: [180 / Math.PI, "deg"], prismatic: [1e3, "mm"] },
};
const STEPS = 200;
const KEYS =
  "Space plays, arrow keys step, Home and End go to the ends; 1 to 4 are the views. Ctrl and the wheel, or the wheel after a click, zoom.";

export class Player {
  constructor(section) {
    const shown = recorded.filter((run) => run.arm);
    this.playing = false;
    this.speed = 1;
    const host = make("div", { class: "canvas", role: "img", "aria-label": "The arm in 3D" });
    section.hidden = false;
    section.append(make("h2", {}, "The arm"));
    this.readout = make("div", { class: "readout" });
    section.append(make("div", { class: "stage" }, host));
    try {
      this.scene = new Scene3D(host, shown[0]);
    } catch (error) {
      host.replaceWith(make("p", {}, `The arm cannot be drawn here: ${error.message}`));
      return;
    }
    this.letWheelPass(host);
    section.append(...this.controls(shown), this.readout);
    this.setRun(shown[0]);
    this.play(false);
    view.addEventListener("time", () => this.show());
    view.addEventListener("simulated", () => this.setRun(this.scene.run));
    document.addEventListener("keydown", (event) => this.key(event));
  }

  get motion() {
    return this.scene.motion;
  }

  /** End of the longest of the runs that are drawn. */
  get end() {
    return Math.max(...this.scene.puppets.map(({ motion }) => motion.time.at(-1)));
  }

  /** The wheel scrolls the page; with Ctrl, or after a click into the scene, it zooms. */
  letWheelPass(host) {
    let inside = false;
    host.addEventListener("pointerdown", () => {
      inside = true;
    });
    host.addEventListener("pointerleave", () => {
      inside = false;
    });
    const pass = (event) => inside || event.ctrlKey || event.metaKey || event.stopPropagation();
    host.addEventListener("wheel", pass, { capture: true, passive: true });
  }

  controls(shown) {
    this.button = button("", () => this.play(!this.playing), { class: "play" });
    this.slider = make("input", {
      type: "range",
      min: 0,
      step: "any",
      value: 0,
      "aria-label": "Time",
      input: () => {
        this.play(false);
        view.change("time", Number(this.slider.value));
      },
    });
    this.clock = make("output", { class: "clock", "aria-live": "off" });
    this.timeline = new Timeline(this.slider);
    const quantities = Object.keys(UNITS).filter((name) => this.motion[name]);
    this.scene.quantity = quantities[0];
    this.other = shown.length === 2 ? shown[1] : null;
    const others = choice(
      "Beside it",
      [[-1, "none"], ...names(shown)],
      (k) => {
        this.scene.beside(null);
        this.other = shown[k] ?? null;
        this.setRun(this.scene.run);
      },
      shown.indexOf(this.other),
    );
    const picker = choice("Run", names(shown), (k) => {
      this.play(false);
      this.setRun(shown[k]);
    });
    view.addEventListener("run", () => {
      picker.lastChild.value = shown.indexOf(view.run);
      this.setRun(view.run);
    });
    const layer = (words, name) =>
      toggle(words, true, (on) => this.scene.layer({ [name]: on }), { class: "chip" });
    const speed = choice(
      "",
      [1, 0.1, 0.3, 3, 10].map((factor) => [factor, `${factor} ×`]),
      (factor) => {
        this.speed = Number(factor);
      },
    );
    speed.lastChild.setAttribute("aria-label", "Speed");
    return [
      make("div", { class: "transport" }, this.button, this.timeline.element, this.clock, speed),
      bar(
        ...(shown.length > 1 ? [picker, others] : []),
        quantities.length &&
          choice(
            "Colour",
            quantities.map((name) => [name, UNITS[name].words]),
            (name) => {
              this.scene.quantity = name;
              this.show();
            },
          ),
        viewChoice(this.scene),
        make(
          "div",
          { class: "chips", role: "group", "aria-label": "Shown" },
          ...(this.motion.error ? [layer("desired arm", "desired")] : []),
          layer("path", "path"),
          layer("forces", "forces"),
        ),
        (this.tools = make(
          "div",
          { class: "chips tools" },
          make(
            "details",
            { class: "help" },
            make("summary", { "aria-label": "Keys" }, "?"),
            make("p", {}, KEYS),
          ),
        )),
      ),
    ];
  }

  setRun(run) {
    if (this.scene.run !== run) {
      this.scene.beside(null);
      this.scene.load(run);
    }
    const other = simulated.of === run && simulated.result.time.length ? simulated : this.other;
    this.scene.beside(other === run ? null : (other ?? null));
    [this.slider.min, this.slider.max] = [this.motion.time[0], this.end];
    const arms = armsOf(run),
      joints = arms.flatMap(({ arm, component }) =>
        arm.types.map((type, i) => [
          type,
          arms.length > 1 ? `${component},\u00a0${i + 1}` : `Joint ${i + 1}`,
        ]),
      );
    this.rows = joints.map(([type, joint]) => {
      const cells = this.scene.puppets.map((_, k) => ({
        fill: make("i", { class: k ? "second" : "" }),
        value: make("output", { class: k ? "second" : "", "aria-live": "off" }),
      }));
      const row = make(
        "tr",
        {},
        make("th", { scope: "row" }, joint),
        make("td", { class: "gauge" }, ...cells.map(({ fill }) => fill)),
        make("td", { class: "number" }, ...cells.map(({ value }) => value)),
      );
      return { type, cells, row };
    });
    this.heading = make("caption");
    this.timeline.draw(run, this.motion.time[0], this.end);
    this.readout.replaceChildren(
      make("table", {}, this.heading, make("tbody", {}, ...this.rows.map(({ row }) => row))),
    );
    this.show();
  }

  show() {
    const { time } = this.motion,
      t = Math.min(Math.max(view.time, time[0]), this.end);
    this.scene.show(t);
    this.slider.value = t;
    this.slider.setAttribute("aria-valuetext", `${text(t, 4)} s`);
    this.clock.textContent = `${t.toFixed(this.end < 1 ? 3 : 2)} s`;
    const name = this.scene.quantity;
    if (!this.motion[name]) return;
    const all = this.scene.puppets.map((puppet) => puppet.values(name, t)),
      peaks = this.scene.peaks();
    this.heading.textContent = `${UNITS[name].words}; bars: share of the joint's largest${all.length > 1 ? `; on the right: ${this.scene.second.name}` : ""}`;
    this.rows.forEach(({ type, cells }, i) =>
      cells.forEach(({ fill, value }, k) => {
        const [factor, unit] = UNITS[name][type],
          now = all[k][i] ?? NaN,
          share = now / (peaks[i] || 1);
        fill.style.cssText = barStyle(Math.max(-1, Math.min(1, share)));
        value.textContent = Number.isNaN(now)
          ? ""
          : quantity(factor * now, unit, factor * peaks[i]);
      }),
    );
  }

  play(on) {
    this.playing = on;
    this.button.textContent = on ? "❚❚" : "▶";
    this.button.setAttribute("aria-label", on ? "Pause" : "Play");
    if (!on) return;
    if (view.time >= this.end) view.change("time", this.motion.time[0]);
    let before = performance.now();
    const tick = (now) => {
      if (!this.playing) return;
      const t = view.time + (this.speed * (now - before)) / 1e3;
      before = now;
      view.change("time", Math.min(t, this.end));
      if (t < this.end) requestAnimationFrame(tick);
      else this.play(false);
    };
    requestAnimationFrame(tick);
  }

  key(event) {
    const { tagName, type } = event.target;
    if (
      event.target.closest?.("#simulate") ||
      event.ctrlKey ||
      event.metaKey ||
      event.altKey ||
      tagName === "SELECT" ||
      (tagName === "INPUT" && type !== "range")
    )
      return;
    const [first, last] = [this.motion.time[0], this.end];
    const step = ((event.shiftKey ? 10 : 1) * (last - first)) / STEPS;
    const moves = {
      ArrowLeft: view.time - step,
      ArrowRight: view.time + step,
      Home: first,
      End: last,
    };
    if (event.key === " " && tagName !== "BUTTON" && tagName !== "SUMMARY")
      this.play(!this.playing);
    else if (event.key in moves) {
      this.play(false);
      view.change("time", Math.min(Math.max(moves[event.key], first), last));
    } else return;
    event.preventDefault();
  }
}
