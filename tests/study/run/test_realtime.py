"""Runs with a fixed number of internal steps, and by the clock."""

import json

import numpy as np
import pytest

import vdfmu
from vdfmu.compiler.unit.declaration import SOLVERS


@pytest.mark.heavy
def test_the_error_of_fixed_steps_is_that_of_the_page_and_python_fmus_take_the_same():
    """The first 0.5 s, while friction turns on, have the largest errors of the 10 s of docs/efmi.md."""

    # It has 1.4e-8 rad for one step and 1.8e-10 rad for four. Rounding of sin and tanh on other machines is 1e-15.
    def run(**settings):
        values = {f"plant.{name}": value for name, value in settings.items()}
        return vdfmu.run("tracking", stop=0.5, out=False, reference=False, backend="native", parameters=values)[
            "plant.q"
        ]

    exact = run(tolerance=1e-11)
    errors = [np.abs(run(solver=kind) - exact).max() for kind in ("fixed_1", "fixed_2", "fixed_4")]
    assert [float(f"{error:.1e}") for error in errors] == [1.4e-8, 1.5e-9, 1.8e-10]
    assert errors[-1] < 1e-7
    # Rounding of some 100 steps in a stable loop: 1e-13 of positions of 1 rad is what backends differ by.
    native, python = (
        vdfmu.run(
            "planar_tracking", stop=0.1, out=False, reference=False, backend=backend,
            parameters={"plant.solver": SOLVERS.index("fixed_2")},
        )["plant.q"]
        for backend in ("native", "python")
    )  # fmt: skip
    np.testing.assert_allclose(native, python, rtol=1e-12, atol=1e-12)


def test_a_run_by_the_clock_takes_its_time_and_says_how_late_it_was(tmp_path):
    results = vdfmu.run("planar_tracking", stop=0.2, out=tmp_path / "run", reference=False, pace=2.0)
    pace = json.loads((tmp_path / "run" / "summary.json").read_text(encoding="utf-8"))["pace"]
    assert pace["speed"] == 2.0
    assert pace["rows"] == len(results) - 2  # those from the third on, where the clock started with the second
    assert 0.0 <= pace["late_p50_s"] <= pace["late_p99_9_s"] <= pace["late_worst_s"]
    assert 1 < pace["worst_row"] < len(results)
    assert "cores" in pace["machine"]
    assert results.summary["wall_s"] < 10.0
    free = vdfmu.run("planar_tracking", stop=0.2, out=False, reference=False)
    assert "pace" not in free.summary
    np.testing.assert_array_equal(results["plant.q"], free["plant.q"])
