"""The shipped module in wasmtime, for modules that work in its memory."""

import wasmtime

from vdfmu.study.report.scripts import base_module


def linked(growth: tuple[int, int]) -> tuple[wasmtime.Store, wasmtime.Linker]:
    engine = wasmtime.Engine()
    store, linker = wasmtime.Store(engine), wasmtime.Linker(engine)
    base = wasmtime.Instance(store, wasmtime.Module(engine, base_module()), [])
    linker.define_instance(store, "base", base)
    exports = base.exports(store)
    exports["memory"].grow(store, growth[0])
    exports["__indirect_function_table"].grow(store, growth[1], None)
    return store, linker
