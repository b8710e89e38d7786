"""Packages of arms that are wired from their links and joints: they run as those in one piece."""

import re
import zipfile
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy.validation import validate_fmu

import vdfmu
from tests.engine.files import check_file
from tests.warm import command
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import load_robot
from vdfmu.arm.units import package_units
from vdfmu.base.errors import SspError, UsageError
from vdfmu.engine.run import simulate
from vdfmu.extras.decompose.decomposition import decomposed
from vdfmu.system.package.write import build_parts, write_ssp
from vdfmu.system.scenario import Scenario, load_scenario

pytestmark = pytest.mark.heavy  # the FMUs are compiled


def package(scenario: Scenario, folder: Path, settings: dict[str, Any] | None = None) -> Path:
    apart, values = decomposed(scenario, settings)
    return write_ssp(apart, build_parts(apart, folder, values), folder / "apart.ssp", values)


PIECES = [name for name, unit in package_units().items() if unit.exchange]


@pytest.mark.parametrize("version", ["2.0", "3.0"])
@pytest.mark.parametrize("unit", PIECES)
def test_nothing_is_wrong_with_the_fmus(unit, version, tmp_path):
    """The check compares an FMU with the results of numpy that are in it."""
    path = build_fmus(None, tmp_path, units=[unit], fmi_version=version)[unit]
    assert validate_fmu(str(path)) == []
    assert check_file(path) == []


def compare(pieces: Any, whole: Any, n: int, tolerance: float) -> None:
    for i in range(1, n + 1):
        for name in ("tau_m", "tau_s", "kappa_dot_d"):
            both = pieces[f"feedforward_joint_{i}.{name}"], whole[f"feedforward.{name}[{i}]"]
            np.testing.assert_allclose(*both, rtol=0, atol=1e-12, err_msg=name)  # N.m: the same lines in the same order
        both = pieces[f"plant_joint_{i}.q"], whole[f"plant.q[{i}]"]
        np.testing.assert_allclose(*both, rtol=0, atol=tolerance)


@pytest.mark.parametrize(("robot", "settings"), [
    ("iiwa_7dof", {"feedforward.mode": "vdc"}),  # seven joints, rotors that push the links, end stops
    ("slider_3dof", {"plant.q_dot_0[1]": 0.2, "plant.F_e[2]": 3.0}),  # a prismatic one; it starts in motion
    ("kr300_6dof", {}),  # a counterbalance
])  # fmt: skip
def test_other_arms_run_as_in_one_piece(tmp_path, robot, settings):
    scenario = replace(load_scenario("tracking"), robot=load_robot(robot), sections={})
    moved = {f"trajectory.q_end[{i + 1}]": 0.02 for i in range(scenario.arm.n)} | settings
    pieces = simulate(package(scenario, tmp_path, moved), stop=0.05, tolerance=1e-10)
    exact = {**moved, "plant.tolerance": 1e-11}
    whole = vdfmu.run(scenario, stop=0.05, parameters=exact, reference=False, out=False)
    compare(pieces, whole, scenario.arm.n, 1e-9)


def as_co_simulation(path: Path) -> Path:
    """Return the package with the components of the plant for co-simulation."""
    changed_path = path.with_name("co_simulation.ssp")
    with zipfile.ZipFile(path) as archive, zipfile.ZipFile(changed_path, "w") as changed:
        for name in archive.namelist():
            content = archive.read(name)
            if name == "SystemStructure.ssd":
                text = re.sub(r'(name="plant_[^>]*?)"ModelExchange"', r'\1"CoSimulation"', content.decode())
                content = text.encode()
            changed.writestr(name, content)
    return changed_path


@pytest.mark.parametrize(("name", "steps"), [("tracking", (1e-3,)), ("planar_tracking", (1e-3, 5e-4, 2.5e-4))])
def test_as_co_simulation_it_takes_the_master_that_repeats_steps(tmp_path, name, steps):
    """A link answers an acceleration that is held with a larger one: without repeated steps it is unstable."""
    # Apparent masses and accelerations run on lines over a step, so the error is of second order; in one piece they
    # are what they are.
    scenario = load_scenario(name)
    path = as_co_simulation(package(scenario, tmp_path))
    whole = write_ssp(scenario, build_parts(scenario, tmp_path / "whole"), tmp_path / "whole.ssp")
    with pytest.raises(SspError, match="gauss-seidel cannot order plant_joint_1, plant_link_1"):
        simulate(path, stop=0.01)
    errors: list[float] = []
    joints = range(1, scenario.arm.n + 1)
    for step in steps:
        options: dict[str, Any] = {"step": step, "stop": 0.1, "algorithm": "iterative", "convergence": 1e-12}
        pieces = simulate(path, parameters={f"plant_joint_{i}.tolerance": 1e-12 for i in joints}, **options)
        expected = simulate(whole, parameters={"plant.tolerance": 1e-12}, **options)
        errors.append(max(np.abs(pieces[f"plant_joint_{i}.q"] - expected[f"plant.q[{i}]"]).max() for i in joints))
    # the jerk of the start is some 1e3 rad/s3: of the line h^2/8 times its rate is left, over a tenth of a second
    assert errors[0] < 3e-8
    for coarse, fine in pairwise(errors):
        assert 1.6 < np.log2(coarse / fine) < 2.2


def test_the_command_writes_it_and_its_page_shows_power_and_force(tmp_path):
    assert command("ssp", "planar_tracking", "--decomposed", cwd=tmp_path).returncode == 0
    out = command("run", "planar_tracking_decomposed.ssp", "--stop", "0.05", "--out", "run", cwd=tmp_path)
    assert out.returncode == 0, out.stderr
    assert command("report", "run", cwd=tmp_path).returncode == 0
    page = (tmp_path / "run" / "report.html").read_text()
    assert "F towards the tip, on the side of the base" in page
    assert "Moments about the axes between joint and link" in page
    assert '"types":["revolute","revolute"]' in page.replace(" ", "")
    # in the picture of the system the pieces of an arm are a box, whose equal connectors are vectors
    assert "<summary>All 10 pieces of feedforward and plant</summary>" in page
    assert "<title>feedforward.tau_m, 2 elements, to controller.tau_m</title>" in page


def test_python_units_are_refused(tmp_path):
    apart, values = decomposed(load_scenario("planar_tracking"))
    with pytest.raises(UsageError, match="native"):
        build_parts(apart, tmp_path, values, backend="python")
