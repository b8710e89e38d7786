"""What the files of the shipped scenarios say of their gains: margins along the run, and errors."""

import numpy as np
import pytest

from vdfmu.arm.fmus import build_fmus
from vdfmu.engine.run import Simulator
from vdfmu.study.analysis.loops import margins_along
from vdfmu.study.verdict import loop_sentences
from vdfmu.system.package.write import write_ssp
from vdfmu.system.scenario import load_scenario

BEFORE = {"controller.K_p": [2e3, 2e3, 2e3, 1e3, 1e3, 500.0], "controller.K_v": [50.0, 50.0, 40.0, 30.0, 25.0, 20.0]}
"""Gains that ignore the falling friction of joint 6, by 17.1 N.m.s/rad at most: 2.9 of 20 are left."""


def margins(name, **options):
    """Return the smallest modulus margins [-] and delay margins [s] of the loops along a run."""
    along = margins_along(name, **options)
    return tuple(np.min([getattr(each, key) for each in along.margins], axis=0) for key in ("modulus", "delay"))


@pytest.mark.heavy
@pytest.mark.parametrize("name", [
    "tracking", "estimation", "two_joint", "two_joint_table5", "planar_tracking", "slider_tracking", "wall", "two_arms",
])  # fmt: skip
def test_each_loop_has_a_modulus_margin_of_a_half_and_a_delay_margin_of_a_sample(name):
    """Ms <= 2 is the upper end of what Astrom and Hagglund (2006, section 4.5) recommend."""
    modulus, delay = margins(name)
    assert modulus.min() >= 0.5
    assert delay.min() >= load_scenario(name).step


@pytest.mark.heavy
def test_where_a_margin_is_less_the_file_says_why():
    modulus, delay = margins("screw")
    assert modulus.min() >= 0.5 and 0.9e-3 < delay.min() < 1e-3  # 306 Hz, as its file says
    modulus, delay = margins("kr300")
    assert modulus.min() >= 0.5 and 0.8e-3 < delay.min() < 1e-3  # gains of the real controller


@pytest.mark.heavy
def test_under_jacobi_the_gains_hold_at_half_the_step_and_the_verdict_says_so():
    figures = margins_along("tracking", algorithm="jacobi").judged.figures
    state, sentences = loop_sentences(figures)
    assert state != "good" and sentences[-1].startswith("with a step of 0.0005 s the modulus margin is 0.5")
    modulus, _ = margins("tracking", algorithm="jacobi", step=5e-4)
    assert modulus.min() >= 0.5
    assert figures["half_step"]["value"] == pytest.approx(modulus.min(), rel=0.02)  # the rows of another run


@pytest.mark.heavy
def test_errors_are_not_larger_than_with_the_gains_before_for_arms_off_the_model(tmp_path):
    scenario = load_scenario("tracking")
    package = write_ssp(scenario, build_fmus(scenario.robot, tmp_path / "fmus", backend="native"), tmp_path / "p.ssp")
    with Simulator(package, isolate=False) as simulator:
        for robot in ({"mass": 0.9, "f_s": 1.1, "K_f0": 1.1}, {"mass": 1.1, "f_s": 0.9, "K_f0": 0.9}):
            plant = {f"plant.{k}": (f * np.asarray(getattr(scenario.robot, k))).tolist() for k, f in robot.items()}
            errors = []
            for gains in (BEFORE, {}):
                results = simulator.run(parameters=plant | gains, step=1e-3, stop=10.0)
                errors.append(np.sqrt(np.mean((results["trajectory.q_d"] - results["plant.q"]) ** 2, axis=0)))
            assert (errors[1] < 1.001 * errors[0]).all()  # of equal K_p equal errors, to 0.1 %
            assert (errors[1][2:] < 0.7 * errors[0][2:]).all()  # K_p is doubled or more on joints 3 to 6
