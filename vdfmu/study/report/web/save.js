// A figure as a file: SVG, or the rows shown as CSV. The page makes it itself and hands it to the browser's downloads.

import { eventLines } from "./events.js";
import { choice, inkOf, make, recorded, runs } from "./data.js";

const TITLE_ROOM = 26; // px, for the title

/** Kind of file to the function that makes its content. */
export const FILES = {
  SVG: (chart) => new Blob([svgOf(chart)], { type: "image/svg+xml" }),
  CSV: (chart) => new Blob([csvOf(chart)], { type: "text/csv" }),
};

/** The menu of a figure's caption. */
export function saveMenu(chart) {
  const kinds = Object.keys(FILES),
    menu = choice("", [["", "save"], ...kinds.map((kind) => [kind, kind])], (kind) => {
      list.selectedIndex = 0;
      saveFigure(chart, kind);
    }),
    /** @type {any} */ list = menu.firstChild;
  list.className = "save";
  list.setAttribute("aria-label", `${chart.title}: save`);
  return menu;
}

function saveFigure(chart, kind) {
  const words = [...recorded.map(({ name }) => name), chart.title.split(":")[0]];
  const name = words
    .join("_")
    .toLowerCase()
    .replaceAll(/[^a-z0-9.]+/g, "_");
  handOver(FILES[kind](chart), `${name}.${kind.toLowerCase()}`);
}

/** Give a file to the browser's downloads. */
export function handOver(content, name) {
  const link = make("a", { href: URL.createObjectURL(content), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

const curvesShown = (chart) =>
  [...chart.unpacked.keys()].filter(
    (k) => chart.plot.series[k + 1].show && chart.unpacked[k].time.length,
  );

/** Rows of the stretch of time shown, of the curves shown, in the figure's unit. */
function csvOf(chart) {
  const { min, max } = chart.plot.scales.x,
    [time, ...columns] = chart.table(false),
    chosen = curvesShown(chart);
  const quoted = (text) => `"${text.replaceAll('"', '""')}"`;
  const drawn = chosen.map((k) => chart.unpacked[k]),
    several = new Set(drawn.map(({ run }) => run)).size > 1;
  const heads = drawn.map(({ label, run }) =>
    quoted(`${several ? `${runs[run].name}: ` : ""}${label}${chart.unit && ` [${chart.unit}]`}`),
  );
  const rows = Array.from(time, (t, i) =>
    [t, ...chosen.map((k) => columns[k][i] ?? "")].join(","),
  ).filter((_, i) => time[i] >= min && time[i] <= max);
  return [["time [s]", ...heads].join(","), ...rows, ""].join("\n");
}

/** The figure as it is shown, drawn as lines. */
function svgOf(chart) {
  const { plot } = chart,
    { clientWidth: width, clientHeight: height, offsetLeft: left } = plot.over,
    ink = inkOf("ink"),
    soft = inkOf("muted"),
    line = inkOf("line");
  const safe = (text) => String(text).replaceAll("&", "&amp;").replaceAll("<", "&lt;");
  const write = (x, y, anchor, text, colour = soft, more = "") =>
    `<text x="${x.toFixed(1)}" y="${(y + 4).toFixed(1)}" text-anchor="${anchor}" fill="${colour}"${more}>${safe(text)}</text>`;
  const ticks = ["x", "y"].flatMap((axis, i) =>
    plot.axes[i]._splits.flatMap((value, k) => {
      const label = plot.axes[i]._values?.[k],
        at = value === null ? NaN : plot.valToPos(value, axis);
      if (label === null || label === undefined || !(at >= -1 && at <= (i ? height : width) + 1))
        return [];
      return [
        `<path d="${i ? `M0 ${at}H${width}` : `M${at} 0V${height}`}" stroke="${line}" fill="none"/>`,
        i ? write(-6, at, "end", label) : write(at, height + 14, "middle", label),
      ];
    }),
  );
  const { places, height: tall } = eventLines(chart);
  const events = places.map(
    (x) => `<path d="M${x.toFixed(1)} ${height}v${-tall}" stroke="${soft}" opacity="0.55"/>`,
  );
  const curves = curvesShown(chart).map((k) => {
    const series = plot.series[k + 1],
      points = [];
    const [first, last] = series.idxs ?? [0, plot.data[0].length - 1];
    for (
      let row = Math.max(0, first - 1);
      row <= Math.min(last + 1, plot.data[0].length - 1);
      row += 1
    ) {
      const value = plot.data[k + 1][row];
      if (value !== null && value !== undefined)
        points.push(
          `${plot.valToPos(plot.data[0][row], "x").toFixed(1)} ${plot.valToPos(value, "y").toFixed(1)}`,
        );
    }
    return `<path d="M${points.join("L")}" fill="none" stroke="${chart.strokeOf(chart.unpacked[k])}" stroke-width="${series.width}" stroke-dasharray="${(series.dash ?? []).join(" ")}" opacity="${series.alpha}" stroke-linejoin="round"/>`;
  });
  const names = chart
    .ends()
    .map(
      ({ text, end, place, colour, alpha, stub }) =>
        `<g opacity="${alpha}"><path d="M${width + 1} ${end}L${width + stub - 5} ${place}h4" fill="none" stroke="${colour}" stroke-width="1.6"/>${write(width + stub + 1, place, "start", text, ink)}</g>`,
    );
  const [w, h] = [plot.width, plot.height + TITLE_ROOM];
  return (
    `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${w} ${h}" width="${w}" height="${h}" font-family="system-ui, sans-serif" font-size="11"><rect width="100%" height="100%" fill="${inkOf("card")}"/>` +
    write(
      8,
      14,
      "start",
      `${chart.title}${chart.unitText.textContent && ` [${chart.unitText.textContent}]`}`,
      ink,
      ' font-size="13" font-weight="600"',
    ) +
    `<clipPath id="in"><rect width="${width}" height="${height}"/></clipPath><g transform="translate(${left} ${plot.over.offsetTop + TITLE_ROOM})">${ticks.join("")}<g clip-path="url(#in)">${events.join("")}${curves.join("")}</g>${names.join("")}</g></svg>\n`
  );
}
