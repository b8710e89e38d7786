// The run again, in a worker: the exchange of values is that of `SampledStepper` in vdfmu/engine/masters/exchange.py.

import { Fmu } from "./fmu.js";
import { unzip } from "./packed.js";

const PARTS = 50;
const compiled = new Map();

/** The module of a digest: decompressed and compiled once. */
function moduleOf(digest, binaries) {
  if (!compiled.has(digest)) {
    compiled.set(digest, unzip(binaries[digest]).arrayBuffer().then((module) => WebAssembly.compile(module)));
  }
  return compiled.get(digest);
}

/** Start values of a unit, after changes of its parameters. */
function startOf(unit, changes) {
  const real = new Map((unit.start.Real?.[0] ?? []).map((reference, k) => [reference, unit.start.Real[1][k]]));
  for (const { name, factor, value } of changes.filter((change) => change.unit === unit.name)) {
    const chosen = Object.entries(unit.parameters).filter(([one]) => one === name || one.startsWith(`${name}[`));
    if (!chosen.length) throw new Error(`${unit.name} has no parameter ${name}.`);
    for (const [, [reference, own]] of chosen) real.set(reference, value ?? factor * (real.get(reference) ?? own));
  }
  return { ...unit.start, Real: [[...real.keys()], [...real.values()]] };
}

/** The units, after their initialization. */
function initialized(simulation, modules, changes) {
  const { units, start, stop } = simulation;
  for (const { unit } of changes) if (!units.some(({ name }) => name === unit)) throw new Error(`There is no unit ${unit}.`);
  const fmus = units.map((unit, k) => new Fmu(modules[k], unit.name, unit.token));
  fmus.forEach((fmu, k) => {
    fmu.call("SetupExperiment", 0, 0, start, 1, stop);
    for (const [kind, [references, values]] of Object.entries(startOf(units[k], changes))) fmu.set(kind, references, values);
  });
  for (const fmu of fmus) fmu.call("EnterInitializationMode");
  for (const [from, source, to, sink, factor, offset] of simulation.initial) {
    fmus[to].set("Real", [sink], [factor * fmus[from].get("Real", [source])[0] + offset]);
  }
  for (const fmu of fmus) fmu.call("ExitInitializationMode");
  return fmus;
}

/**
 * Run a system; `changes` of its parameters are {unit, name, factor} or {unit, name, value}, where a name without an
 * index means all elements. Gives time, signals by their names, and the wall time of the steps in seconds; so does
 * `found` of the Error of a run that fails on its way, up to there.
 */
export async function simulate(simulation, binaries, changes = [], { progress = () => {}, cancel = () => false } = {}) {
  const { units, order, start, step, steps, last } = simulation;
  const modules = await Promise.all(units.map((unit) => moduleOf(unit.binary, binaries)));
  const began = performance.now();
  const fmus = initialized(simulation, modules, changes);
  const names = units.flatMap((unit) => unit.names), width = names.length;
  const now = new Float64Array(width), rows = new Float64Array(width * (steps + 1));
  let first = 0, kept = 0;
  const stages = units.map((unit, k) => {
    const stage = {
      sources: Int32Array.from(unit.sources), fresh: unit.fresh, conversions: unit.conversions, first,
      inputs: fmus[k].transfer("Set", "Real", unit.inputs), outputs: fmus[k].transfer("Get", "Real", unit.outputs),
      component: fmus[k].component, doStep: fmus[k].functions.fmi2DoStep, fmu: fmus[k],
    };
    first += unit.outputs.length;
    return stage;
  });
  const bring = ({ sources, inputs, conversions }, from, to) => {
    const values = inputs.values();
    for (let i = from; i < to; i += 1) values[i] = now[sources[i]];
    for (const [i, factor, offset] of conversions) if (i >= from && i < to) values[i] = factor * values[i] + offset;
  };
  const read = ({ outputs, first: place }) => {
    outputs.run();
    now.set(outputs.values(), place);
  };
  const keep = (k) => {
    let sum = 0;
    for (let i = 0; i < width; i += 1) sum += 0 * now[i];
    if (sum !== 0) throw new Error(`${names[now.findIndex((value) => !Number.isFinite(value))]} is not finite at t = ${start + k * step} s.`);
    rows.set(now, k * width);
    kept = k + 1;
  };
  const found = () => ({
    time: Float64Array.from({ length: kept }, (_, k) => (k < steps ? start + k * step : simulation.stop)),
    signals: new Map(names.map((name, i) => [name, Float64Array.from({ length: kept }, (_, k) => rows[k * width + i])])),
    seconds: (performance.now() - began) / 1e3,
  });
  stages.forEach(read);
  keep(0);
  const stages_in_order = order.map((k) => stages[k]), stride = Math.ceil(steps / PARTS);
  const advance = (k) => {
    const time = start + k * step, size = k < steps - 1 ? step : last;
    for (const stage of stages) bring(stage, stage.fresh, stage.sources.length); // held: as they were at the start of the step
    for (const stage of stages_in_order) {
      bring(stage, 0, stage.fresh);
      stage.inputs.run();
      if (stage.doStep(stage.component, time, size, 1) > 1) throw new Error(stage.fmu.message);
      read(stage);
    }
    keep(k + 1);
  };
  for (let k = 0; k < steps; k += 1) {
    try {
      advance(k);
    } catch (error) {
      throw Object.assign(error, { found: found() });
    }
    if (k % stride === 0) {
      progress(k / steps);
      if (cancel()) throw new DOMException("The run was stopped.", "AbortError");
    }
  }
  return found();
}

/** In a worker: the first message brings the modules, every other one a run. */
if (typeof WorkerGlobalScope !== "undefined") {
  let binaries;
  addEventListener("message", async ({ data }) => {
    binaries ??= data.binaries;
    if (!data.simulation) return;
    const run = simulate(data.simulation, binaries, data.changes, { progress: (part) => postMessage({ part }) });
    const { found, error } = await run.then((one) => ({ found: one }), ({ message, found: one }) => ({ found: one, error: message }));
    postMessage({ found, error }, found ? [found.time.buffer, ...Array.from(found.signals.values(), ({ buffer }) => buffer)] : []);
  });
}
