"""The example that compares control laws: its cells are plain runs, a law of another file takes part."""

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

import vdfmu

FOLDER = Path(__file__).parents[3] / "examples" / "compare_laws"
LAW = """
from vdfmu.unit import JOINTS, Input, Output, Parameter, RobotParameters, Unit


class MyLaw(Unit):
    q_d = Input("position", JOINTS, "desired position")
    q = Input("position", JOINTS, "position of the link")
    kappa_dot = Input("velocity", JOINTS, "velocity of the rotor")
    K_p = Parameter("stiffness", JOINTS, "gain", start=100.0, minimum=0.0)
    K_v = Parameter("damping", JOINTS, "gain", start=10.0, minimum=0.0)
    tau = Output("N.m", JOINTS, "motor torque")
    robot = RobotParameters("ell")

    def outputs(self):
        self.tau = (self.K_p * (self.q_d - self.q) - self.K_v * self.kappa_dot) / self.robot.ell


LAW = {
    "unit": "my_law.py:MyLaw", "text": "PD without feedforward", "vary": {"K_p": (0.1, 10.0), "K_v": (0.1, 3.0)},
    "start": lambda rule, robot, pose: {"K_p": rule["K_p"], "K_v": rule["K_v"]},
}
"""


@pytest.fixture
def example(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    for name in ("laws", "cells"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    return runpy.run_path(str(FOLDER / "compare.py"))


@pytest.mark.heavy
def test_laws_are_compared_and_a_cell_is_a_plain_run(example, tmp_path):
    (tmp_path / "my_law.py").write_text(LAW)
    laws = ["--laws", f"controller,{tmp_path / 'my_law.py'}", "--evaluations", "4", "--workers", "2"]
    cells = ["--arms", "planar_2dof", "--mismatch", "none,payload,contact", "--motions", "point_to_point"]
    rows = example["main"]([*laws, *cells, "--out", str(tmp_path / "out")])
    assert [(row["law"], row["mismatch"]) for row in rows] == [
        (law, name) for law in ("controller", "my_law") for name in ("none", "payload", "contact")
    ]
    assert {row["verdict"] for row in rows} == {"stable"}
    errors = {(row["law"], row["mismatch"]): row["rms"] for row in rows}
    assert errors["controller", "none"] < 1e-3 * errors["my_law", "none"]  # it knows the feedforward
    assert errors["controller", "payload"] > 10.0 * errors["controller", "none"]
    row = rows[1]
    settings = {name: value for name, value in row.items() if name.startswith("plant.")}
    run = vdfmu.run(row["scenario"], parameters=settings, reference=False, out=False)
    again = example["Of"]("rms", vdfmu.load_robot("planar_2dof"))(run)
    # one program of all units runs the points: its curves equal those of the FMUs to 1e-12 of a motion of 1 rad
    np.testing.assert_allclose(again, row["rms"], rtol=1e-7)
    assert "| payload |" in (tmp_path / "out" / "summary.md").read_text()


def test_a_law_with_fewer_stable_cells_is_never_the_best(example):
    def row(law: str, motion: str, rms: float, verdict: str = "stable") -> dict[str, object]:
        return {"law": law, "arm": "a", "motion": motion, "rms": rms, "verdict": verdict}

    rows = [row("good", "m", 2e-3), row("good", "n", 4e-3), row("bad", "m", 1e-3), row("bad", "n", 1e-3, "unstable")]
    assert example["ranked"](rows, ["bad", "good"], 2) == [(0, 1.0, "good"), (1, pytest.approx(0.5), "bad")]
    equal = [row("good", "m", 1e-9), row("bad", "m", 1e-7)]  # both below what counts
    assert [mean for _, mean, _ in example["ranked"](equal, ["bad", "good"], 1)] == [1.0, 1.0]
