"""Runs made up for the pictures: any number and type of joints, data that differ from joint to joint."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from tests.conftest import heavy
from vdfmu.arm.dynamics import forward_kinematics
from vdfmu.arm.robot import Robot, load_robot
from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.engine.results.results import Results, Signal
from vdfmu.system.scenario import Scenario, load_scenario

POINTS = 801
TYPES = {1: ("revolute",), 2: ("revolute", "revolute"), 3: ("revolute", "prismatic", "revolute"), 6: ("revolute",) * 6}
"""Joint types of the chains, by number of joints."""


def make_robot(types: tuple[str, ...]) -> Robot:
    arm, n = load_robot("manipulator_6dof"), len(types)
    fields = {key: getattr(arm, key)[:n] for key, row in PARAMETERS.items() if row.per_joint}
    fields["ell"] = 100.0 + 10.0 * np.arange(n)
    return dataclasses.replace(arm, name=f"chain_{n}", joint_types=types, **fields)


def make_scenario(types: tuple[str, ...], source: str = "") -> Scenario:
    paper = {"source": source} if source else {}
    return dataclasses.replace(
        load_scenario("tracking"), robot=make_robot(types), sections={}, paper=paper, plant_factors={}
    )


def make_results(n: int, points: int = POINTS, at_rest: bool = False) -> Results:
    """Return recorded signals of a run over 2 s; all joints but the last of several move, or none."""
    time = np.linspace(0.0, 2.0, points)
    phase = np.arange(n) + 1.0
    q_d = np.sin(np.outer(time, phase))
    q_d[:, 0 if at_rest else max(1, n - 1) :] = 0.0
    tau_m = 0.1 * np.cos(np.outer(time, phase))
    q = q_d - 1e-5 * phase * np.sin(5.0 * time)[:, None]
    columns = {
        "trajectory.q_d": q_d, "plant.q": q, "plant.kappa": q + 1e-4 * phase,
        "plant.p_O": forward_kinematics(make_robot(TYPES[n]), q)[0], "feedforward.tau_m": tau_m,
        "controller.tau": tau_m + 1e-3 * phase * np.cos(7.0 * time)[:, None],
    }  # fmt: skip
    names = [f"{name}[{i + 1}]" for name, values in columns.items() for i in range(values.shape[1])]
    signals = [Signal(name, "real", "", column) for column, name in enumerate(names)]
    return Results(time, signals, {"real": np.hstack(list(columns.values()))})


@pytest.fixture(params=[1, *heavy(2), 3, 6], ids=lambda n: f"n={n}")
def types(request: pytest.FixtureRequest) -> tuple[str, ...]:
    return TYPES[request.param]


@pytest.fixture(scope="session")
def made() -> SimpleNamespace:
    """Return the functions of this file as ``made.results`` and ``made.scenario``."""
    return SimpleNamespace(results=make_results, scenario=make_scenario)
