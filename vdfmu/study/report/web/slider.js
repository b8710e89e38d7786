// A slider of a parameter, on a track of the modulus margin: green, amber, red, and the limit of stability.

import { make, toggle } from "./data.js";
import { text } from "./numbers.js";
import { lower, stateOf } from "./verdict.js";

const NOTCHES = 100; // of a slider to either side

/** A slider of factors around 1, for all joints and for each. */
export class Slider {
  constructor(parameter, rows, changed) {
    this.parameter = parameter;
    this.rows = rows;
    this.places = Array(parameter.values.length + 1).fill(0);
    this.chosen = 0;
    this.known = false;
    this.output = make("output");
    this.slider = make("input", {
      type: "range",
      min: -NOTCHES,
      max: NOTCHES,
      "aria-label": parameter.words,
      input: () => {
        this.places[this.chosen] = Number(this.slider.value);
        this.show();
        changed();
      },
      dblclick: () => {
        this.slider.value = 0;
        this.slider.dispatchEvent(new Event("input"));
      },
    });
    this.knows = parameter.known.length
      ? toggle(
          "known",
          false,
          (on) => {
            this.known = on;
            changed();
          },
          {
            class: "chip",
            "aria-label": `${parameter.words}: known to the feedforward`,
            title: "The feedforward knows the change",
          },
        )
      : null;
    this.track = make("div", { class: "track" });
    this.bounds = make("small", { class: "note" });
    this.element = make(
      "div",
      { class: "slider" },
      make("span", {}, parameter.words),
      this.output,
      this.slider,
      this.track,
      this.bounds,
      ...(this.knows ? [this.knows] : []),
    );
    this.show();
  }

  /** Factor of a place of the slider, with three digits. */
  factor(place) {
    const { least, most } = this.parameter,
      share = Math.abs(place) / NOTCHES;
    return Number((place > 0 ? most ** share : least ? least ** share : 1 - share).toPrecision(3));
  }

  /** Slide a joint from now on, or all for 0; a parameter without joints has one place. */
  choose(joint) {
    this.chosen = joint < this.places.length && this.places.length > 2 ? joint : 0;
    this.show();
  }

  show() {
    const [all, ...own] = this.places.map((place) => this.factor(place)),
      { values, units } = this.parameter,
      joint = this.chosen - 1;
    const found = values.map((value, i) => all * own[i] * value),
      one =
        joint >= 0
          ? found[joint]
          : found.every((value, i) => value === found[0] && units[i] === units[0])
            ? found[0]
            : null;
    this.slider.value = this.places[this.chosen];
    this.output.textContent = `× ${text(joint < 0 ? all : all * own[joint], 3)}${one === null ? "" : ` = ${text(one, 4)} ${units[Math.max(joint, 0)]}`}`;
    this.paint();
  }

  /** Colour the track, while the slider is that of all joints, and say where its limits are. */
  paint() {
    const [place] = this.places,
      track = this.chosen ? null : this.parameter.track;
    this.track.hidden = this.bounds.hidden = !track;
    this.slider.className = "";
    const said = [this.output.textContent.replace("×", "times")];
    if (track) {
      const limits = this.limits(track),
        figures = figuresAt(track, place),
        colour = this.colour(figures),
        margin = figures.margin?.value ? `margin ${text(figures.margin.value, 2)}` : "unstable";
      this.track.replaceChildren(
        ...this.bands(track),
        ...track.limits
          .filter((limit) => limit !== null)
          .map((limit) => make("b", { style: `left:${percent(limit)}%` })),
      );
      this.bounds.textContent = [margin, limits].filter(Boolean).join("; ");
      this.slider.className = colour; // the thumb hides the part of the track that it is on
      said.push(`${margin}, ${colour}`, limits.replaceAll("×", "times"));
    }
    this.slider.setAttribute("aria-valuetext", said.filter(Boolean).join("; "));
  }

  /** Stretches of a track of one colour. */
  bands(track) {
    const colours = Array.from({ length: 2 * NOTCHES + 1 }, (_, k) =>
        this.colour(figuresAt(track, k - NOTCHES)),
      ),
      bands = [];
    colours.forEach((colour, k) => {
      if (colour !== colours[k - 1]) bands.push({ colour, from: k ? k - NOTCHES - 0.5 : -NOTCHES });
    });
    return bands.map(({ colour, from }, k) =>
      make("i", {
        class: colour,
        style: `left:${percent(from)}%;right:${100 - percent(bands[k + 1]?.from ?? NOTCHES)}%`,
      }),
    );
  }

  /** Green where all checks of the loops pass, red where they have no margin. */
  colour({ margin, delay, growth }) {
    if (!margin?.value) return "poor";
    const good = Object.entries({ margin, delay, growth }).every(
      ([key, figure]) => !figure || stateOf(this.rows[key], figure.value) === "good",
    );
    return good ? "good" : "fair";
  }

  /** Factors from and up to which the loops are stable, in words. */
  limits({ limits: [low, high] }) {
    if (low === 0 && high === 0) return "";
    const [from, to] = [low, high].map((limit) =>
      limit === null ? "" : text(this.factor(limit), 2),
    );
    if (from && to) return `stable × ${from} to ${to}`;
    return from || to ? `stable ${from ? `from × ${from}` : `up to × ${to}`}` : "";
  }

  /** Places other than 1: words with the factor, figures of the loops there, and the limit of stability. */
  moved() {
    return this.places.flatMap((place, k) => {
      if (!place) return [];
      const { words, track: whole } = this.parameter,
        track = k ? null : whole,
        limit = track?.limits[place > 0 ? 1 : 0] ?? null;
      return [
        {
          words: `${lower(words)}${k ? ` of joint ${k}` : ""} × ${text(this.factor(place), 3)}`,
          figures: track ? figuresAt(track, place) : null,
          limit: limit === null ? null : this.factor(limit),
          above: place > 0,
        },
      ];
    });
  }

  reset() {
    this.places.fill(0);
    this.show();
  }

  /** State as text: the factors of all joints and of each, "known" if the feedforward knows; "" with all at 1. */
  get state() {
    const last = this.places.findLastIndex((place) => place !== 0);
    return [
      ...this.places.slice(0, last + 1).map((place) => this.factor(place)),
      ...(this.known ? ["known"] : []),
    ].join("_");
  }

  set state(given) {
    const parts = given
      .split("_")
      .filter((part) => part !== "known")
      .map(Number);
    this.places = this.places.map((_, k) => (parts[k] >= 0 && given ? this.placeOf(parts[k]) : 0));
    this.known = given.endsWith("known") && !!this.knows;
    this.knows?.setAttribute("aria-pressed", String(this.known));
    this.show();
  }

  /** The place of the slider whose factor is nearest to one. */
  placeOf(factor) {
    const { least, most } = this.parameter;
    const share =
      factor > 1
        ? Math.log(factor) / Math.log(most)
        : least
          ? -Math.log(factor) / Math.log(least)
          : factor - 1;
    return Math.round(NOTCHES * Math.min(Math.max(share, -1), 1));
  }

  /** Changes of the parameters of units, by their full names. */
  changes({ units }) {
    const { targets, known } = this.parameter,
      [all, ...own] = this.places.map((place) => this.factor(place));
    return own.flatMap((factor, i) =>
      all * factor === 1
        ? []
        : [...targets, ...(this.known ? known : [])].flatMap(({ unit, name }) =>
            Object.keys(units.find((one) => one.name === unit).parameters)
              .filter(
                (one) =>
                  one === name ||
                  one.startsWith(`${name}[${i + 1}]`) ||
                  one.startsWith(`${name}[${i + 1},`),
              )
              .map((one) => ({ unit, name: one, factor: all * factor })),
          ),
    );
  }
}

/** Place on a track in percent. */
const percent = (place) => 50 * (1 + place / NOTCHES);

/** Key figures of the loops at a place of a track, between two places on a straight line from one to the other. */
function figuresAt({ places, figures }, place) {
  const k = Math.max(
    places.findIndex((one) => one >= place),
    0,
  );
  if (places[k] === place || !k) return figures[k];
  const [before, after] = [figures[k - 1], figures[k]],
    share = (place - places[k - 1]) / (places[k] - places[k - 1]);
  if (before.unstable || after.unstable)
    return after.unstable && (share > 0.5 || !before.unstable) ? after : before;
  const found = {};
  for (const name of new Set([...Object.keys(before), ...Object.keys(after)])) {
    const grows = name === "growth", // which is that of an exponent
      [a, b] = [before[name], after[name]],
      worse = !b || (a && (grows ? a.value > b.value : a.value < b.value)) ? a : b,
      [low, high] = grows ? [a, b].map((one) => Math.log1p(one?.value ?? 0)) : [a?.value, b?.value],
      between = low + share * (high - low);
    found[name] = {
      ...worse,
      value: grows ? Math.expm1(between) : a && b ? between : worse.value,
    };
  }
  return found;
}
