// How numbers are written: with units that fit their size, as vdfmu/base/measure.py writes them.

const PREFIXES = { 6: "M", 3: "k", 0: "", "-3": "m", "-6": "µ", "-9": "n" };
const ROUNDING = 1e-9; // share of a peak below which a number is 0

/** The unit in which a largest value has at most three digits before its point, "" if no prefix fits, and the power of ten that values are divided by. */
export function fitted(unit, most) {
  if (!most || !Number.isFinite(most) || (most >= 0.1 && most < 1e4)) return [unit, 0];
  const exponent = 3 * Math.floor(Math.log10(most) / 3 + 1e-12),
    [, thousandth, base, rest] =
      /^(m(?=m))?(deg|rad|m|s|N|W|J|V|A|Hz)((?![\w²³⁴]).*)$/.exec(unit) ?? [];
  const prefix = PREFIXES[exponent - (thousandth ? 3 : 0)];
  if (
    base &&
    prefix !== undefined &&
    (!["k", "M"].includes(prefix) || ["N", "W", "J", "V", "A", "Hz"].includes(base))
  )
    return [prefix + base + rest, exponent];
  return most >= 0.01 && most < 1e5 ? [unit, 0] : ["", exponent];
}

/** A number with three digits and the unit that fits it: 2.89e-6 m is 2.89 µm; numbers far below the peak are 0. */
export function quantity(value, unit = "", peak = 0) {
  if (!Number.isFinite(value)) return "–";
  const shown = Math.abs(value) < ROUNDING * Math.abs(peak) ? 0 : Number(value.toPrecision(3)),
    [fit, power] = fitted(unit, Math.abs(shown));
  return `${text(fit ? shown / 10 ** power : shown, 3)} ${fit || unit}`.trimEnd();
}

/** A number with the digits that single precision surely has. */
export const text = (value, digits = 6) => {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e6)) {
    const [mantissa, exponent] = value.toExponential(digits - 1).split("e");
    return `${Number(mantissa)}e${Number(exponent)}`.replace(/^-/, "−");
  }
  return String(Number(value.toPrecision(digits))).replace("-", "−");
};

/** A number as an exponent. */
export const raised = (number) =>
  [...String(number)].map((c) => (c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c])).join("");
