// The verdict on a simulated run by the table of limits of vdfmu/study/limits.py, which Python writes into the page:
// the counterparts of `Limit.check` and `verdict_of`, and of the checks of vdfmu/study/verdict.py.

import { quantity, text } from "./numbers.js";

export const STATES = ["good", "doubtful", "failed"];
export const UNJUDGED = "not judged";
const [GOOD, DOUBTFUL, FAILED] = STATES;
/** Comes last, so that the headline is a check that is known to be doubtful. */
const NOT_HERE = "stability not judged here";

/** A number of a row as text, with some more digits. */
function shown({ unit }, value, more = 0) {
  return unit === "1"
    ? text(value, 2 + more)
    : `${text(unit === "%" ? 100 * value : value, 3 + more)} ${unit}`;
}

/** State of a number; NaN is beyond every limit. */
export function stateOf({ value: limit, failed = Infinity, at_least: atLeast, beyond }, value) {
  if (atLeast ? value >= limit : value <= limit) return GOOD;
  return failed === Infinity || value <= Math.max(failed, limit) ? beyond : FAILED;
}

/** Whether a number is good only by the limit that a user set. */
const excuses = (row, value) =>
  row.usual !== undefined &&
  stateOf(row, value) === GOOD &&
  stateOf({ ...row, value: row.usual }, value) !== GOOD;

/** Judge a number by a row of the table; `places` are those of its sentence. */
export function check(row, value, /** @type {Record<string, any>} */ places, more = "") {
  const state = stateOf(row, value),
    limit = state === FAILED && row.beyond !== FAILED ? row.failed : row.value;
  let digits = 0;
  while (state !== GOOD && digits < 9 && shown(row, value, digits) === shown(row, limit, digits))
    digits += 1;
  const said = shown(row, value, digits);
  const words = { ...places, value: said, samples: said === "1" ? "sample" : "samples" };
  let sentence = row.sentence.replace(/\{(\w+)\}/g, (_, name) => words[name] ?? "");
  const excused = excuses(row, value);
  if (state !== GOOD || excused) {
    const told = `limit ${shown(row, limit)}${row.usual !== undefined ? ` by ${row.by}` : ""})`;
    sentence = sentence.replace(/\)?$/, (end) => (end ? ", " : " (")) + told;
  }
  const { key, name, by } = row;
  return { key, name, state, sentence, more, value, limit: row.value, by, excused };
}

const plain = (key, name, state, sentence, more = "") => ({ key, name, state, sentence, more });

/** State, headline, results and checks: the headline is the sentence of the worst check, the first of several. */
function verdictOf(checks, results, longest, cut) {
  const judged = checks.filter((one) => one.state !== UNJUDGED),
    names = checks.filter((one) => one.state === UNJUDGED).map(({ name }) => lower(name));
  const state = judged.length
    ? STATES[Math.max(...judged.map((one) => STATES.indexOf(one.state)))]
    : DOUBTFUL;
  const phrases = [...results, ...(names.length ? [`not judged: ${names.join(", ")}`] : [])];
  let told = Math.min(phrases.length, 1);
  const room = longest - `${GOOD}: `.length;
  while (told < phrases.length && phrases.slice(0, told + 1).join("; ").length <= room) told += 1;
  const headline =
    state === GOOD
      ? phrases.slice(0, told).join("; ") || "all checks pass"
      : (judged.find((one) => one.state === state)?.sentence ?? "no check applies to this run");
  const line = `${upper(state)}: ${headline}`;
  return {
    state,
    headline: line.length <= longest ? line : `${line.match(cut)[0]} …`,
    results: (state === GOOD ? phrases.slice(told) : phrases).join("; "),
    checks,
  };
}

export const upper = (words) => words.charAt(0).toUpperCase() + words.slice(1);
export const lower = (words) => words.charAt(0).toLowerCase() + words.slice(1);
const at = (time) => `${text(time, 3)} s`;
const since = (time) => (time ? `from ${at(time)} on` : "from the start");

/**
 * The verdict on a run whose sliders have moved; `figures` are its key figures, `loops` those of its loops by the track
 * of the slider, null with a reason, `why`, where no track has them; `failure` is the message of a run that stopped.
 */
export function judge(simulation, { figures, loops, why, failure, end }) {
  const { rows, kept, longest, cut } = simulation,
    remarks = kept.filter(({ key }) => key !== "stability"),
    stability = kept.filter(({ key }) => key === "stability");
  const ofLoops = stability.length ? stability : [...loopChecks(simulation, loops, why)];
  if (failure) {
    const link = /^\w+: /.test(failure) ? " in" : ":",
      stopped = end === null ? failure : `run ended at ${at(end)}${link} ${failure}`;
    const ran = plain("end", "Runs to its end", FAILED, stopped, failure);
    return verdictOf([...(loops?.unstable ? ofLoops : []), ran], [], longest, cut);
  }
  const limited = [...limitChecks(rows, figures)],
    loop = loops?.unstable ?? loops?.margin;
  const first =
    limited.length && loop && figures.saturated.at_s < loop.at_s
      ? [...limited, ...ofLoops]
      : [...ofLoops, ...limited];
  const checks = [
    ...remarks,
    ...first.filter((one) => one.sentence !== NOT_HERE),
    ...pathChecks(rows, figures),
    ...cutChecks(simulation, figures),
    ...energyChecks(simulation, figures),
    ...first.filter((one) => one.sentence === NOT_HERE),
    plain("reference", "scipy reference", UNJUDGED, "no scipy reference: not solved here"),
  ];
  return verdictOf(checks, [...resultsOf(simulation, figures, loops, checks)], longest, cut);
}

function* loopChecks({ rows, figures: { excited, open }, split }, loops, why) {
  const name = "Stability";
  if (excited)
    yield plain(
      "friction",
      "Friction",
      DOUBTFUL,
      `friction-induced oscillation, growing fastest at ${excited.place}`,
      "the loops are judged without dry friction",
    );
  if (!loops || (loops.unstable && split && !excited)) {
    const unknown = why || "dry friction may cause the growth";
    yield plain("stability", name, DOUBTFUL, NOT_HERE, unknown);
    return;
  }
  if (loops.unstable) {
    const { value, place, at_s: begin } = loops.unstable,
      more = `disturbances grow by a factor of ${text(value, 3)} in each step`;
    yield plain("stability", name, FAILED, `unstable ${since(begin)}, ${place}`, more);
    return;
  }
  const { growth: g, margin, delay } = loops,
    grown =
      g && check(rows.growth, g.value, { place: g.place, time: at(g.at_s), until: at(g.until_s) }),
    little = grown?.state === GOOD && !grown.excused;
  if (little)
    grown.sentence = `disturbances at ${g.place} grow by ${shown(rows.growth, g.value)}, ${at(g.at_s)} to ${at(g.until_s)}`;
  if (!grown || little) yield plain("stability", name, GOOD, "stable");
  if (open) {
    yield plain("feedback", "Feedback", DOUBTFUL, `nothing is fed back to ${open.place}`);
    return;
  }
  if (grown) yield grown;
  for (const [key, figure] of Object.entries({ margin, delay }))
    if (figure)
      yield check(rows[key], figure.value, { place: figure.place, time: at(figure.at_s) });
}

function* limitChecks({ saturated: row }, { saturated }) {
  if (!saturated) return;
  const { value, place, at_s: begin } = saturated;
  yield check(row, value, { place, time: since(begin) }, "without feedback there");
}

function* pathChecks(rows, { path, contact }) {
  if (!path) return;
  const row = rows[contact || path.place !== "tool" ? "joint" : "tool"],
    share = path.value / path.size,
    [error, size] = [path.value, path.size].map((value) => quantity(value, path.unit));
  const made = check(row, share, { place: path.place, error, time: at(path.at_s) });
  const whole = `maximum ${path.place} error ${error} over a motion of ${size}`;
  if (path.rest) yield { ...made, sentence: `at rest within ${error}` };
  else yield { ...made, [made.state === GOOD && !made.excused ? "sentence" : "more"]: whole };
}

const isCut = ({ stop, step }, { end }) => end > stop + 0.5 * step;

function* cutChecks(simulation, figures) {
  if (simulation.asked || !isCut(simulation, figures)) return;
  const words = `the motion of ${at(figures.end)} is cut at ${at(simulation.stop)}`;
  yield plain("motion", "Motion", DOUBTFUL, words);
}

function* energyChecks({ rows, floor }, { energy }) {
  if (!energy) return;
  const { residual, exchanged } = energy,
    places = { error: quantity(residual, "J"), place: quantity(exchanged, "J") };
  const made = check(rows.energy, residual > floor ? residual / exchanged : 0, places),
    small = `coupling energy error ${places.error} of ${places.place} exchanged`;
  yield residual > floor ? made : { ...made, sentence: small };
}

/** Phrases for the results of a run, except those that a doubtful or failed check reports. */
function* resultsOf(simulation, figures, loops, checks) {
  const stateAt = (key) => checks.find((one) => one.key === key)?.state,
    { contact, path, tool_error: tool, joint_error: worst } = figures;
  const excused = checks.filter((one) => one.excused);
  for (const { by, sentence } of excused)
    yield `only because of ${by}: ${sentence.replace(` by ${by}`, "")}`;
  if (stateAt("margin") === GOOD && excused.every(({ key }) => key !== "margin"))
    yield `modulus margin ${text(loops.margin.value, 2)}`;
  if (contact) yield `in contact ${since(contact.at_s)}, ${quantity(contact.value, "N")} at most`;
  if (path?.rest) yield "at rest";
  else if (tool && [stateAt("tool"), stateAt("joint")].every((one) => (one ?? GOOD) === GOOD))
    yield `maximum tool error ${quantity(tool.value, "m")} (at ${at(tool.at_s)})`;
  if (worst && !path?.rest)
    yield `worst joint ${worst.joint}, ${quantity(worst.value, worst.unit)}`;
  if (simulation.asked && isCut(simulation, figures))
    yield `stopped at ${at(simulation.stop)} of a motion of ${at(figures.end)}`;
}
