// The page's own run: master.js in a worker, and the difference of its results from the recorded ones.

import { unpack } from "./data.js";

export class SimulationWorker {
  /** `binaries`: digest to the module, compressed, in base64. */
  constructor(binaries) {
    this.binaries = binaries;
    /** Ends the promise of the run that is under way. @type {((reason: Error) => void) | null} */
    this.waiting = null;
    /** @type {Worker | null} */
    this.worker = null;
  }

  /** Make the worker from the text of its modules, which the page has. */
  start() {
    const text = document.getElementById("worker").textContent;
    const address = URL.createObjectURL(new Blob([text], { type: "text/javascript" }));
    this.worker = new Worker(address);
    URL.revokeObjectURL(address);
    this.worker.postMessage({ binaries: this.binaries });
  }

  /**
   * Simulate, as master.js does; a run that is under way is stopped.
   * @param {object[]} [changes]
   * @param {(part: number) => void} [progress]
   */
  run(simulation, changes = [], progress = () => {}) {
    this.cancel();
    if (!this.worker) this.start();
    return new Promise((done, failed) => {
      this.waiting = failed;
      const end = (action, value) => {
        this.waiting = null;
        action(value);
      };
      this.worker.onmessage = ({ data }) => {
        if (data.error) end(failed, Object.assign(new Error(data.error), { found: data.found }));
        else if (data.found) end(done, data.found);
        else progress(data.part);
      };
      this.worker.onerror = (event) => end(failed, new Error(event.message));
      this.worker.postMessage({ simulation, changes });
    });
  }

  /** Stop the run that is under way; its promise fails with an AbortError. */
  cancel() {
    if (!this.waiting) return;
    this.worker.terminate();
    this.worker = null;
    this.waiting(new DOMException("The run was stopped.", "AbortError"));
    this.waiting = null;
  }
}

/** Largest difference from the recorded rows, of the signals by which a run is judged. */
export function difference(simulation, { signals }) {
  const { rows, names, values, judged, limit } = simulation.recorded,
    recorded = unpack(values, Float64Array);
  const positions = judged.flatMap((name) => {
    const own = signals.get(name),
      i = names.indexOf(name);
    return rows.map((row, j) => Math.abs(own[row] - recorded[j * names.length + i]));
  });
  return { limit, position: Math.max(...positions) };
}
