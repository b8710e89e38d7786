"""Runs with units of FMI 3.0 against those of FMI 2.0."""

import numpy as np
import pytest

import vdfmu
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.errors import UsageError
from vdfmu.engine.run import simulate


@pytest.mark.heavy
@pytest.mark.parametrize("isolate", [False, True])
def test_inputs_run_on_lines_by_intermediate_updates_as_by_their_derivatives(isolate, tmp_path):
    """Held at the middle of the line they would leave ten times the error at 4 ms: the springs swing faster."""
    for version in ("2.0", "3.0"):
        vdfmu.run("planar_tracking", stop=0.1, fmi_version=version, reference=False, out=tmp_path / version)

    def positions(version, step):
        results = simulate(
            tmp_path / version / "system.ssp", stop=0.1, step=step, algorithm="iterative", record=["plant.q[*]"],
            isolate=isolate,
        )  # fmt: skip
        return results["plant.q"][:: round(0.004 / step)]

    exact = positions("2.0", 0.000125)  # of an error below a hundredth of those at 2 ms and more
    for step in (0.004, 0.002):
        by_rates, by_updates = (np.abs(positions(version, step) - exact).max() for version in ("2.0", "3.0"))
        # an input that holds over an internal step is off by a part of the step's square: 3 % and 7 % more here
        assert by_updates < 1.2 * by_rates


def test_what_has_no_fmi_3(tmp_path):
    with pytest.raises(UsageError, match=r"Python FMUs have FMI 2\.0, got 3\.0"):
        vdfmu.run("planar_tracking", stop=0.01, backend="python", fmi_version="3.0", out=tmp_path / "a")
    with pytest.raises(UsageError, match=r"There is no FMI '4\.0' here"):
        vdfmu.run("planar_tracking", stop=0.01, fmi_version="4.0", out=tmp_path / "c")


@pytest.mark.heavy
def test_a_plant_of_fmi_3_among_units_of_fmi_2(tmp_path):
    """A foreign FMU as the tool sees it: arrays, of which the others read and feed the elements."""
    whole = vdfmu.run("planar_tracking", stop=0.1, reference=False, out=False)
    fmus = build_fmus(
        vdfmu.load_robot("planar_2dof"), tmp_path / "fmus", units=["plant"], fmi_version="3.0", folded=True
    )
    mixed = vdfmu.run("planar_tracking", stop=0.1, units={"plant": fmus["plant"]}, reference=False, out=False)
    for name in whole.names:
        np.testing.assert_array_equal(whole[name], mixed[name])
