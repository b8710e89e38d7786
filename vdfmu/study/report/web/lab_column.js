// A column of a study: its values by point, its scale, its ticks and its colours.

import { darkScheme, largest } from "./data.js";
import { fitted, quantity, raised, text } from "./numbers.js";

const STOPS = [
  [68, 1, 84],
  [59, 82, 139],
  [33, 145, 140],
  [94, 201, 98],
  [253, 231, 37],
]; // viridis

/** Colour of a share between 0 and 1: viridis, from its end far from the page; other values are not numbers. */
export function shade(share) {
  const far = darkScheme.matches ? 1 - share : share,
    place = Math.min(Math.max(far, 0), 1) * (STOPS.length - 1),
    k = Math.min(Math.floor(place), STOPS.length - 2);
  return `rgb(${STOPS[k].map((from, i) => Math.round(from + (place - k) * (STOPS[k + 1][i] - from)))})`;
}

export class Column {
  /** @param {{name: string, unit: string, log: boolean, words: string[], axis: boolean, values: (number | null)[]}} facts */
  constructor({ name, unit, log, words, axis, values }) {
    const [fit, power] = words.length ? [] : fitted(unit, largest(values));
    this.name = name;
    this.unit = fit || unit;
    this.log = log;
    this.words = words;
    this.axis = axis;
    this.values = fit ? values.map((v) => (v === null ? null : v / 10 ** power)) : values;
    const known = this.values.filter((v) => v !== null).map((v) => this.onScale(v));
    this.low = known.reduce((a, b) => Math.min(a, b), known[0] ?? 0);
    this.high = known.reduce((a, b) => Math.max(a, b), known[0] ?? 1);
    if (this.high === this.low) [this.low, this.high] = [this.low - 0.5, this.high + 0.5];
    this.label = this.unit ? `${name} [${this.unit}]` : name;
  }

  onScale(value) {
    return this.log ? Math.log10(value) : value;
  }

  shareOf(value) {
    return (this.onScale(value) - this.low) / (this.high - this.low);
  }

  /** Share of the scale, NaN for a point without a value. */
  share(row) {
    return this.values[row] === null ? NaN : this.shareOf(this.values[row]);
  }

  valueAt(share) {
    const value = this.low + share * (this.high - this.low);
    return this.log ? 10 ** value : value;
  }

  written(row) {
    return this.values[row] === null
      ? "no value"
      : this.wordsOf(this.values[row], !this.words.length);
  }

  wordsOf(value, unit = false) {
    if (this.words.length) return this.words[Math.round(value)];
    return unit ? quantity(value, this.unit) : text(value, 3);
  }

  /** At most `most` values with room for their words, two or more if there is room. */
  ticks(most) {
    if (this.words.length) return this.words.map((_, k) => k);
    const [low, high] = [this.valueAt(0), this.valueAt(1)];
    if (this.log) {
      const powers = Array.from(
        { length: Math.ceil(this.high) - Math.floor(this.low) + 1 },
        (_, k) => 10 ** (Math.floor(this.low) + k),
      );
      for (const digits of [[1, 2, 5], [1, 3], [1]]) {
        const some = powers
          .flatMap((power) => digits.map((digit) => digit * power))
          .filter((v) => v >= low * (1 - 1e-9) && v <= high * (1 + 1e-9));
        if (some.length > 1 && some.length <= most) return some;
        const every = Math.ceil(some.length / most);
        if (digits.length === 1 && every > 1) return some.filter((_, k) => k % every === 0);
      }
    }
    const rough = (high - low) / most,
      power = 10 ** Math.floor(Math.log10(rough)),
      step = [1, 2, 5, 10].find((k) => k * power >= rough) * power,
      first = Math.ceil(low / step - 1e-9),
      count = Math.floor(high / step + 1e-9) - first + 1;
    return Array.from({ length: count }, (_, k) => (first + k) * step);
  }

  tickText(value) {
    if (this.words.length || !this.log || value >= 0.01)
      return this.wordsOf(Number(value.toPrecision(6)));
    const exponent = Math.floor(Math.log10(value) + 1e-9),
      digit = Math.round(value / 10 ** exponent);
    return `${digit === 1 ? "" : `${digit}·`}10${raised(exponent)}`;
  }
}
