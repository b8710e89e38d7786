"""Observers and control laws as FMUs: valid in each form, and the same numbers from C as from numpy."""

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from vdfmu.arm.fmus import build_fmus
from vdfmu.engine.inspect.inspection import check_file

UNITS = [
    "momentum_observer", "kalman_filter", "notch_filter", "disturbance_observer", "virtual_decomposition",
    "iterative_learning", "pd_gravity", "joint_torque", "state_feedback", "computed_torque",
]  # fmt: skip


@pytest.mark.heavy
@pytest.mark.parametrize("form", ["native 2.0", "native 3.0", "python 2.0"])
@pytest.mark.parametrize("unit", UNITS)
def test_nothing_is_wrong_with_the_fmu(unit, form, general, tmp_path):
    """The check compares an FMU with the results of numpy that are in it."""
    backend, version = form.split()
    path = build_fmus(general, tmp_path, units=[unit], backend=backend, fmi_version=version)[unit]
    assert validate_fmu(str(path)) == []
    assert check_file(path) == []


@pytest.mark.heavy
def test_the_natural_law_is_the_same_in_c(planar, tmp_path):
    names = [f"phi[{i},{k}]" for i in (1, 2) for k in range(1, 11)] + ["tau[1]", "tau[2]"]
    times = np.arange(200) * 1e-3
    inputs = np.zeros(200, dtype=[("time", float), ("q_d[1]", float), ("q_dot[2]", float), ("q[2]", float)])
    inputs["time"], inputs["q_d[1]"] = times, np.sin(5.0 * times)
    inputs["q[2]"], inputs["q_dot[2]"] = np.sin(3.0 * times), 3.0 * np.cos(3.0 * times)
    found = []
    for backend in ("native", "python"):
        out = tmp_path / backend
        (path,) = build_fmus(planar, out, units=["virtual_decomposition"], backend=backend).values()
        rows = fmpy.simulate_fmu(
            str(path), stop_time=0.2, output_interval=1e-3, start_values={"adaptation": 1}, output=names, input=inputs
        )
        found.append(np.array([list(row)[1:] for row in rows]))
    assert np.ptp(found[0][:, 0]) > 1e-3  # it adapts
    # 200 steps of rounding of numbers of order 1 to 10
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-11)
