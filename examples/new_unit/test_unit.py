"""Tests of FILE.py. To run them: python -m pytest test_FILE.py"""

import fmpy
import pytest
from FILE import NAME

from vdfmu.arm.fmus import build_fmus


def test_outputs_and_derivatives():
    """A unit is a Python object: inputs and parameters by name, then its methods."""
    unit = NAME(r=1.0, y=0.4, K=3.0, T=2.0, z_0=0.5)
    unit.start()
    unit.outputs()
    unit.derivatives()
    assert unit.u == pytest.approx(3.0 * (0.6 + 0.5 / 2.0))
    assert unit.z_dot == pytest.approx(0.6)


def test_fmu(tmp_path):
    """The FMU integrates: a constant error gives a ramp."""
    fmu = next(iter(build_fmus(None, tmp_path, units=[NAME]).values()))
    result = fmpy.simulate_fmu(
        fmu, stop_time=1.0, output_interval=0.1, start_values={"r": 1.0, "K": 3.0, "T": 2.0}, output=["u"]
    )
    # the tolerance of the solver is 1e-7
    assert result["u"] == pytest.approx(3.0 * (1.0 + result["time"] / 2.0), abs=1e-6)
