"""Units as WebAssembly, in wasmtime: what a module has and asks for, its numbers, its messages."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
import wasmtime

from tests.compiler.conftest import alone
from tests.compiler.native.binding import ERROR, OK, Instance, Model
from tests.compiler.native.fmi_types import signatures
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.platforms import this_platform

pytestmark = pytest.mark.heavy
VERSIONS = ("2.0", "3.0")


class Module:
    """A unit in a module of its own, for co-simulation: calls with numbers, and arrays in its memory."""

    def __init__(self, model: Model, path: Path) -> None:
        self.model, self.messages, self.time = model, list[str](), 0.0
        engine = wasmtime.Engine()
        self.store, self.module = wasmtime.Store(engine), wasmtime.Module.from_file(engine, str(path))
        self.exports = wasmtime.Instance(self.store, self.module, []).exports(self.store)
        self.exports["_initialize"](self.store)
        integer, table = wasmtime.ValType.i32(), self.exports["__indirect_function_table"]
        arguments, first = (6, 4) if model.major == "2" else (4, 3)  # FMI 2's logger has the arguments of a format
        kind = wasmtime.FuncType([integer] * arguments, [])
        logger = table.grow(self.store, 1, wasmtime.Func(self.store, kind, lambda *a: self._log(a[first])))
        name, token = (self.string(text) for text in ("unit", model.guid))
        if model.major == "2":
            callbacks = self.place(struct.pack("<5i", logger, 0, 0, 0, 0))
            self.unit = self._function("Instantiate")(name, 1, token, 0, callbacks, 0, 0)
        else:
            start = self._function("InstantiateCoSimulation")
            self.unit = start(name, token, 0, 0, 0, 0, 0, 0, 0, 0, logger, 0)

    def _log(self, text: int) -> None:
        content = bytes(self.exports["memory"].read(self.store, text, text + 500))
        self.messages.append(content.split(b"\0")[0].decode())

    def _function(self, name: str) -> Callable[..., int]:
        function = self.exports[f"fmi{self.model.major}{name}"]
        return lambda *arguments: function(self.store, *arguments)

    def place(self, content: bytes) -> int:
        """Put bytes into the memory."""
        address = self.exports["malloc"](self.store, len(content))
        self.exports["memory"].write(self.store, content, address)
        return address

    def string(self, text: str) -> int:
        """Put a text into the memory."""
        return self.place(text.encode() + b"\0")

    def call(self, name: str, *arguments: Any) -> int:
        """Call a function of FMI with this instance and return its status."""
        return self._function(name)(self.unit, *arguments)

    def values(self, verb: str, group: str, values: Any = None) -> tuple[int, np.ndarray]:
        """Get or set all of a group of real variables; the status, and the values."""
        chosen = self.model.group(group)
        numbers = np.zeros(sum(len(v.names) for v in chosen))
        numbers[:] = 0.0 if values is None else values
        references = self.place(struct.pack(f"<{len(chosen)}I", *(v.reference for v in chosen)))
        place = self.place(numbers.astype("<f8").tobytes())
        more = () if self.model.major == "2" else (len(numbers),)
        kind = "Real" if self.model.major == "2" else "Float64"
        status = self.call(f"{verb}{kind}", references, len(chosen), place, *more)
        content = self.exports["memory"].read(self.store, place, place + 8 * len(numbers))
        return status, np.frombuffer(bytes(content), "<f8")

    def start(self, **values: Any) -> Module:
        """Set values and take the unit through initialization."""
        for group, value in values.items():
            assert self.values("Set", group, value)[0] == OK
        if self.model.major == "2":
            assert self.call("SetupExperiment", 0, 0.0, 0.0, 0, 0.0) == OK
            assert self.call("EnterInitializationMode") == OK
        else:
            assert self.call("EnterInitializationMode", 0, 0.0, 0.0, 0, 0.0) == OK
        assert self.call("ExitInitializationMode") == OK
        return self

    def step(self, size: float, **inputs: Any) -> Module:
        """Set inputs and make a step from where the last one ended."""
        for group, value in inputs.items():
            assert self.values("Set", group, value)[0] == OK
        flags = () if self.model.major == "2" else tuple(self.place(bytes(8)) for _ in range(4))
        assert self.call("DoStep", self.time, size, 1, *flags) == OK, self.messages
        self.time += size
        return self


@pytest.fixture(scope="module", params=VERSIONS)
def wasm(request, planar, tmp_path_factory, kernel_cache):
    version = request.param
    out = tmp_path_factory.mktemp(f"wasm_{version[0]}")
    with alone(kernel_cache):
        fmus = build_fmus(
            planar, out, units=["plant", "feedforward"], backend="native", fmi_version=version,
            platforms=[this_platform(), "wasm32"], folded=True)  # fmt: skip
    folders = {unit: Path(fmpy.extract(fmu, out / unit)) for unit, fmu in fmus.items()}
    return {
        unit: (Model(folder), folder / "binaries" / "wasm32" / f"{fmus[unit].stem}.wasm")
        for unit, folder in folders.items()
    }


@pytest.mark.parametrize("unit", ["plant", "feedforward"])
def test_a_module_has_the_functions_of_fmi_and_asks_for_nothing(wasm, unit):
    model, path = wasm[unit]
    module = Module(model, path).module
    assert [(entry.module, entry.name) for entry in module.imports] == []
    support = {"memory", "malloc", "free", "_initialize", "__indirect_function_table", "__stack_pointer"}
    functions = {f"fmi{model.major}{name}" for name in signatures(model.version)}
    assert {entry.name for entry in module.exports} - support == functions


def test_the_plant_moves_as_the_library_of_this_machine_does(wasm):
    model, path = wasm["plant"]
    module, native = Module(model, path), Instance(model)
    module.start(q_0=[0.3, -0.2])
    native.start(q_0=[0.3, -0.2])
    for k in range(200):
        tau = [0.02 * np.sin(0.05 * k), -0.01]
        module.step(1e-3, tau=tau)
        native.step(1e-3, tau=tau)
        for group in ("q", "kappa_dot", "tau_s", "E_kin"):
            actual, expected = module.values("Get", group)[1], native.get(group)
            np.testing.assert_array_equal(actual, expected, err_msg=f"{group}, step {k}")
    assert np.ptp([*native.get("q"), 0.3]) > 1e-3  # it has moved
    native.free()


def test_a_call_that_fails_says_why(wasm):
    model, path = wasm["plant"]
    module = Module(model, path)
    assert module.values("Set", "mass", -1.0)[0] == ERROR
    assert "failed: mass[1]: expected a number above 0, got -1 kg." in module.messages[-1]
    module.start()
    assert module.values("Set", "tau", np.nan)[0] == ERROR
    assert "tau[1]: expected a finite number, got nan N.m." in module.messages[-1]
    module.step(1e-3, tau=0.0)  # the instance can be used on
