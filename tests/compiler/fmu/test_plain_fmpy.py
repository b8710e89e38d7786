"""The FMUs as a new user of fmpy meets them: loaded, run with defaults, changed a little."""

from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest


def simulate(path: Path, **options: Any) -> np.ndarray:
    return fmpy.simulate_fmu(str(path), **options)


@pytest.mark.heavy
def test_every_unit_runs_with_defaults(fmus, unit_name):
    """10 s at 1 kHz, as the default experiment says; for the six-joint arm see the scenarios."""
    result = simulate(fmus["planar_2dof"][unit_name])
    # fmpy adds up its 1e4 times, each rounded to 1e-15
    assert result["time"][0] == 0.0 and result["time"][-1] == pytest.approx(10.0, abs=1e-9)
    assert all(np.all(np.isfinite(result[name])) for name in result.dtype.names)


def test_of_the_parameter_and_the_tolerance_of_the_experiment_the_smaller_holds(fmus):
    """Fmpy hands the unit the 1e-7 of the default experiment where no tolerance is given."""
    path = fmus["planar_2dof"]["plant"]

    def fall(experiment: float | None, **parameter: float) -> np.ndarray:
        return simulate(
            path, start_values=parameter, relative_tolerance=experiment, stop_time=0.1, output_interval=0.01
        )

    default, coarse, fine = fall(None), fall(1e-4, tolerance=1e-4), fall(1e-9)
    assert np.array_equal(fall(1e-4), default)  # what OMSimulator and PyFMI hand to every unit
    assert np.array_equal(fall(None, tolerance=1e-9), fine)
    assert np.array_equal(fall(1e-4, tolerance=1e-9), fine)
    assert np.array_equal(fall(1e-9, tolerance=1e-4), fine)
    assert not any(np.array_equal(*pair) for pair in ((default, coarse), (default, fine), (coarse, fine)))
