// The points of a study: pictures that choose together, the chosen point with its command, and its run in the bench.

import { bar, button, choice, copyButton, darkScheme, make, unpack } from "./data.js";
import { Column, shade } from "./lab_column.js";
import { gathered, triangulate } from "./lab_field.js";
import { Contour, Parallel, Scatter } from "./lab_plots.js";

class Lab extends EventTarget {
  constructor(study) {
    super();
    this.study = study;
    this.columns = study.columns.map((facts) => new Column(facts));
    /** @type {Map<Column, [number, number]>} shares between which points are chosen */
    this.ranges = new Map();
    /** @type {number | null} row of the point that is open */
    this.chosen = null;
    /** @type {Map<number, string>} role of a row; the last of several counts */
    this.roles = new Map(
      ["infeasible", "start", "chosen", "best"].flatMap((role) =>
        (study.roles[role] ?? []).map((row) => [row, role]),
      ),
    );
    this.missed = new Set(study.roles.infeasible);
    /** Parameters of all points, once they are unpacked. @type {Float64Array | null} */
    this.values = null;
    this.axes = this.columns.filter(({ axis }) => axis);
    this.measures = this.columns.filter(({ axis }) => !axis);
    this.colour = this.measures[0];
    this.all = [...study.points.keys()];
  }

  /** Rows of all points; if `ordered`, the points that other points must not cover come last. */
  rows(ordered = false) {
    const heights = ["infeasible", "", "start", "chosen", "best"],
      height = (row) => heights.indexOf(this.roleOf(row));
    return ordered ? this.all.toSorted((a, b) => height(a) - height(b)) : this.all;
  }

  roleOf(row) {
    return this.roles.get(row) ?? "";
  }

  /** Classes of the marks of a point. */
  lookOf(row) {
    const role = this.roleOf(row);
    const looks = {
      off: !this.passes(row),
      missed: this.missed.has(row),
      chosen: this.chosen === row,
      begin: role === "start",
      named: role !== "" && role !== "infeasible",
    };
    return ["", ...Object.keys(looks).filter((look) => looks[look])].join(" ");
  }

  changed() {
    this.dispatchEvent(new Event("change"));
  }

  passes(row) {
    return [...this.ranges].every(
      ([column, [low, high]]) => column.share(row) >= low && column.share(row) <= high,
    );
  }

  limit(ranges) {
    for (const [column, range] of ranges) this.ranges.set(column, range);
    this.changed();
  }

  clear() {
    this.ranges.clear();
    this.changed();
  }

  choose(row) {
    this.chosen = row;
    this.changed();
    this.dispatchEvent(new Event("chosen"));
  }

  titleOf(row) {
    return `${this.nameOf(row)}: ${[...this.axes, this.colour].map((column) => `${column.name} ${column.written(row)}`).join(", ")}`;
  }

  nameOf(row) {
    const role = this.roleOf(row);
    return `Point ${this.study.points[row]}${role ? `, ${role}` : ""}`;
  }

  /** The measure between the points, over two axes. */
  field(across, up) {
    const of = [across, up, this.colour];
    if (this.known?.of.every((column, k) => column === of[k])) return this.known;
    const numbers = across !== up && !across.words.length && !up.words.length,
      points = numbers ? this.all.map((row) => of.map((column) => column.share(row))) : [],
      places = gathered(points, this.axes.length > 2);
    this.known = { of, places, triangles: triangulate(places) };
    return this.known;
  }

  /** Parameters of a point, for the page to simulate it; null where it cannot. */
  changes(row) {
    const { names, rows, values } = this.study.changes ?? { names: [], rows: [] };
    const place = rows.indexOf(row);
    if (place < 0) return null;
    this.values ??= unpack(values, Float64Array);
    return names.map((name, k) => {
      const [unit, ...rest] = name.split(".");
      return { unit, name: rest.join("."), value: this.values[place * names.length + k] };
    });
  }
}

/** Fill the section of the study; `bench` runs a point again, where there is one. */
export function showLab(section, study, bench) {
  const lab = new Lab(study),
    shown = make("span", { role: "status" }),
    lists = new Map();
  /** Columns of the pictures, and of the colours. */
  const at = { across: lab.axes[0], up: lab.colour, first: lab.axes[0], second: lab.axes[1] };
  const put = (key, column) => {
    at[key] = column;
    lists.get(key).lastChild.value = lists.get(key).columns.indexOf(column);
  };
  const pick = (key, words, columns, change = (column) => put(key, column)) => {
    const pairs = columns.map((column, k) => [k, column.label]);
    const list = choice(words, pairs, (k) => {
      change(columns[k]);
      lab.changed();
    });
    lists.set(key, Object.assign(list, { columns }));
    if (at[key]) put(key, at[key]);
    return list;
  };
  const measure = pick("colour", "Measure", lab.measures, (column) => {
    if (at.up === lab.colour) put("up", column);
    lab.colour = column;
  });
  const scatter = new Scatter(lab, "Points over two columns", () => [at.across, at.up]),
    ways = [pick("across", "Across", lab.columns), pick("up", "Up", lab.columns)],
    pictures = [scatter.element];
  scatter.element.append(bar(...ways));
  if (lab.axes.length > 1) {
    const contour = new Contour(lab, "Contours over two axes", () => [at.first, at.second]),
      over = [pick("first", "Across", lab.axes), pick("second", "Up", lab.axes)];
    contour.element.append(bar(...over));
    pictures.push(contour.element);
  }
  const all = button("Show all", () => lab.clear()),
    bars = [measure, shown, all, scaleOf(lab)];
  section.append(
    make("div", { class: "bar sticky" }, ...bars),
    make(
      "p",
      { class: "note" },
      "Drag in a picture, or along an axis, to select points in all pictures; a double click shows all. Click on a point to open it below.",
    ),
    make("div", { class: "grid" }, ...pictures),
    ...(lab.axes.length > 2
      ? [new Parallel(lab, "Parallel coordinates: one line per point").element]
      : []),
    rangeInputs(lab),
    pointPanel(lab, bench),
  );
  lab.addEventListener("change", () => {
    const rows = lab.all.filter((row) => lab.passes(row));
    shown.textContent = `${rows.length} of ${lab.all.length} points`;
  });
  for (const element of /** @type {NodeListOf<HTMLElement>} */ (
    document.querySelectorAll("[data-point]")
  )) {
    const row = study.points.indexOf(Number(element.dataset.point));
    element.addEventListener("click", () => {
      lab.choose(row);
      section.querySelector(".panel").scrollIntoView({ block: "nearest" });
    });
  }
  lab.changed();
  return lab;
}

/** What the colours and marks mean. */
function scaleOf(lab) {
  const { study } = lab,
    [low, high, name] = ["low", "high", "name"].map(() => make("span")),
    strip = make("i");
  darkScheme.addEventListener("change", () => lab.changed());
  lab.addEventListener("change", () => {
    strip.style.background = `linear-gradient(90deg,${[0, 0.25, 0.5, 0.75, 1].map(shade)})`;
    [low.textContent, high.textContent] = [0, 1].map((share) =>
      lab.colour.wordsOf(lab.colour.valueAt(share)),
    );
    const notes = [
      lab.colour.log ? ", logarithmic" : "",
      study.failed.some((words) => words !== null) ? "; cross: failed" : "",
      lab.missed.size ? "; ring: misses a limit or the margin" : "",
    ];
    name.textContent = lab.colour.label + notes.join("");
  });
  return make("span", { class: "scale" }, low, strip, high, name);
}

/** The same choice by numbers, for keys and small screens. */
function rangeInputs(lab) {
  const rows = lab.columns
    .filter(({ words }) => !words.length)
    .map((column) => {
      const ends = [0, 1].map((end) =>
        make("input", {
          type: "number",
          step: "any",
          "aria-label": `${column.label}: ${end ? "at most" : "at least"}`,
          change: () => {
            const [low, high] = ends.map((input, k) =>
              input.value === "" ? [-1, 2][k] : column.shareOf(Number(input.value)),
            );
            lab.limit(new Map([[column, [low, high]]]));
          },
        }),
      );
      lab.addEventListener("change", () =>
        ends.forEach((input, k) => {
          const share = lab.ranges.get(column)?.[k];
          if (document.activeElement !== input)
            input.value =
              share === undefined || share < -0.5 || share > 1.5
                ? ""
                : Number(column.valueAt(share).toPrecision(4));
        }),
      );
      return make("div", {}, make("span", {}, column.label), ...ends);
    });
  return make("details", { class: "ranges" }, make("summary", {}, "Choose by numbers"), ...rows);
}

/** The chosen point: values, failure, command, and whether the page runs it. */
function pointPanel(lab, bench) {
  const panel = make("div", { class: "panel", role: "region", "aria-label": "The chosen point" });
  const step = (by) => () => {
    const rows = lab
      .rows()
      .filter((row) => lab.passes(row))
      .sort((a, b) => (lab.colour.values[a] ?? Infinity) - (lab.colour.values[b] ?? Infinity));
    if (rows.length) lab.choose(rows[(rows.indexOf(lab.chosen) + by + rows.length) % rows.length]);
  };
  const show = () => {
    const row = lab.chosen,
      { study } = lab,
      { name } = lab.colour,
      buttons = Object.entries({ Smaller: -1, Larger: 1 }).map(([words, by]) =>
        button(words, step(by), { "aria-label": `${words} ${name}` }),
      );
    if (row === null)
      return panel.replaceChildren(
        bar(
          make("h2", {}, "No point chosen"),
          button(`Smallest ${name}`, step(1)),
          ...[...lab.roles]
            .filter(([, role]) => role !== "infeasible")
            .map(([named, role]) => button(`The ${role} point`, () => lab.choose(named))),
        ),
      );
    const values = lab.columns.map((column) =>
      make("div", {}, make("dt", {}, column.name), make("dd", {}, column.written(row))),
    );
    const command = `${study.command} ${study.points[row]}`;
    const failed =
      study.failed[row] === null ? [] : [make("p", { class: "failure" }, study.failed[row])];
    const changes = lab.changes(row);
    const words =
      changes && bench
        ? "Simulated by this page and shown over the unchanged scenario: the arm and the figures below."
        : study.reason ||
          "This point differs in more than parameters from what the page simulates; use the command to run it.";
    panel.replaceChildren(
      bar(make("h2", {}, lab.nameOf(row)), ...buttons),
      ...failed,
      make("dl", {}, ...values),
      ...(study.command ? [bar(make("code", {}, command), copyButton(command))] : []),
      make("p", { class: "note" }, words),
    );
    return panel;
  };
  lab.addEventListener("change", show);
  lab.addEventListener("chosen", () => {
    const changes = lab.changes(lab.chosen);
    if (bench && changes) bench.open(changes);
  });
  return panel;
}
