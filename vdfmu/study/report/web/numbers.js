// Numbers with three digits in units of measurement that fit their size; vdfmu/base/quantity.py writes them alike.

import { raised } from "./data.js";

const PREFIXES = { "-9": "n", "-6": "µ", "-3": "m", 0: "", 3: "k", 6: "M" };
const SMALL_ONLY = ["m", "s", "rad", "deg"], ANY_SIZE = ["N", "N.m", "J", "W", "Hz"]; // symbols that take prefixes
const ROUNDING = 1e-9; // share of a peak below which a number is 0

/** A number with three digits and its unit: 2.89e-6 m is 2.89 µm; mm becomes a multiple of m, 0.1 to 1000 stay, numbers far below the peak are 0. */
export function quantity(value, unit = "", peak = 0) {
  if (unit === "mm") return quantity(1e-3 * value, "m", 1e-3 * peak);
  if (!Number.isFinite(value)) return "–";
  let shown = Math.abs(value) < ROUNDING * Math.abs(peak) ? 0 : Number(value.toPrecision(3)), prefix = "";
  const symbol = unit.split("/")[0], power = shown ? 3 * Math.floor(Math.log10(Math.abs(shown)) / 3 + 1e-12) : 0;
  if ([...SMALL_ONLY, ...ANY_SIZE].includes(symbol) && power >= -9) {
    const scale = Math.abs(shown) >= 0.1 && power < 0 ? 0 : Math.min(power, ANY_SIZE.includes(symbol) ? 6 : 0);
    shown = Number((shown / 10 ** scale).toPrecision(3));
    prefix = PREFIXES[scale];
  }
  const size = Math.abs(shown), [mantissa, exponent] = shown.toExponential(2).split("e");
  const digits = shown && (size < 1e-3 || size >= 1e6) ? `${Number(mantissa)}·10${raised(Number(exponent))}` : String(shown);
  return `${digits} ${prefix}${unit}`.trimEnd().replace("-", "−");
}
