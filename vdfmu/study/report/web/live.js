// What a page hears from the process that serves it: another page, or rows of a run that goes on.

import { Motion } from "./arm.js";
import { live, make, recorded, view } from "./data.js";
import { text } from "./numbers.js";
import { hearServer, served } from "./server.js";

const MOST_ROWS = 500,
  CHARTS = 150,
  PATHS = 700; // ms between two pictures of the figures, and of the paths

/** The line that says how things are. */
export function stateLine() {
  const line = make("p", { class: "verdict state" }, served?.dataset.words ?? "");
  line.hidden = !line.textContent;
  document.querySelector("p.what").before(line);
  return (words) => Object.assign(line, { textContent: words, hidden: !words });
}

/** Say how things are, and let a run that goes on grow; returns whether the newest row is shown. */
export function followRun(player, say = stateLine()) {
  let rows = [],
    newest = null,
    stride = 1,
    count = 0,
    last = null,
    charts = 0,
    paths = 0,
    waiting = 0,
    words = served?.dataset.words ?? "";
  const [run] = recorded;
  const draw = (now) => {
    waiting = 0;
    const all = newest === rows.at(-1) ? rows : [...rows, newest],
      follows = last === null || view.time === last;
    const signals = new Map(
      live.names.map((name, k) => [name, Float64Array.from(all, (row) => row[k + 1] ?? NaN)]),
    );
    run.result = { time: Float64Array.from(all, ([time]) => time), signals };
    words = `Running: ${newest[0].toFixed(live.stop < 1 ? 3 : 2)} of ${text(live.stop, 4)} s`;
    say(words);
    [last] = newest;
    const [puppet] = player?.scene?.puppets ?? [];
    if (puppet && now > paths + PATHS) {
      paths = now;
      puppet.follow(run);
    } else if (puppet) Object.assign(puppet.arms[0], { motion: new Motion(run), lengths: {} });
    if (follows) view.change("time", last);
    if (now < charts + CHARTS) return;
    charts = now;
    view.change("simulated");
  };
  hearServer(
    live
      ? ({ rows: more, anew }) => {
          if (anew) [rows, stride, count] = [[], 1, 0];
          for (const row of more) {
            if (count % stride === 0) rows.push(row);
            count += 1;
            newest = row;
          }
          if (rows.length > MOST_ROWS)
            [rows, stride] = [rows.filter((_, k) => k % 2 === 0), 2 * stride];
          if (newest) waiting ||= requestAnimationFrame(draw); // one, also while the page is not seen
        }
      : undefined,
    (lost) =>
      served && say(lost ? `${words} The view has ended, or cannot be reached.`.trim() : words),
  );
  if (live) player?.scene?.room();
  return () => !!live && view.time === last;
}
