"""Notes on a finished run: the torque that an inverse omits, and springs whose phase depends on the tolerance."""

from typing import Any

import numpy as np
import pytest

import vdfmu
from vdfmu.arm.equations.desired_drive import desired_drive_motion
from vdfmu.arm.equations.feedforward import feedforward_inverse
from vdfmu.arm.equations.flexible_joint import rotor_position
from vdfmu.arm.equations.trajectory import desired_motion
from vdfmu.system.scenario import load_scenario

SCENARIO = load_scenario("planar_tracking")
ARM = SCENARIO.arm


def run(settings: dict[str, Any], stop: float) -> tuple[vdfmu.Results, list[str]]:
    """Run the planar arm, and return what it said after its start."""
    results = vdfmu.run("planar_tracking", parameters=settings, stop=stop, reference=False, out=False)
    return results, [note for note in results.summary["notes"] if note.startswith(("feedforward: ", "plant: "))]


def lacking(T: float, h: float) -> float:
    """Return the torque [N.m] of motor 1 for the second difference of what its rotor's motion lacks, by the equations.

    It is largest where the torque of spring 2 passes 0: there D'' of (3) jumps, and the place of rotor 1 with it.
    """
    motion = SCENARIO.sections["trajectory"]
    start, end = (np.array(motion[name]) for name in ("q_start", "q_end"))

    def missing(t: float) -> float:
        desired = desired_motion(t, start, end, T)
        tau_s = feedforward_inverse(ARM, desired).tau_s
        return float((rotor_position(ARM, desired.q_d, tau_s) - desired_drive_motion(ARM, desired).kappa)[0])

    places = [missing(k * h) for k in range(4, round(T / h) - 4)]
    return float(ARM.I_m[0] * np.abs(np.diff(places, 2)).max() / h**2)


@pytest.mark.heavy
def test_a_run_says_what_the_inverse_leaves_out_and_that_stiff_springs_depend_on_the_tolerance():
    _, (note,) = run({"trajectory.T": 0.25}, 0.3)
    assert "motor 1 in a step, because its rotors are coupled and the motion is fast" in note
    said = float(note.partition("omits ")[2].partition(" of ")[0])
    # the note takes the slope of D once, at the middle of three steps in which the springs go through 10 % of it
    np.testing.assert_allclose(said, lacking(0.25, 1e-3), rtol=0.25)
    assert run({}, 2.0)[1] == []  # T = 2 s
    _, (note,) = run(STIFF | LET_GO, 0.1)
    assert "of up to" in note and note.endswith("Compare with plant.tolerance = 1e-9.")
    assert [run(settings, 0.1)[1] for settings in QUIET] == [[], [], []]


STIFF = {"plant.K_f0": 1e4 * ARM.K_f0, "plant.K_w0": 1e4 * ARM.K_w0}
LET_GO = {
    "plant.equilibrium": False, "plant.kappa_dot_0": 0.1, "controller.K_p": 0.0, "controller.K_v": 0.0,
    "plant.f_c": 0.0, "plant.f_s": 0.0, "plant.f_v": 0.0,
}  # fmt: skip
LINEAR = {"plant.c_f": 1e-4 * ARM.c_f, "plant.c_w": 1e-4 * ARM.c_w}


QUIET = (STIFF | LET_GO | LINEAR, STIFF | LET_GO | {"plant.kappa_dot_0": 0.0}, LET_GO)
"""Springs that do not stiffen, stiff ones that hardly swing, and those of the arm."""
