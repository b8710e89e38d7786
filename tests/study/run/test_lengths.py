"""Runs of any length: what follows a run takes its rows block by block, and no block may be too short for it.

The last block of a run has any number of rows, one included. All numbers are those of the run in one block.
"""

import dataclasses
import json
import re

import numpy as np
import pytest

import vdfmu
from tests.conftest import ran
from vdfmu.arm.robot import load_robot
from vdfmu.base.errors import CosimError
from vdfmu.base.text import error_text
from vdfmu.engine.results.recorded import Recorded
from vdfmu.engine.results.results import Results, Signal
from vdfmu.study.report import content
from vdfmu.study.report.parts import tiles_of
from vdfmu.study.run import measure
from vdfmu.study.run import summary as numbers
from vdfmu.study.run.joint_components import cut_figures
from vdfmu.study.run.key_figures import key_figures
from vdfmu.study.run.measure import accuracy_notes
from vdfmu.study.run.summary import ArmLimits
from vdfmu.study.sweeps.measures import REDUCTIONS, measured, read_measures
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.reference import BLOCK, Reference
from vdfmu.system.scenario import load_scenario

ONE = 2**20
"""Rows of a block that has the whole run."""
GROUPS = {
    "trajectory.q_d": "rad", "trajectory.q_d_dot": "rad/s", "plant.q": "rad", "plant.kappa_dot": "rad/s",
    "plant.tau_s": "N.m", "controller.tau": "N.m", "feedforward.tau_m": "N.m", "feedforward.tau_s": "N.m",
    "feedforward.kappa_dot_d": "rad/s", "estimator.tau_s_hat": "N.m", "estimator.tau_f_hat": "N.m",
}  # fmt: skip
STEP = 1e-3
MEASURES = [f"m{k} = {name}(plant.q{', 0' if name == 'at' else ''})" for k, name in enumerate(REDUCTIONS)]


@pytest.fixture(autouse=True)
def every_note(monkeypatch):
    """Let a run have each note on its accuracy, however small the effect."""
    monkeypatch.setattr(measure, "_LOST", 0.0)
    monkeypatch.setattr(measure, "_SHOWN", 0.0)


@pytest.fixture(scope="module")
def system():
    return SystemDescription(load_scenario("planar_tracking"))


def results_of(rows, seed=3):
    """Return results of an arm of two joints: each signal is a random walk, so that each row counts."""
    dice = np.random.default_rng(seed)
    walk = np.cumsum(0.02 * dice.standard_normal((rows, 2 * len(GROUPS))), axis=0)
    signals = [Signal(f"{group}[{i + 1}]", "real", unit, 2 * k + i)
               for k, (group, unit) in enumerate(GROUPS.items()) for i in range(2)]  # fmt: skip
    return Results(STEP * np.arange(rows), signals, {"real": walk})


def limits_of(robot):
    """Return limits that the arm meets now and then."""
    names = ("q_min", "q_max", "stop_stiffness", "stop_damping", "tau_stall", "kappa_dot_max", "full_speed")
    values = (-0.02, 0.02, 1e4, 0.5, 0.03, 0.05, 0.5)
    limited = dataclasses.replace(
        load_robot("kr_6dof"), **{n: np.full(6, x) for n, x in zip(names, values, strict=True)}
    )
    for name in (*names, "ell", "I_m"):
        object.__setattr__(limited, name, getattr(limited, name)[: robot.n])
    return [ArmLimits("plant", limited, np.full(robot.n, 0.05), "controller.tau")]


def in_blocks(monkeypatch, size):
    """Let all that reads results take blocks that add `size` rows."""
    plain = Recorded.blocks
    monkeypatch.setattr(Recorded, "blocks", lambda self, rows, overlap=0: plain(self, size, overlap))
    monkeypatch.setattr(content, "BLOCK", size)


def facts_of(results, system):
    """Return all that is calculated of the rows of a run."""
    robot = system.scenario.robot
    limits, facts = limits_of(robot), dict[str, object]()
    other = results_of(len(results), seed=4)

    def reference_of(name):
        for part in other.blocks(BLOCK, overlap=1):
            yield Reference(name, part.time, {group: part[group] for group in GROUPS})

    for name, substeps in (("sampled", 1), ("continuous", 1), ("continuous", 2), ("continuous", 0)):
        facts[f"compared with {name}, {substeps}"] = numbers.compare(results, reference_of(name), robot, substeps)
        facts[f"estimated with {substeps}"] = numbers.estimation_errors(results, substeps)
    facts["compared without a robot"] = numbers.compare(results, reference_of("sampled"), None, 1)
    facts["tracking"] = numbers.tracking_errors(results, robot, limits)
    facts["limits"] = numbers.time_at_limits(results, limits)
    facts["figures"] = key_figures(results, robot, limits, robot), cut_figures(results)
    facts["notes"] = list(accuracy_notes(results, system)), list(numbers.start_notes(results, system.scenario))
    facts["measures"] = measured(read_measures(MEASURES), results)
    return facts


def assert_same(part, whole, place=""):
    if isinstance(part, dict):
        assert part.keys() == whole.keys(), place
        for key in part:
            assert_same(part[key], whole[key], f"{place} {key}")
    elif isinstance(part, (list, tuple)):
        assert len(part) == len(whole), place
        for k, pair in enumerate(zip(part, whole, strict=True)):
            assert_same(*pair, f"{place} {k}")
    elif isinstance(part, float):
        assert np.isfinite(part), place
        # sums of up to 2,000 numbers in another order: 2,000 roundings of 1.1e-16 of sums of absolute values, up to
        # 100 times the sum
        np.testing.assert_allclose(part, whole, rtol=3e-11, atol=3e-13, err_msg=place)
    else:
        assert part == whole, place


@pytest.mark.few(1)
@pytest.mark.parametrize("size", [1, 2, 3, 7])
def test_the_size_of_the_blocks_changes_no_number(system, monkeypatch, size):
    for rows in (1, 2, 3, 6, 7, 8, 9, 40):
        with monkeypatch.context() as patch:
            in_blocks(patch, ONE)
            whole = facts_of(results_of(rows), system)
        with monkeypatch.context() as patch:
            in_blocks(patch, size)
            assert_same(facts_of(results_of(rows), system), whole)
    assert len(whole["notes"][0]) == 2 and len(whole["notes"][1]) == 1
    assert all(any(shares) for shares in whole["limits"]["limits"]["plant"].values())
    assert "saturated" in whole["limits"]["key_figures"]


def test_a_motor_without_torque_has_no_share_of_its_limit(system):
    results, robot = results_of(9), system.scenario.robot
    (arm,) = limits_of(robot)
    torques = [
        key_figures(results, robot, [arm._replace(robot=None, tau_max=np.array(most))], robot)["torque"]
        for most in ([0.0, 0.0], [0.0, 0.05])
    ]
    assert [(torque["joint"], torque["limit"]) for torque in torques] == [(1, 0.0), (2, 0.05 * robot.ell[1])]
    assert torques[0]["value"] == 0.0
    assert all("nan" not in tile.note for torque in torques for tile in tiles_of({"key_figures": {"torque": torque}}))


@pytest.mark.heavy
def test_a_start_far_from_the_motion_is_named_where_the_run_fails():
    """The first torque is the gain times the difference, here over a hundred times what the springs carry."""
    with pytest.raises(CosimError) as failed:
        vdfmu.run("planar_tracking", parameters={"plant.q_0": [0.3, -0.5]}, out=False)
    assert "A likely cause: plant starts 1.871 rad from the start of trajectory at joint 1" in (
        error_text(failed.value)
    )


@pytest.mark.heavy
@pytest.mark.parametrize("scenario", ["planar_tracking", "slider_tracking", "wall"])
def test_a_command_of_any_length_has_a_verdict_and_a_page(tmp_path, scenario):
    for rows in (2, 3, 4, 5, 6, 7, 8, BLOCK + 1, BLOCK + 4, BLOCK + 6):
        out = tmp_path / str(rows)
        options = ["--stop", f"{(rows - 1) * STEP:g}", "--out", str(out), *(["--no-reference"] if rows > 8 else [])]
        done = ran("run", scenario, *options)
        assert re.match(r"[✓!] (Good|Doubtful): ", done.stdout), done.stdout
        summary = json.loads((out / "summary.json").read_text())
        assert summary["steps"] == rows - 1 and "NaN" not in (out / "summary.json").read_text()
        assert (out / "report.html").stat().st_size > 100_000
