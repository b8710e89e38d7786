"""FMUs that are components of WebAssembly: the example of the draft FMI-LS-WASM, and what a component reaches."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
from wasmtime import Engine
from wasmtime.component import Component

import vdfmu
from vdfmu.base.errors import SspError
from vdfmu.engine.fmu.component import sandboxed
from vdfmu.engine.inspect.inspection import check_file

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


@pytest.mark.parametrize(
    ("imports", "function"),
    [(ENVIRONMENT, "get-environment"), (ENVIRONMENT, "get-arguments"), (FILES, "get-directories")],
)
def test_a_component_reaches_nothing_of_the_machine(imports: str, function: str) -> None:
    engine = Engine()
    component = Component(engine, REACHES.format(imports=imports, function=function))
    store, instance = sandboxed(engine, component, lambda *text: None)
    count = instance.get_func(store, "count")
    assert count is not None
    assert count(store) == 0
