"""Modules of WebAssembly, and the shipped module that they call."""

import importlib.util
from pathlib import Path

import pytest
import wasmtime

from tests.compiler.wasm.linked import linked
from vdfmu.compiler.wasm import BASE_PAGES, BASE_SLOTS, INTEGER, Assembler, constant, local, unsigned
from vdfmu.study.report.scripts import base_module

ROOT = Path(__file__).parents[3]


def run(assembler: Assembler, function: int) -> int:
    module = assembler.module({"f": function})
    store, linker = linked(assembler.growth)
    return linker.instantiate(store, wasmtime.Module(store.engine, module)).exports(store)["f"](store)


@pytest.mark.parametrize("value", [0, 1, 63, 64, -1, -64, -65, 127, 128, 8191, 8192, 2**31 - 1, -(2**31)])
def test_integers_are_those_that_are_read(value):
    assembler = Assembler()
    assert run(assembler, assembler.function(b"", INTEGER, (), constant(value))) == value


def test_functions_data_and_room_are_added():
    assembler = Assembler()
    first, room, second = assembler.data(b"\7\0\0\0" * 100_000), assembler.room(5), assembler.data(b"\x09\0\0\0")
    assert (room - first, second - room) == (400_000, 8)  # on multiples of 8; the memory grows
    load = b"\x28\2\0"
    twice = assembler.function(INTEGER, INTEGER, [(1, INTEGER)], local(0) + local(0) + b"\x6a")
    slot = assembler.slot(twice)
    assert slot >= 1  # 0 is no function
    kind = unsigned(assembler._types[b"\x60\1\x7f\1\x7f"])
    call_by_slot = constant(second) + load + constant(slot) + b"\x11" + kind + b"\0"
    code = constant(first + 4) + load + call_by_slot + b"\x6a"
    assert run(assembler, assembler.function(b"", INTEGER, (), code)) == 7 + 2 * 9


def test_the_shipped_module_has_the_memory_and_the_table_that_others_count_on():
    store, linker = linked((0, 0))
    assert linker.get(store, "base", "memory").size(store) == BASE_PAGES
    assert linker.get(store, "base", "__indirect_function_table").size(store) == BASE_SLOTS


@pytest.mark.heavy
def test_the_shipped_module_is_what_the_compiler_makes():
    spec = importlib.util.spec_from_file_location("build", ROOT / "requirements" / "wasm" / "build.py")
    assert spec is not None and spec.loader is not None
    build = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(build)
    assert build.build() == base_module(), "'make vendor' writes it"
