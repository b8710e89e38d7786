"""Packages of arms that are wired from their links and joints: they run as those in one piece."""

from __future__ import annotations

import re
import zipfile
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vdfmu
from tests.warm import command
from vdfmu.arm.robot import load_robot
from vdfmu.base.errors import SspError, UsageError
from vdfmu.system.package.write import write_ssp
from vdfmu.system.scenario import Scenario, load_scenario
from vdfmu.system.scenario.decomposed import decomposed
from vdfmu.system.scenario.parts import build_parts

pytestmark = pytest.mark.heavy  # the FMUs are compiled


def package(scenario: Scenario, folder: Path, settings: dict[str, Any] | None = None) -> Path:
    """Return the package of a decomposed scenario."""
    apart, values = decomposed(scenario, settings)
    return write_ssp(apart, build_parts(apart, folder, values), folder / "apart.ssp", values)


def compare(found: Any, whole: Any, n: int, tolerance: float) -> None:
    """Compare a run with that of the arm in one piece."""
    for i in range(1, n + 1):
        for name in ("tau_m", "tau_s", "kappa_dot_d"):
            both = found[f"feedforward_joint_{i}.{name}"], whole[f"feedforward.{name}[{i}]"]
            np.testing.assert_allclose(*both, rtol=0, atol=1e-12, err_msg=name)  # N.m: the same lines in the same order
        both = found[f"plant_joint_{i}.q"], whole[f"plant.q[{i}]"]
        np.testing.assert_allclose(*both, rtol=0, atol=tolerance)


def test_the_papers_arm_runs_as_in_one_piece(tmp_path):
    """It is integrated as one, by another solver: errors of both, at tolerances of 1e-10 and 1e-11, in 500 steps."""
    found = vdfmu.simulate(package(load_scenario("tracking"), tmp_path), stop=0.5, tolerance=1e-10)
    whole = vdfmu.run("tracking", stop=0.5, settings={"plant.tolerance": 1e-11}, out=tmp_path / "whole")
    compare(found, whole, 6, 1e-9)
    order = found.summary["order"]
    assert order.index("feedforward_joint_6") < order.index("controller") < order.index("plant_joint_1")
    with zipfile.ZipFile(tmp_path / "apart.ssp") as archive:
        fmus = {Path(name).stem for name in archive.namelist() if name.endswith(".fmu")}
    assert fmus == {
        "Trajectory", "PDController", "ArmBase", "FeedforwardJoint", "FeedforwardLink", "FeedforwardTool", "PlantJoint",
        "PlantLink", "PlantTool",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("robot", "settings"),
    [
        ("iiwa_7dof", {"feedforward.mode": "vdc"}),  # seven joints, rotors that push the links, end stops
        ("slider_3dof", {"plant.q_dot_0[1]": 0.2, "plant.F_e[2]": 3.0}),  # a prismatic one; it starts in motion
        ("kr300_6dof", {}),  # a counterbalance
    ],
)
def test_other_arms_run_as_in_one_piece(tmp_path, robot, settings):
    scenario = replace(load_scenario("tracking"), robot=load_robot(robot), sections={})
    moved = {f"trajectory.q_end[{i + 1}]": 0.02 for i in range(scenario.arm.n)} | settings
    found = vdfmu.simulate(package(scenario, tmp_path, moved), stop=0.05, tolerance=1e-10)
    whole = vdfmu.run(
        scenario, stop=0.05, settings={**moved, "plant.tolerance": 1e-11}, out=tmp_path / "whole", reference=False
    )
    compare(found, whole, scenario.arm.n, 1e-9)


def write_whole(folder: Path) -> Path:
    """Return the package of the scenario in one piece."""
    scenario = load_scenario("tracking")
    return write_ssp(scenario, build_parts(scenario, folder), folder / "whole.ssp")


def test_as_co_simulation_it_takes_the_master_that_repeats_steps(tmp_path):
    """In 1 ms the wrist answers an acceleration that is held by a larger one: only repeated steps are stable.

    The accelerations run on lines over a step, so the error is of second order; in one piece they are exact.
    """
    path = package(load_scenario("tracking"), tmp_path)
    co = tmp_path / "co.ssp"
    with zipfile.ZipFile(path) as archive, zipfile.ZipFile(co, "w") as changed:
        for name in archive.namelist():
            content = archive.read(name)
            if name == "SystemStructure.ssd":
                text = re.sub(r'(name="plant_[^>]*?)"ModelExchange"', r'\1"CoSimulation"', content.decode())
                content = text.encode()
            changed.writestr(name, content)
    with pytest.raises(SspError, match="gauss-seidel cannot order plant_joint_1, plant_link_1"):
        vdfmu.simulate(co, stop=0.01)
    errors: list[float] = []
    fine = {f"plant_joint_{i}.tolerance": 1e-11 for i in range(1, 7)}
    for step in (2e-3, 1e-3, 5e-4):
        given: dict[str, Any] = {"step": step, "stop": 0.1, "algorithm": "iterative", "convergence": 1e-12}
        found = vdfmu.simulate(co, parameters=fine, **given)
        whole = vdfmu.simulate(write_whole(tmp_path), parameters={"plant.tolerance": 1e-11}, **given)
        errors.append(max(np.abs(found[f"plant_joint_{i}.q"] - whole[f"plant.q[{i}]"]).max() for i in range(1, 7)))
    print(errors)
    assert errors[1] < 1e-9
    orders = [np.log2(a / b) for a, b in pairwise(errors)]
    assert all(1.5 < order < 2.5 for order in orders), (errors, orders)


def test_the_command_writes_it_and_its_page_shows_power_and_force(tmp_path):
    assert command("ssp", "planar_tracking", "--decomposed", cwd=tmp_path).returncode == 0
    out = command("simulate", "planar_tracking_decomposed.ssp", "--stop", "0.05", "--out", "run", cwd=tmp_path)
    assert out.returncode == 0, out.stderr
    assert command("report", "run", cwd=tmp_path).returncode == 0
    page = (tmp_path / "run" / "report.html").read_text()
    assert "F towards the tip, on the side of the base" in page
    assert "Moments about the axes between joint and link" in page
    assert '"types":["revolute","revolute"]' in page.replace(" ", "")


def test_python_units_are_refused(tmp_path):
    apart, values = decomposed(load_scenario("planar_tracking"))
    with pytest.raises(UsageError, match="native"):
        build_parts(apart, tmp_path, values, backend="python")
