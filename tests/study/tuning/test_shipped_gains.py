"""The gains of `tracking_tuned` against those of `tracking`: smaller errors on every joint, a larger margin."""

import numpy as np
import pytest

import vdfmu
from vdfmu.study.analysis.loops import margins_along

ROBOTS = [{"mass": 0.9, "f_s": 1.1, "K_f0": 1.1}, {"mass": 1.1, "f_s": 0.9, "K_f0": 0.9}, {"f_c": 1.1, "f_v": 1.1}]
"""Factors of the plant's parameters, which the feedforward does not know: within the spread of the tuning."""


@pytest.mark.heavy
def test_each_joint_has_the_margin_that_was_asked_for():
    before, after = (margins_along(name).judged.loops.modulus for name in ("tracking", "tracking_tuned"))
    assert before.min() < 0.15
    assert (after >= 0.3).all()


@pytest.mark.heavy
@pytest.mark.parametrize("master", ["gauss-seidel", "jacobi"])
def test_errors_are_smaller_on_every_joint_for_robots_of_the_spread(master, tmp_path):
    scenario = vdfmu.load_scenario("tracking")
    tuned = vdfmu.load_scenario("tracking_tuned").sections["controller"]
    package = vdfmu.write_ssp(
        scenario, vdfmu.build_fmus(scenario.robot, tmp_path / "fmus", backend="native", folded=True), tmp_path / "p.ssp"
    )
    with vdfmu.Simulator(package, algorithm=master, isolate=False) as simulator:
        for robot in ROBOTS:
            plant = {f"plant.{k}": (f * np.asarray(getattr(scenario.robot, k))).tolist() for k, f in robot.items()}
            errors = []
            for gains in ({}, {f"controller.{k}": list(tuned[k]) for k in ("K_p", "K_v")}):
                results = simulator.run(parameters=plant | gains, step=1e-3, stop=10.0)
                error = results["trajectory.q_d"] - results["plant.q"]
                errors.append((np.sqrt(np.mean(error**2, axis=0)), np.abs(results["controller.tau"]).max(axis=0)))
            (before, torque), (after, other) = errors
            # the search found at most 0.8 for each joint of the worst robots; these are others
            assert (after < 0.9 * before).all()
            # the torques are those of the feedforward except for some per cent
            np.testing.assert_allclose(other, torque, rtol=0.05)
