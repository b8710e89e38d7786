"""The arms in the scene of a page: where they, their paths, and what they touch are; in a browser."""

import dataclasses

import numpy as np
import pytest
from tests.study.page.browser import show
from tests.study.page.test_frames import still_and_quick

import vdfmu
from vdfmu.engine.results.recorded import Signal
from vdfmu.engine.results.results import Results
from vdfmu.study.report.content import arm_of
from vdfmu.study.report.page import ShownRun, write_report

pytestmark = [pytest.mark.heavy, pytest.mark.usefixtures("quiet")]
SCENE = "const scene = report.player.scene, [first] = scene.puppets, { arms, objects } = first;"
PLACE = "const at = (object, x = 0, y = 0, z = 0) => object.localToWorld(new vendor.Vector3(x, y, z)).toArray();"


def asked(browser, expression: str):
    """Value of an expression about the scene."""
    return browser.run(f"(() => {{ {SCENE} {PLACE} return {expression}; }})()")


def moving(name: str, amplitude: float, **changes) -> ShownRun:
    """Return a run of an arm whose joints swing, without forces."""
    robot = dataclasses.replace(vdfmu.load_robot(name), **changes)
    t = np.linspace(0.0, 2.0, 201)
    q = np.outer(np.sin(3.0 * t), np.full(robot.n, amplitude))
    signals = [Signal(f"plant.q[{i + 1}]", "real", "rad", i) for i in range(robot.n)]
    results = Results(t, signals, {"real": q}, {"robot": name, "joints": robot.n, "arm": arm_of(robot, {})})
    return ShownRun(name, results, results.summary, robot.name and still(robot))


def still(robot):
    return vdfmu.load_robot.__code__.co_filename and __import__("pathlib").Path("none.ssp")


@pytest.fixture(scope="module", params=["wall", "two_arms", "screw"])
def run(request, tmp_path_factory):
    """Return the scenario, and the folder of a run."""
    folder = tmp_path_factory.mktemp(request.param)
    stop = {"wall": 2.2, "two_arms": 0.5, "screw": 0.5}[request.param]
    vdfmu.run(request.param, stop=stop, out=folder, reference=False)
    return request.param, folder
