// The names at the ends of curves, which need no legend, also in print.

import { colourOf, largest, make } from "./data.js";

const NAME_FONT = "11px system-ui, sans-serif";
const NAME_GAP = 12,
  NAME_STUB = 14,
  LEAST_ROOM = 16; // px: between names, before a name, least room right of the plot
const MOST_JOINTS = 8, // of a figure with a curve for each
  WORST_JOINTS = 3;
const pen = make("canvas").getContext("2d");

/** What a curve is called in its figure: its joint, or its label; by it, curves of several figures belong together. */
export const keyOf = (curve) => curve.joint || curve.label;

const nameOf = (curve) =>
  curve.joint
    ? `joint ${curve.joint}`
    : curve.label.length > 16
      ? `${curve.label.slice(0, 15)}…`
      : curve.label;

/** Shown curves that get a name: of each joint the first that is solid. */
function namedCurves(chart) {
  const found = new Map();
  chart.unpacked.forEach((curve, k) => {
    if (!curve.dashed && chart.shows(curve) && !found.has(keyOf(curve))) found.set(keyOf(curve), k);
  });
  return found.size < 2 && chart.unpacked.length < 2 ? [] : [...found.values()];
}

/** Of many joints those with the largest values, else null. */
export function worstOf(curves) {
  const peaks = new Map();
  for (const { joint, dashed, values } of curves)
    if (joint && !dashed) peaks.set(joint, Math.max(peaks.get(joint) ?? 0, largest(values)));
  const first = [...peaks].sort((a, b) => b[1] - a[1]).slice(0, WORST_JOINTS);
  return peaks.size > MOST_JOINTS ? first.map(([joint]) => joint).sort((a, b) => a - b) : null;
}

/** Room for the names right of the plot [px]. */
export function roomForNames(chart) {
  pen.font = NAME_FONT;
  const names = chart.unpacked.filter(({ dashed }) => !dashed).map(nameOf);
  return chart.unpacked.length < 2
    ? LEAST_ROOM
    : Math.max(
        LEAST_ROOM,
        NAME_STUB + 4 + Math.max(...names.map((name) => pen.measureText(name).width)),
      );
}

/** Heights at least `gap` apart within limits, as near as can be to those that are wanted, which rise. */
export function apart(wanted, gap, top, bottom) {
  const blocks = []; // of names that touch: mean of the heights that they want, less the gaps; and how many
  wanted.forEach((y, i) => {
    blocks.push([y - i * gap, 1]);
    while (blocks.length > 1 && blocks.at(-2)[0] > blocks.at(-1)[0]) {
      const [b, n] = blocks.pop(),
        [a, m] = blocks.pop();
      blocks.push([(a * m + b * n) / (m + n), m + n]);
    }
  });
  const last = bottom - (wanted.length - 1) * gap;
  return blocks
    .flatMap(([z, n]) => Array(n).fill(z))
    .map((z, i) => Math.max(top, Math.min(z, last)) + i * gap);
}

/** Names with the height at which their curve ends, and their own [px of the plot]. */
export function endsOf(chart) {
  const { plot } = chart,
    height = plot.over.clientHeight,
    last = plot.valToIdx(plot.scales.x.max);
  const found = namedCurves(chart)
    .flatMap((k) => {
      let row = last;
      while (row >= 0 && (plot.data[k + 1][row] ?? null) === null) row -= 1;
      return row < 0
        ? []
        : [
            {
              curve: chart.unpacked[k],
              text: nameOf(chart.unpacked[k]),
              end: Math.max(0, Math.min(height, plot.valToPos(plot.data[k + 1][row], "y"))),
            },
          ];
    })
    .sort((a, b) => a.end - b.end);
  const places = apart(
    found.map(({ end }) => end),
    Math.min(NAME_GAP, height / found.length),
    5,
    height - 5,
  );
  return found.map((one, i) => ({
    ...one,
    place: places[i],
    colour: colourOf(one.curve.colour),
    alpha: chart.faded(one.curve) ? 0.3 : 1,
    stub: NAME_STUB,
  }));
}

/** Draw them on the plot's canvas. */
export function drawEnds(plot, chart, ink) {
  const { ctx, bbox } = plot,
    ratio = bbox.width / plot.over.clientWidth;
  ctx.save();
  ctx.setLineDash([]);
  ctx.translate(bbox.left + bbox.width, bbox.top);
  ctx.scale(ratio, ratio);
  Object.assign(ctx, {
    font: NAME_FONT,
    textBaseline: "middle",
    textAlign: "left",
    lineWidth: 1.6,
  });
  for (const { text, end, place, colour, alpha, stub } of chart.ends()) {
    Object.assign(ctx, { globalAlpha: alpha, strokeStyle: colour, fillStyle: ink });
    ctx.beginPath();
    ctx.moveTo(1, end);
    ctx.lineTo(stub - 5, place);
    ctx.lineTo(stub - 1, place);
    ctx.stroke();
    ctx.fillText(text, stub + 1, place);
  }
  ctx.restore();
}
