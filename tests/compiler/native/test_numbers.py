"""The numbers: both versions of FMI, co-simulation and model exchange, and the Python FMU agree.

tests/compiler/fmu/test_equations.py holds the native units against the numpy equations.
"""

from typing import Any

import fmpy
import numpy as np
import pytest

from tests.compiler.native.binding import same_bits
from tests.compiler.native.driven import drive
from tests.conftest import heavy


def test_each_form_gives_the_same_numbers(native, unit_name, robot_name):
    """The versions of FMI the same bits, and the Python unit the same but for functions of another library."""
    # All run the same traced operations; the compilers contract and reorder none. Only sin, tanh and their like may
    # differ by a unit in the last place, which the states' feedback does not grow within 25 ms: 1e-12 of the largest
    # value is some thousand units. The plant's step control may take the other side of a decision at such a difference,
    # then the solver's tolerance 1e-7 would show: with the same h it does not.
    size = 5e-4 if unit_name == "estimator" else 0.05  # beyond some 0.01 rad its estimates are at their limit
    two, three, python = (
        drive(native(unit_name, version, robot_name).start(), 0, 25, size) for version in ("2.0", "3.0", "python")
    )
    assert two.shape[1] > 0
    assert same_bits(two, three)
    assert len(np.unique(two, axis=0)) == 25
    assert np.all(np.abs(two - python) <= 1e-12 * (1.0 + np.abs(python).max(axis=0)))


@pytest.mark.parametrize("robot", ["planar_2dof", *heavy("manipulator_6dof")])
def test_co_simulation_and_model_exchange_under_cvode_are_the_same_motion(native, native_fmu, version, robot):
    """CVODE of fmpy at relative tolerance 1e-10, the unit's own solver at 1e-10: the issue asks for 1e-7 rad."""
    # fmpy gives CVODE the absolute tolerance 1e-10 times the nominal values, 1. Errors of some thousand steps add up
    # to some 1e-8 in tau_s, divided by the stiffness, 1e4 N.m/rad, far less in q.
    fmu = native_fmu("plant", version, robot)
    start = {"q_0[1]": 0.3, "q_0[2]": -0.2}
    step, stop = 1e-3, 0.1  # CVODE may make 500 steps of its own between two outputs
    n = 2 if robot == "planar_2dof" else 6
    names = [f"q[{i + 1}]" for i in range(n)]
    start_values: dict[str, Any] = dict(start)
    output: list[str] = names
    if version == "3.0":  # arrays have one start value, and one column
        q_0 = np.zeros(n)
        q_0[:2] = 0.3, -0.2
        start_values, output = {"q_0": q_0}, ["q"]
    result = fmpy.simulate_fmu(
        str(fmu), fmi_type="ModelExchange", stop_time=stop, output_interval=step, relative_tolerance=1e-10,
        start_values=start_values, output=output, solver="CVode",
    )  # fmt: skip
    exchange = np.column_stack([result[name].reshape(len(result), -1) for name in output])
    unit = native("plant", version, robot).start(tolerance=1e-10, q_0=[0.3, -0.2] + [0.0] * (n - 2))
    rows = [unit.get("q")]
    for _ in range(round(stop / step)):
        rows.append(unit.step(step).get("q"))
    assert exchange.shape == np.shape(rows)
    assert np.ptp(rows, axis=0).max() > 0.01  # the arm falls: nothing is compared with rest
    assert np.abs(exchange - rows).max() < 1e-7
