"""Units that are odd and right: their FMUs are valid, and their own checks find nothing."""

# ruff: noqa: D102

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from tests.engine.files import check_file
from vdfmu.arm.fmus import build_fmus
from vdfmu.unit import Derivative, Input, Output, Parameter, State, Unit


class OnlyParameter(Unit):
    """Has neither inputs nor outputs."""

    k = Parameter("1")


class Tensor(Unit):
    """Has commas in all names of FMI 2.0, which tables of reference results cannot have."""

    u = Input("1", (2, 1, 2))
    y = Output("1", (2, 1, 2))

    def outputs(self) -> None:
        self.y = 2.0 * self.u


class Rate(Unit):
    """Moves at constant rates, whatever its variables are."""

    x = State("1", 2)
    x_dot = Derivative(x)

    def derivatives(self) -> None:
        self.x_dot = [0.0, 2.0]


@pytest.mark.parametrize("form", ["native 2.0", pytest.param("native 3.0", marks=pytest.mark.heavy), "python 2.0"])
@pytest.mark.parametrize("unit", [OnlyParameter, Tensor, Rate])
def test_an_odd_unit_has_a_valid_fmu(unit, form, tmp_path):
    backend, version = form.split()
    (path,) = build_fmus(None, tmp_path, units=[unit], backend=backend, fmi_version=version).values()
    assert validate_fmu(str(path)) == [] and check_file(path) == []
    if unit is Rate:
        row = fmpy.simulate_fmu(str(path), stop_time=0.01, output_interval=1e-3)[-1]
        # a state of 0.02 is the sum of some tens of steps, each with its rounding
        np.testing.assert_allclose(np.concatenate([np.ravel(x) for x in row])[1:], [0.0, 0.02], rtol=1e-14)
