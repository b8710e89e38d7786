"""Margins that a search keeps."""

import dataclasses
import tomllib

import numpy as np
import pytest

from vdfmu.extras.robots.reach_file import write_reach
from vdfmu.extras.tune import tune
from vdfmu.study.analysis.loops import margins_along
from vdfmu.study.run.prepare import prepare


@pytest.mark.heavy
def test_a_search_reaches_a_margin_that_its_start_lacks(tmp_path):
    path = tmp_path / "reach.toml"
    write_reach("scara_4dof", path)
    tuned = tune(
        path, ["controller.K_p[4]", "controller.K_v[4]"], "rms(trajectory.q_d[4] - plant.q[4])", margin=0.5,
        algorithm="jacobi", method="local", evaluations=20, stop=1.0, workers=1, out=tmp_path / "search",
    )  # fmt: skip
    assert tuned.margins[0].modulus.min() < 0.5 and tuned.after.feasible and (tuned.after.modulus >= 0.5).all()
    with (tuned.folder / "tuned.toml").open("rb") as file:
        gains = tomllib.load(file)["controller"]
    settings = {f"controller.{name}": value for name, value in gains.items()}
    short = dataclasses.replace(prepare(path, algorithm="jacobi"), stop=1.0)
    # states of a run with these gains instead of the first ones: the errors are some 1e-5 rad in either
    np.testing.assert_allclose(
        margins_along(short, parameters=settings).judged.loops.modulus, tuned.after.modulus, rtol=0.02
    )
