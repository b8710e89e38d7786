"""FMUs that are components of WebAssembly: the example of the draft FMI-LS-WASM, and what a component reaches."""

from __future__ import annotations

import re
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
import wasmtime
from wasmtime import Engine, WasiConfig, wat2wasm
from wasmtime.component import Component

import vdfmu
from tests.engine.files import check_file
from vdfmu.base.errors import CosimError, SspError
from vdfmu.engine.fmu.classes import class_of
from vdfmu.engine.fmu.component import sandboxed
from vdfmu.engine.fmu.description import library_name
from vdfmu.engine.fmu.messages import MessageBox
from vdfmu.engine.inspect.abilities import described
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.plan.check import check_system
from vdfmu.engine.run.session import unpack_units

ADDER = Path(__file__).parent / "components" / "adder_wat_fmu.fmu"
"""The draft's example in WAT, of modelica/fmi-ls-wasm c1aac17, without names of functions. It imports WASI."""
SSD = """<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription" version="1.0"
 name="sum"><ssd:System name="sum"><ssd:Elements>
  <ssd:Component name="first" type="application/x-fmu-sharedlibrary" source="resources/adder.fmu"><ssd:Connectors>
   <ssd:Connector name="sum" kind="output"/></ssd:Connectors></ssd:Component>
  <ssd:Component name="second" type="application/x-fmu-sharedlibrary" source="resources/adder.fmu"><ssd:Connectors>
   <ssd:Connector name="input_a" kind="input"/></ssd:Connectors></ssd:Component>
</ssd:Elements><ssd:Connections>
 <ssd:Connection startElement="first" startConnector="sum" endElement="second" endConnector="input_a"/>
</ssd:Connections></ssd:System></ssd:SystemStructureDescription>
"""
REACHES = """(component {imports}
  (core module $memory (memory (export "memory") 1)
    (func (export "realloc") (param i32 i32 i32 i32) (result i32) i32.const 1024))
  (core instance $m (instantiate $memory))
  (core func $get (canon lower (func $asked "{function}") (memory (core memory $m "memory"))
    (realloc (core func $m "realloc"))))
  (core module $count (import "host" "get" (func $get (param i32))) (import "m" "memory" (memory 1))
    (func (export "count") (result i32) i32.const 0 call $get i32.const 4 i32.load))
  (core instance $c (instantiate $count (with "m" (instance $m)) (with "host" (instance (export "get" (func $get))))))
  (func (export "count") (result u32) (canon lift (core func $c "count"))))"""
"""A component that counts what a function of WASI lists."""
ENVIRONMENT = """(import "wasi:cli/environment@0.2.6" (instance $asked
  (export "get-environment" (func (result (list (tuple string string)))))
  (export "get-arguments" (func (result (list string))))))"""
FILES = """(import "wasi:filesystem/types@0.2.6" (instance $types (export "descriptor" (type (sub resource)))))
  (alias export $types "descriptor" (type $d))
  (import "wasi:filesystem/preopens@0.2.6" (instance $asked (alias outer 1 $d (type $e))
    (export "descriptor" (type $f (eq $e)))
    (export "get-directories" (func (result (list (tuple (own $f) string)))))))"""

MAKE = """(param "name" string) (param "token" string) (param "path" string) (param "visible" bool)
  (param "logging" bool) (param "events" bool) (param "early" bool) (param "needed" (list u32))"""
LIFT = """(memory (core memory $c "memory")) (realloc (core func $c "realloc"))"""
TYPED = """(component
  (core module $code (import "own" "new" (func $new (param i32) (result i32))) (memory (export "memory") 1)
    (func (export "realloc") (param i32 i32 i32 i32) (result i32) i32.const 4096)
    (func (export "make") (param i32 i32 i32 i32 i32 i32 i32 i32 i32 i32 i32 i32) (result i32)
      (i32.store (i32.const 0) (i32.const 1)) (i32.store (i32.const 4) (call $new (i32.const 7))) i32.const 0)
    (func (export "get") (param i32 i32 i32) (result i32) i32.const 16))
  (type $r (resource (rep i32)))
  (core func $new (canon resource.new $r))
  (core instance $c (instantiate $code (with "own" (instance (export "new" (func $new))))))
  (type $s (enum "ok" "warning" "discard" "error" "fatal"))
  (func $make {make} (result (option (own $r))) (canon lift (core func $c "make") {lift}))
  (func $get (param "self" (borrow $r)) {get} (canon lift (core func $c "get") {lift}))
  (component $names
    (import "r" (type $r0 (sub resource)))
    (type $enum (enum "ok" "warning" "discard" "error" "fatal"))
    (import "s" (type $s0 (eq $enum)))
    (import "make" (func $make {make} (result (option (own $r0)))))
    (import "get" (func $get (param "self" (borrow $r0)) {get0}))
    (export $r "co-simulation-instance" (type $r0))
    (export $s "status" (type $s0))
    (export "[static]co-simulation-instance.instantiate-co-simulation" (func $make)
      (func {make} (result (option (own $r)))))
    (export "[method]co-simulation-instance.get-float64" (func $get) (func (param "self" (borrow $r)) {get})))
  (instance $i (instantiate $names (with "r" (type $r)) (with "s" (type $s)) (with "make" (func $make))
    (with "get" (func $get))))
  (export "fmi:fmi3/co-simulation@3.0.0" (instance $i)))"""
"""A component with a getter of floats of a type of choice."""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Return a package in which an adder feeds another."""
    with zipfile.ZipFile(tmp_path / "sum.ssp", "w") as archive:
        archive.writestr("SystemStructure.ssd", SSD)
        archive.write(ADDER, "resources/adder.fmu")
    return tmp_path / "sum.ssp"


@pytest.mark.parametrize("isolate", [False, pytest.param(True, marks=pytest.mark.heavy)])
def test_the_drafts_example_adds(package: Path, isolate: bool) -> None:
    values = {"first.input_a": 1.5, "first.input_b": 2.25, "second.input_b": -0.5}
    results = vdfmu.simulate(package, stop=0.5, step=0.1, parameters=values, isolate=isolate)
    # sums of quarters are exact; an adder adds in its steps, so that its first sum reaches the next one a step later
    np.testing.assert_array_equal(results["second.sum"], [-0.5, -0.5, 3.25, 3.25, 3.25, 3.25])


@pytest.mark.heavy
def test_the_drafts_example_is_checked() -> None:
    assert check_file(ADDER) == []


def test_a_sandbox_can_be_refused(package: Path) -> None:
    with pytest.raises(SspError, match=r"no binary for this platform .*; it has wasm32-wasip2"):
        vdfmu.simulate(package, stop=0.5, step=0.1, sandbox=False)


STATUS = "enum{ok,warning,discard,error,fatal}"


@pytest.mark.parametrize(
    ("element", "result", "found"),
    [
        ("u32", "string", "string"),
        ("s32", "(result (list f64) (error $s))", f"result<list<f64>,{STATUS}>"),
        ("u32", "(result (list f32) (error $s))", f"result<list<f32>,{STATUS}>"),
        ("u32", "(result (list f64))", "result<list<f64>,_>"),
        ("u32", "(option (list f64))", "option<list<f64>>"),
        ("u32", "(tuple f64 u64)", "tuple<f64,u64>"),
    ],
)
def test_a_function_of_another_type_is_refused(tmp_path: Path, element: str, result: str, found: str) -> None:
    get = f'(param "v" (list {element})) (result {result})'
    description = described(ADDER)
    assert description is not None
    binary = tmp_path / description.binary
    binary.parent.mkdir(parents=True)
    text = TYPED.format(make=MAKE, get=get, get0=get.replace("$s", "$s0"), lift=LIFT)
    binary.write_bytes(wat2wasm(text))
    instance = class_of(description)("adder", description, tmp_path, MessageBox(lambda message: None), set())
    instance.instantiate()
    types = f"expected (borrow,list<u32>)->result<list<f64>,{STATUS}>, got (borrow,list<{element}>)->{found}"
    with pytest.raises(CosimError, match=f"get-float64 has another type .*: {re.escape(types)}$"):
        instance.access("Get", description.elements("sum"), np.zeros(1))
    assert instance.close() is None


def test_a_saved_state_may_be_empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a unit without memory."""
    description = described(ADDER)
    assert description is not None
    with zipfile.ZipFile(ADDER) as archive:
        archive.extractall(tmp_path)
    instance = class_of(description)("adder", description, tmp_path, MessageBox(lambda message: None), set())
    asked: list[bytes] = []
    monkeypatch.setattr(instance, "ask", lambda call, *values: asked.extend(v.tobytes() for v in values) or [])
    state = instance.saved_state()
    instance.restore_state(instance.fmu.deserializeFMUState(instance.fmu.serializeFMUState(state)))
    assert asked == [b""]


def test_a_forged_mark_lets_no_library_run(tmp_path: Path) -> None:
    description = described(ADDER)
    assert description is not None
    forged, system = tmp_path / "adder.fmu", tmp_path / "forged.ssp"
    shutil.copy(ADDER, forged)
    with zipfile.ZipFile(forged, "a") as archive:
        archive.writestr("extra/vdfmu/vdfmu.json", "{}")
        archive.writestr(library_name(description.identifier, description.version), b"not a library")
    with zipfile.ZipFile(system, "w") as archive:
        archive.writestr("SystemStructure.ssd", SSD)
        archive.write(forged, "resources/adder.fmu")
    checked = check_system(load_ssp(system))
    assert unpack_units(checked, tmp_path / "unpacked")[1]  # isolated, so that time and memory are limited
    values = {"first.input_a": 1.5, "first.input_b": 2.25}
    results = vdfmu.simulate(system, stop=0.5, step=0.1, parameters=values, isolate=False)
    assert results["first.sum"][-1] == 3.75
    with pytest.raises(CosimError, match="load"):
        vdfmu.simulate(system, stop=0.5, step=0.1, isolate=False, sandbox=False)


@pytest.mark.parametrize(
    ("imports", "function"),
    [(ENVIRONMENT, "get-environment"), (ENVIRONMENT, "get-arguments"), (FILES, "get-directories")],
)
def test_a_component_reaches_nothing_of_the_machine(
    imports: str, function: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    engine = Engine()
    component = Component(engine, REACHES.format(imports=imports, function=function))

    def counted() -> int:
        store, instance = sandboxed(engine, component, lambda *text: None)
        count = instance.get_func(store, "count")
        assert count is not None
        return count(store)

    assert counted() == 0
    rights = WasiConfig()
    rights.inherit_env()
    rights.argv = ["unit"]
    rights.preopen_dir(str(tmp_path), "/")
    monkeypatch.setattr(wasmtime, "WasiConfig", lambda: rights)
    assert counted() > 0  # it would reach them
