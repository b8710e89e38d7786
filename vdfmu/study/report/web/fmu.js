// A unit: a module of WebAssembly with the functions of FMI 2.0, and calls into it.

/** A module that exports the function which it imports: a table of functions takes no other than exported ones. */
const CALLBACK = new Uint8Array([
  0, 97, 115, 109, 1, 0, 0, 0,
  1, 10, 1, 96, 6, 127, 127, 127, 127, 127, 127, 0, // a function of six integers
  2, 7, 1, 1, 101, 1, 102, 0, 0, // imported as e.f
  7, 5, 1, 1, 102, 0, 0, // exported as f
]);

const VALUES = { Real: Float64Array, Integer: Int32Array, Boolean: Int32Array };

export class Fmu {
  /** Instantiate a compiled module for co-simulation; `token` is the GUID of its model description. */
  constructor(module, name, token) {
    this.name = name;
    this.message = "";
    this.functions = new WebAssembly.Instance(module, {}).exports;
    this.functions._initialize();
    const { fmi2Instantiate, __indirect_function_table: table } = this.functions;
    const log = (environment, instance, status, category, text) => { this.message = this.text(text).replaceAll("%%", "%"); };
    const logger = table.grow(1);
    table.set(logger, new WebAssembly.Instance(new WebAssembly.Module(CALLBACK), { e: { f: log } }).exports.f);
    const callbacks = this.allocate(Int32Array, 5); // logger, allocateMemory, freeMemory, stepFinished, environment
    this.view(Int32Array, callbacks, 5).set([logger, 0, 0, 0, 0]);
    this.component = fmi2Instantiate(this.string(name), 1, this.string(token), 0, callbacks, 0, 0);
    if (!this.component) throw new Error(this.message || `${name}: there is no memory for it.`);
  }

  /** Call a function; a status above warning is an Error with the unit's message. */
  call(name, ...values) {
    if (this.functions[`fmi2${name}`](this.component, ...values) > 1) throw new Error(this.message || `${this.name}: ${name} failed.`);
  }

  /** Set values of a type by their references. */
  set(kind, references, values) {
    const moved = this.transfer("Set", kind, references);
    moved.values().set(values);
    moved.run();
  }

  /** Get values of a type by their references. */
  get(kind, references) {
    const moved = this.transfer("Get", kind, references);
    moved.run();
    return moved.values();
  }

  /** Sets or gets values of the same references again and again, in the memory of the module. */
  transfer(verb, kind, references) {
    const n = references.length, Kind = VALUES[kind], run = this.functions[`fmi2${verb}${kind}`];
    const at = this.allocate(Int32Array, n), place = this.allocate(Kind, n);
    this.view(Int32Array, at, n).set(references);
    let view = this.view(Kind, place, n);
    return {
      /** The values; a view of the memory, which ends when that grows. */
      values: () => (view.length === n ? view : (view = this.view(Kind, place, n))),
      run: () => { if (n && run(this.component, at, n, place) > 1) throw new Error(this.message || `${this.name}: ${verb.toLowerCase()}${kind} failed.`); },
    };
  }

  allocate(Kind, n) {
    const place = this.functions.malloc(Kind.BYTES_PER_ELEMENT * Math.max(n, 1));
    if (!place) throw new Error(`${this.name}: there is no memory for its values.`);
    return place;
  }

  view(Kind, place, n) {
    return new Kind(this.functions.memory.buffer, place, n);
  }

  string(text) {
    const bytes = new TextEncoder().encode(`${text}\0`), place = this.allocate(Uint8Array, bytes.length);
    this.view(Uint8Array, place, bytes.length).set(bytes);
    return place;
  }

  text(place) {
    const bytes = new Uint8Array(this.functions.memory.buffer, place);
    return new TextDecoder().decode(bytes.subarray(0, bytes.indexOf(0)));
  }
}
