// Events of the recorded runs: in figures thin lines at their times, ticks if they are many, and words under the pointer.

import { inkOf, recorded, runs, view } from "./data.js";
import { text } from "./numbers.js";

const GAP = 4, // px, between two lines
  ROOM = 16, // px, of a line of full height
  TICK = 9; // px

/** Whether a run has events. */
export const happened = () => recorded.some((run) => run.events?.length);

/** Events of the components whose signals a figure shows, by its title; of all if these have none. */
function eventsOf(title, events) {
  const words = title.split(", ").map((name) => name.split(".")[0]);
  const own = events.filter(([name]) => words.includes(name.split(".")[0]));
  return own.length ? own : events;
}

/** Events of the shown runs in the stretch of time shown, with their places in the plot [px]. */
function eventsIn({ plot, title }) {
  const { min, max } = plot.scales.x;
  return recorded
    .filter((run) => !view.hiddenRuns.has(runs.indexOf(run)))
    .flatMap((run) => eventsOf(title, run.events ?? []))
    .flatMap(([name, times]) => times.map((time) => ({ name, time })))
    .filter(({ time }) => time >= min && time <= max)
    .map((one) => ({ ...one, place: plot.valToPos(one.time, "x") }));
}

/** Places of the lines [px], not closer than the gap, and their height [px]. */
export function eventLines(chart) {
  const { clientWidth: width, clientHeight: height } = chart.plot.over,
    places = [];
  for (const { place } of eventsIn(chart).sort((a, b) => a.place - b.place))
    if (!places.length || place - places.at(-1) >= GAP) places.push(place);
  return { places, height: places.length * ROOM > width ? TICK : height };
}

/** Draw them on the plot's canvas. */
export function drawEvents(plot, chart) {
  const { places, height } = eventLines(chart),
    { ctx, bbox } = plot,
    ratio = bbox.width / plot.over.clientWidth;
  ctx.save();
  ctx.setLineDash([]);
  Object.assign(ctx, { globalAlpha: 0.55, strokeStyle: inkOf("muted"), lineWidth: ratio });
  ctx.beginPath();
  for (const place of places) {
    ctx.moveTo(bbox.left + place * ratio, bbox.top + bbox.height);
    ctx.lineTo(bbox.left + place * ratio, bbox.top + bbox.height - height * ratio);
  }
  ctx.stroke();
  ctx.restore();
}

/** Words on the event whose line is at a place [px]; empty without one. */
export function eventAt(chart, place) {
  const far = (one) => Math.abs(one.place - place);
  const near = eventsIn(chart).sort((a, b) => far(a) - far(b))[0];
  return near && far(near) <= GAP ? `${near.name}: event at ${text(near.time, 5)} s` : "";
}
