"""Runs against the methods of the units in numpy, with the scenario's parameters: no trace, no cache, no C.

FMUs and references share trace and cache, and so their faults. Here start states and outputs of all components follow
from their inputs and states by the units' own methods. That states move by their derivatives is in
`tests/compiler/fmu/test_equations.py`, and for other units in `tests/compiler/fmu/test_own_units.py`.
"""

import numpy as np
import pytest

import vdfmu
from tests.conftest import heavy
from vdfmu.compiler.unit.evaluate import Plain
from vdfmu.compiler.unit.interface import Interface
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.scenario import load_scenario

# Both sides round: a chain of n operations by up to 1e-16 n. An output of six joints takes 1e4 operations, and some
# cancel: three digits are for them. Accelerations cancel more, but are no outputs.
ROUNDING = 1e-9
SCENARIOS = ["planar_tracking", *heavy("tracking", "wall", "slider_tracking", "screw", "estimation", "two_joint")]
BACKENDS = ["native", *heavy("python")]


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("name", SCENARIOS)
def test_the_rows_of_a_run_follow_from_the_methods_of_its_units(name, backend):
    system = SystemDescription(load_scenario(name))
    results = vdfmu.run(name, stop=0.1, reference=False, out=False, record=["*"], backend=backend)
    units = {unit: each for unit, each in system.tables.items() if isinstance(each, Interface)}
    assert units
    for unit, table in units.items():
        plain = Plain(table, table.memory_of(system.values[unit]))
        names = [v.name for v in table.memory]
        states = {*range(*table.states.indices(len(names)))}
        states |= {k for k, v in enumerate(table.memory) if v.variability == "discrete"}
        recorded = {k: results[f"{unit}.{each}"] for k, each in enumerate(names) if f"{unit}.{each}" in results}
        outputs = [k for k in recorded if table.memory[k].causality == "output"]
        groups = np.unique([table.memory[k].group for k in outputs], return_inverse=True)[1]
        for row in (0, 21, 47, 100):
            for k in recorded.keys() - set(outputs) if row == 0 else recorded.keys() - (set(outputs) - states):
                plain.memory[k] = recorded[k][row]
            plain.memory[-1] = results.time[row]
            if row == 0:
                plain.start()
            plain.outputs()
            actual, expected = np.array([recorded[k][row] for k in outputs]), plain.memory[outputs]
            sizes = np.zeros(groups.max() + 1)
            np.maximum.at(sizes, groups, np.abs(expected))
            apart = np.abs(actual - expected) / np.maximum(sizes[groups], np.spacing(np.abs(expected).max()))
            assert apart.max() < ROUNDING, (row, unit, names[outputs[int(apart.argmax())]])
