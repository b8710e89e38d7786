"""The program of a system as WebAssembly, in wasmtime: it gives the run of the FMUs, and says why it stops."""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import wasmtime

import vdfmu
from tests.compiler.wasm.linked import linked
from tests.conftest import heavy
from tests.system.moving import POSITION, REST, switched_file
from vdfmu.study.run.prepare import prepare
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.program import SystemProgram, write_module
from vdfmu.system.scenario.values import system_values


class Module:
    """A program in a module, with changed values before the start."""

    def __init__(self, scenario: Any, settings: dict[str, Any], **changed: float) -> None:
        scenario = prepare(scenario)
        self.program = SystemProgram(SystemDescription(scenario, system_values(scenario, settings)))
        content, self._address, growth = write_module(self.program)
        self._store, linker = linked(growth)
        module = wasmtime.Module(self._store.engine, content)
        self._exports = linker.instantiate(self._store, module).exports(self._store)
        self._memory = linker.get(self._store, "base", "memory")
        memory = self.program.system.memory.copy()
        for name, value in changed.items():
            memory[self.program.limits()[name][0]] = value
        self._memory.write(self._store, memory.astype("<f8").tobytes(), self._address)
        self.begun = self._exports["begin"](self._store)

    def memory(self) -> np.ndarray:
        """Values of the system."""
        end = self._address + 8 * self.program.system.memory.size
        return np.frombuffer(bytes(self._memory.read(self._store, self._address, end)), "<f8")

    def steps(self) -> Iterator[int]:
        """Yield the result of each step."""
        grid = self.program.grid
        for k in range(grid.n):
            yield self._exports["step"](self._store, grid.time(k), grid.step if k < grid.n - 1 else grid.last)


def assert_same_run(scenario: Any, settings: dict[str, Any] | None = None) -> None:
    module = Module(scenario, settings or {})
    assert module.begun == 0
    rows = [module.memory()]
    for stopped in module.steps():
        assert stopped == 0
        rows.append(module.memory())
    results = vdfmu.run(scenario, out=False, reference=False, parameters=settings)
    compared = {name: place for name, (place, _) in module.program.signals().items() if name in set(results.names)}
    assert len(compared) > 3
    for name, place in compared.items():
        column, value = np.array(rows)[:, place], results[name]
        atol = POSITION if results.units[name] == "rad" else REST * max(1.0, np.abs(value).max())
        np.testing.assert_allclose(column, value, rtol=0.0, atol=atol, err_msg=name)
    assert max(np.ptp(results[name]) for name in compared) > 1e3 * POSITION


@pytest.mark.parametrize("algorithm", ["gauss-seidel", *heavy("jacobi")])
def test_units_that_are_sampled_or_switched_by_time(tmp_path, algorithm):
    assert_same_run(prepare(switched_file(tmp_path), algorithm=algorithm), {"b.period": 0.02, "a.f": 33.0})


@pytest.mark.parametrize(("name", "options", "settings"), [
    ("planar_tracking", {"stop": 0.1}, {}),
    ("planar_tracking", {"stop": 0.05}, {"plant.solver": "fixed_2"}),
    *heavy(("planar_tracking", {"stop": 0.05, "units": {"controller": "disturbance_observer"}}, {})),
    *heavy(*((n, {"stop": 0.1}, {}) for n in ("tracking", "two_arms", "slider_tracking", "wall", "screw"))),
    *heavy(("estimation", {"stop": 0.1}, {})),
])  # fmt: skip
def test_an_arm_with_fixed_steps_or_a_sampled_law_and_the_shipped_scenarios(name, options, settings):
    assert_same_run(prepare(name, **options), settings)


def test_what_is_not_met_what_stops_and_all_reasons_for_no_program_are_told():
    scenario = prepare("planar_tracking", stop=0.2)
    module = Module(scenario, {}, **{"plant.f_s[1]": 0.01})
    words = [words for condition in module.program.conditions for words in condition.words]
    assert words[module.begun - 1] == "plant: f_s[1]: expected f_s >= f_c."
    unstable = Module(scenario, {}, **{"controller.K_v[2]": 1e9})
    assert unstable.begun == 0
    (stopped,) = {code for code in unstable.steps() if code}
    assert unstable.program.moving[stopped - 1].name == "plant"
    scenario = dataclasses.replace(prepare("planar_tracking"), algorithm="iterative", adaptive=1e-3)
    with pytest.raises(vdfmu.VdfmuError, match="algorithm: expected gauss-seidel or jacobi, got iterative\nadaptive: "):
        SystemProgram(SystemDescription(scenario))
