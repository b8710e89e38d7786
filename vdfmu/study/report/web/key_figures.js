// The key figures of a simulated run that its verdict needs, from all its rows, as vdfmu/study/run has them.

import { toolPosition } from "./arm.js";

const UNITS = { revolute: ["deg", 180 / Math.PI], prismatic: ["mm", 1e3] };
const KINDS = ["torque limit", "speed limit", "end stop"];

/** Rows of the elements of an array of signals; null if one is missing. */
function group(signals, name, n) {
  const rows = Array.from({ length: n }, (_, i) => signals.get(`${name}[${i + 1}]`));
  return name && rows.every(Boolean) ? rows : null;
}

/** Errors of joints and tool, time at limits, contact, energy of the coupling, and the end of the motion. */
export function keyFigures(run, changes) {
  const { simulation, result, arm } = run,
    { robot } = simulation;
  const figures = { ...limitFigure(simulation, result), end: motionEnd(simulation, changes) };
  if (!robot) return figures;
  const contact = contactFigure(simulation, result),
    energy = energyOf(simulation, result);
  return {
    ...figures,
    ...(contact ? { contact } : {}),
    ...(energy ? { energy } : {}),
    ...errorFigures(simulation, result, robot.comparable ? arm : null),
  };
}

/** End of the last motion, whose durations and speeds the changes of parameters scale. */
function motionEnd({ motions }, changes) {
  const factor = (unit, name) =>
    changes
      .filter((one) => one.unit === unit && one.name === name)
      .reduce((product, one) => product * (one.factor ?? 1), 1);
  return Math.max(
    0,
    ...motions.map(
      ({ unit, begin, length }) => begin + (length * factor(unit, "T")) / factor(unit, "speed"),
    ),
  );
}

/** Largest of rows that are seen one by one, its first time, for each of some quantities. */
function peaks(count) {
  const most = Array(count).fill(-Infinity),
    times = Array(count).fill(0);
  const see = (i, value, time) => {
    if (value > most[i]) [most[i], times[i]] = [value, time];
  };
  return { most, times, see };
}

function errorFigures({ robot: { types, least }, weights }, { time, signals }, arm) {
  const n = types.length,
    [qd, q] = ["trajectory.q_d", "plant.q"].map((name) => group(signals, name, n));
  if (!qd || !q) return {};
  const errors = peaks(n + 1),
    sizes = Array(n + 1).fill(0),
    distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
  const row = (rows, k) => rows.map((values) => values[k]),
    first = arm && toolPosition(arm, row(qd, 0)),
    ends = Array.from({ length: n }, () => [-Infinity, -Infinity]);
  time.forEach((t, k) => {
    types.forEach((type, i) => {
      const [, scale] = UNITS[type];
      errors.see(i, Math.abs(scale * (qd[i][k] - q[i][k])), t);
      ends[i] = [Math.max(ends[i][0], scale * qd[i][k]), Math.max(ends[i][1], -scale * qd[i][k])];
    });
    if (!arm) return;
    const desired = toolPosition(arm, row(qd, k));
    errors.see(n, distance(desired, toolPosition(arm, row(q, k))), t);
    sizes[n] = Math.max(sizes[n], distance(desired, first));
  });
  ends.forEach(([high, low], i) => {
    sizes[i] = high + low;
  });
  const unit = (i) => UNITS[types[i]][0],
    figureAt = (i) => ({ value: errors.most[i], at_s: errors.times[i] });
  const joints = types.map((_, i) => i).filter((i) => unit(i) === unit(0)),
    worst = joints.reduce((a, b) => (errors.most[b] > errors.most[a] ? b : a));
  return {
    joint_error: { ...figureAt(worst), unit: unit(worst), joint: worst + 1 },
    ...(arm ? { tool_error: figureAt(n) } : {}),
    path: pathOf(types, errors, sizes, least, weights, arm),
  };
}

/** The error that is worst for its motion: of the tool, or of a joint against the largest of its kind. */
function pathOf(types, errors, sizes, least, [ofJoint, ofTool], arm) {
  const n = types.length;
  const size = least.map((small, i) =>
    i < n
      ? Math.max(small, ...types.flatMap((type, j) => (type === types[i] ? [sizes[j]] : [])))
      : arm
        ? Math.max(sizes[n], small)
        : Infinity,
  );
  const share = size.map((one, i) => (arm || i < n ? errors.most[i] / one : 0)),
    rank = share.map((one, i) => [one > ofJoint ? 1 : 0, one / (i < n ? ofJoint : ofTool)]);
  let worst = 0;
  rank.forEach(([lost, off], i) => {
    const [most, far] = rank[worst];
    if (lost > most || (lost === most && off >= far)) worst = i;
  });
  return {
    value: errors.most[worst],
    size: size[worst],
    unit: worst < n ? UNITS[types[worst]][0] : "m",
    place: worst < n ? `joint ${worst + 1}` : "tool",
    at_s: errors.times[worst],
    rest: sizes.every((one) => one === 0),
  };
}

/** The largest force at the tool, and its begin. */
function contactFigure({ touch }, { time, signals }) {
  const force = group(signals, touch, 3);
  if (!force) return null;
  const sizes = Array.from(time, (_, k) => Math.hypot(force[0][k], force[1][k], force[2][k])),
    begin = sizes.findIndex((size) => size > 0);
  return begin < 0
    ? null
    : { value: sizes.reduce((a, b) => Math.max(a, b)), unit: "N", at_s: time[begin] };
}

/** Energy that the coupling of controller and plant adds or takes, and that it exchanges, in all [J]. */
function energyOf({ robot: { ell } }, { time, signals }) {
  const names = ["plant.tau", "plant.kappa_dot", "controller.tau", "controller.kappa_dot"],
    [tau, speed, sent, read] = names.map((name) => group(signals, name, ell.length));
  if (!tau || !speed || !sent || !read) return null;
  let residual = 0,
    exchanged = 0;
  ell.forEach((ratio, i) => {
    for (let k = 1; k < time.length; k += 1) {
      const h = time[k] - time[k - 1],
        taken = ratio * tau[i][k] * speed[i][k];
      residual += Math.abs(0.5 * h * (taken - ratio * sent[i][k] * read[i][k]));
      exchanged += Math.abs(h * taken);
    }
  });
  return { residual, exchanged };
}

const clip = (value, low, high) => Math.min(Math.max(value, low), high);

/** Whether a motor is at its largest torque, is limited by its speed, and a stop pushes: vdfmu/arm/drive/limits.py. */
function atLimits(robot, i, tau, speed, q) {
  if (!robot) return [false, false, false];
  const stall = robot.tau_stall[i],
    full = robot.full_speed[i],
    share = speed / robot.kappa_dot_max[i];
  const [forward, backward] = [share, -share].map((s) => clip((1 - s) / (1 - full), 0, 1)),
    size = Math.abs(clip(tau, -stall * backward, stall * forward));
  const less = size < Math.abs(tau),
    whole = size >= stall;
  return [less && whole, less && !whole, q < robot.q_min[i] || q > robot.q_max[i]];
}

/** The joint that was longest at a limit, if for at least the least share that is reported. */
function limitFigure({ arms, limited }, { time, signals }) {
  const rowsOf = ({ plant, asked, tau_max: { length } }) =>
      [asked, `${plant}.q`, `${plant}.kappa_dot`].map((name) => group(signals, name, length)),
    recorded = arms.filter((arm) => rowsOf(arm).every(Boolean)),
    span = Math.max(time.at(-1) - time[0], Number.MIN_VALUE);
  let worst = { value: limited, place: "", at_s: 0 };
  for (const { plant, asked, tau_max: most, robot } of recorded) {
    const [tau, q, speed] = rowsOf({ plant, asked, tau_max: most }),
      spent = KINDS.map(() => most.map(() => ({ share: 0, since: Infinity })));
    most.forEach((limit, i) => {
      time.forEach((t, k) => {
        const there = atLimits(robot, i, tau[i][k], speed[i][k], q[i][k]);
        there[0] ||= Math.abs(tau[i][k]) >= limit;
        there.forEach((one, kind) => {
          if (!one) return;
          const entry = spent[kind][i];
          entry.since = Math.min(entry.since, t);
          if (k) entry.share += (t - time[k - 1]) / span;
        });
      });
    });
    let chosen = [0, 0];
    spent.forEach((joints, kind) =>
      joints.forEach(({ share }, i) => {
        if (share > spent[chosen[0]][chosen[1]].share) chosen = [kind, i];
      }),
    );
    const { share, since } = spent[chosen[0]][chosen[1]],
      of = recorded.length > 1 ? ` of ${plant}` : "";
    if (share >= worst.value)
      worst = {
        value: share,
        place: `${KINDS[chosen[0]]} of joint ${chosen[1] + 1}${of}`,
        at_s: since,
      };
  }
  return worst.place ? { saturated: worst } : {};
}
