// The run again, in a worker: a module from vdfmu/system/program.py, in the memory of the shipped module.

import { unzip } from "./packed.js";

const PARTS = 50;
const compiled = new Map();

/** The module of a digest: decompressed and compiled once. @returns {Promise<WebAssembly.Module>} */
function moduleOf(digest, binaries) {
  if (!compiled.has(digest)) {
    compiled.set(
      digest,
      unzip(binaries[digest])
        .arrayBuffer()
        .then((module) => WebAssembly.compile(module)),
    );
  }
  return compiled.get(digest);
}

/** The limit that a value breaks, in words; empty if it breaks none. */
function wanted(value, least, most) {
  if (!Number.isFinite(value)) return "finite";
  if (least !== null && value < least)
    return value <= 0 && least > 0 ? "above 0" : `at least ${least}`;
  return most !== null && value > most ? `at most ${most}` : "";
}

/** The values of a system before its start, after changes of its parameters. */
function changed({ memory, units }, changes) {
  const values = Float64Array.from(memory);
  for (const { unit, name, factor, value } of changes) {
    const { parameters } = units.find((one) => one.name === unit) ?? {};
    if (!parameters) throw new Error(`There is no unit ${unit}.`);
    const chosen = Object.entries(parameters).filter(
      ([one]) => one === name || one.startsWith(`${name}[`),
    );
    if (!chosen.length) throw new Error(`${unit} has no parameter ${name}.`);
    for (const [one, [place, , least, most]] of chosen) {
      values[place] = value ?? factor * values[place];
      const words = wanted(values[place], least, most);
      if (words) throw new Error(`${unit}: ${one} must be ${words}, got ${values[place]}.`);
    }
  }
  return values;
}

/**
 * Run a system; `changes` of its parameters are {unit, name, factor} or {unit, name, value}, where a name without an
 * index means all elements. Gives time, signals by their names, and the wall time of the steps in seconds; so does
 * `found` of the Error of a run that fails on its way, up to there.
 * @param {(part: number) => void} progress
 */
async function simulate(simulation, binaries, changes = [], progress) {
  const { growth, address, memory, names, places, start, step, steps, last, conditions, moving } =
    simulation;
  const [module, shipped] = await Promise.all([
    moduleOf(simulation.module, binaries),
    moduleOf(simulation.base, binaries),
  ]);
  /** @type {{ exports: any }} */
  const { exports: base } = await WebAssembly.instantiate(shipped, {});
  base.memory.grow(growth[0]);
  base.__indirect_function_table.grow(growth[1]);
  /** @type {{ exports: any }} */
  const { exports } = await WebAssembly.instantiate(module, { base });
  const began = performance.now();
  const values = new Float64Array(base.memory.buffer, address, memory.length);
  values.set(changed(simulation, changes));
  const unmet = exports.begin();
  if (unmet) throw new Error(conditions[unmet - 1]);
  const width = names.length,
    rows = new Float64Array(width * (steps + 1)),
    stride = Math.ceil(steps / PARTS);
  let kept = 0;
  const keep = (k) => {
    for (let i = 0; i < width; i += 1) {
      const value = (rows[k * width + i] = values[places[i]]);
      if (!Number.isFinite(value))
        throw new Error(`${names[i]} is not finite at t = ${start + k * step} s.`);
    }
    kept = k + 1;
  };
  const advance = (k) => {
    const time = start + k * step,
      stopped = exports.step(time, k < steps - 1 ? step : last);
    if (stopped)
      throw new Error(
        `${moving[stopped - 1]}: doStep at t = ${time} s failed: the internal step reached its minimum. Check its inputs and the gains behind them, its start and its parameters, or loosen the tolerance.`,
      );
    keep(k + 1);
  };
  const found = () => ({
    time: Float64Array.from({ length: kept }, (_, k) =>
      k < steps ? start + k * step : simulation.stop,
    ),
    signals: new Map(
      names.map((name, i) => [
        name,
        Float64Array.from({ length: kept }, (_, k) => rows[k * width + i]),
      ]),
    ),
    seconds: (performance.now() - began) / 1e3,
  });
  keep(0);
  for (let k = 0; k < steps; k += 1) {
    try {
      advance(k);
    } catch (error) {
      throw Object.assign(error, { found: found() });
    }
    if (k % stride === 0) progress(k / steps);
  }
  return found();
}

let binaries;
/** The first message brings the modules, every other one a run. */
addEventListener("message", async ({ data }) => {
  binaries ??= data.binaries;
  if (!data.simulation) return;
  const run = simulate(data.simulation, binaries, data.changes, (part) => postMessage({ part }));
  const { found, error } = await run.then(
    (result) => ({ found: result, error: undefined }),
    ({ message, found: result }) => ({ found: result, error: message }),
  );
  const transfer = [found?.time, ...(found?.signals.values() ?? [])];
  postMessage({ found, error }, { transfer: transfer.flatMap((array) => array?.buffer ?? []) });
});
