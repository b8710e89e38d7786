"""Drives with options through the FMUs: against the references, on both backends."""

import dataclasses

import numpy as np
import pytest

import vdfmu
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.reference import reference
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import system_values

OPTIONS = ("hysteresis", "load_loss", "backlash", "bristles", "winding", "thermal", "counterbalance")
STOP = 0.1
SETTINGS = {"plant.tolerance": 1e-9, "trajectory.T": 0.5}
MORE = {"hysteresis": "tau_h", "bristles": "tau_z", "winding": "i_m", "thermal": "T_j"}
"""State that an option adds."""


def scenario_of(robot):
    """Return the short motion of the small arm, which moves from the start on, and its values."""
    scenario = dataclasses.replace(load_scenario("planar_tracking", robot), stop=STOP)
    return scenario, system_values(scenario, SETTINGS)


def check_run(robot):
    """Hold a run of either backend against the scipy reference, and one backend against the other."""
    runs = [
        vdfmu.run(
            "planar_tracking", robot=robot, backend=backend, stop=STOP, parameters=SETTINGS, reference=False, out=False
        )
        for backend in ("native", "python")
    ]
    native, python = runs
    scenario, values = scenario_of(robot)
    exact = reference("sampled", SystemDescription(scenario, values), step=1e-3, stop=STOP)
    more = [f"plant.{state}" for option, state in MORE.items() if getattr(robot, option)]
    for name in ("plant.q", "plant.tau_s", *more):
        size = np.abs(exact[name]).max()
        assert size > 0.0
        # Local errors of 1e-9 in some thousand steps of either solver, which friction makes forget: 1e-8 rad, seen
        # 1e-11; of torques, by the stiffness of 1e4 N m/rad, seen 8e-8 N m.
        atol = 1e-8 if name == "plant.q" else 1e-4
        np.testing.assert_allclose(native[name], exact[name], rtol=0, atol=atol)
        # the same operations in the same order, except for the rounding of functions of the library
        np.testing.assert_allclose(native[name], python[name], rtol=1e-9, atol=1e-9)
    return native


@pytest.mark.heavy
@pytest.mark.parametrize("option", OPTIONS)
def test_a_drive_with_an_option_runs_as_its_reference(with_options, bare, option):
    with_it = check_run(with_options(option))
    assert np.abs(with_it["plant.q"] - bare["plant.q"]).max() > 1e-8  # it acts


@pytest.fixture(scope="module")
def bare():
    return vdfmu.run("planar_tracking", stop=STOP, reference=False, parameters=SETTINGS, out=False)


@pytest.fixture(scope="module")
def every(with_options):
    return with_options()


@pytest.mark.heavy
def test_a_drive_with_all_options_runs_as_its_reference(every):
    native = check_run(every)
    for state in MORE.values():
        assert np.ptp(native[f"plant.{state}"], axis=0).min() > 0.0
