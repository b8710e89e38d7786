// Limits, ticks and rows of a figure, as uPlot asks for them.

/** Limits of a scale with a margin; numbers that are equal except for rounding get one around them. */
export function padded(_, low, high) {
  if (low === null || high === null) return [-1, 1];
  const span = Math.max(high - low, 1e-6 * Math.max(Math.abs(low), Math.abs(high))) || 1;
  return [low - 0.06 * span, high + 0.06 * span];
}

/** Powers of ten among the numbers of a logarithmic axis. */
export function decades(_, splits) {
  return splits.map((v) =>
    v !== null && Math.abs(Math.log10(v) - Math.round(Math.log10(v))) < 1e-6 ? v : null,
  );
}

/** Row with a number that is nearest to that of the first curve near the pointer: runs have rows of their own. */
export function nearest(plot, series, row) {
  const first = plot.series.findIndex(({ show }, k) => k && show);
  return nearestOf(plot.data[series], nearestOf(plot.data[Math.max(first, 1)], row));
}

function nearestOf(values, row) {
  for (let k = 0; k < values.length; k += 1) {
    for (const at of [row - k, row + k])
      if (values[at] !== null && values[at] !== undefined) return at;
  }
  return row;
}
