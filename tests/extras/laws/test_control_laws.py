"""Control laws instead of the controller of a scenario: joined by name, stable when sampled, and as exact as they can.

Along the desired motion the motors must give tau_m of the feedforward, which no law here knows. What a law lacks of it,
delta, must come from its feedback: statically, the error is K^-1 delta with the law's stiffness K against errors of all
of a joint. A step of delta makes at most twice that in a loop of second order. Along a slow motion, that is the bound.
"""

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vdfmu
from vdfmu.arm.equations.flexible_joint import rotor_position
from vdfmu.arm.robot import Robot
from vdfmu.arm.units import find_unit
from vdfmu.study.analysis.loops import margins_along
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.replace import with_units

EXAMPLE = runpy.run_path(str(Path(__file__).parents[3] / "examples/control_laws.py"))
"""The example of docs/laws.md, which has the gains."""
gains_of, run = EXAMPLE["gains_of"], EXAMPLE["run"]
LAWS = [law for law in EXAMPLE["LAWS"] if law != "controller"]
SCENARIOS = ("planar_tracking", "tracking")


def stiffness(law: str, robot: Robot, q: np.ndarray, gains: dict[str, Any]) -> np.ndarray:
    """Torque, link-side, of a law for errors of positions of links and rotors together."""
    if law == "state_feedback":
        return gains["K_q"] + gains["K_kappa"]
    if law == "computed_torque":
        return gains["k_p"] * (vdfmu.dynamics.mass_matrix(robot, q) + np.diag(robot.ell * robot.I_m))
    return np.diag(gains["K_p"] / gains.get("share", 1.0))


def settings(gains: dict[str, Any]) -> dict[str, Any]:
    return {f"controller.{name}": value for name, value in gains.items()}


@pytest.mark.heavy
@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize("law", LAWS)
def test_an_arm_follows_as_well_as_the_law_can(law, scenario):
    gains = gains_of(law, scenario)
    robot = load_scenario(scenario).arm
    results = run(law, scenario, reference=True)
    assert results.summary["reference"]["sampled"]["max_difference"]["plant.q"] <= 1e-7  # the bound of the project
    # row k + 1 of what is calculated from row k of the trajectory
    names = ("trajectory.q_d", "trajectory.q_d_dot", "trajectory.q_d_ddot")
    q_d, q_d_dot, q_d_ddot = (results[name][:-1] for name in names)
    tau_m, tau_s, kappa_dot = (results[f"feedforward.{name}"][1:] for name in ("tau_m", "tau_s", "kappa_dot_d"))
    largest = np.zeros(robot.n)
    for k in range(0, len(q_d), len(q_d) // 200):
        exact = {
            "q_d": q_d[k], "q_d_dot": q_d_dot[k], "q_d_ddot": q_d_ddot[k], "q": q_d[k], "q_dot": q_d_dot[k],
            "kappa": rotor_position(robot, q_d[k], tau_s[k]), "kappa_dot": kappa_dot[k], "tau_s": tau_s[k],
        }  # fmt: skip
        unit = find_unit(law)(robot, **gains)
        for name in exact.keys() & unit.declared.keys():
            setattr(unit, name, exact[name])
        unit.outputs()
        delta = robot.ell * (tau_m[k] - unit.tau)
        largest = np.maximum(largest, np.abs(np.linalg.solve(stiffness(law, robot, q_d[k], gains), delta)))
    error = np.abs(results["trajectory.q_d"] - results["plant.q"]).max(axis=0)
    assert (error <= 2.0 * largest).all()
    assert (error >= 0.5 * largest).all()  # and it is what there is to see


@pytest.mark.heavy
@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize("law", LAWS)
def test_the_sampled_loop_is_stable_along_the_motion(law, scenario):
    """At the torque of a sample held over 1 ms; a third is the modulus margin of a damped loop."""
    # The paper's drives take damping away at some speed, where the friction falls: there less is left of it.
    system = with_units(load_scenario(scenario), {"controller": law})
    loops = margins_along(system, parameters=settings(gains_of(law, scenario))).judged.loops
    assert (loops.modulus > (0.05 if scenario == "tracking" else 0.33)).all()


def test_inputs_of_the_law_are_joined_by_name_and_terminal_and_each_of_two_arms_joins_its_own_plant():
    scenario = with_units(load_scenario("planar_tracking"), {"controller": "joint_torque"})
    assert scenario.system.joined == ("plant.kappa -> controller.kappa", "plant.tau_s -> controller.tau_s")
    assert scenario.system.connections["plant.tau_s"] == ["controller.tau_s"]
    assert "plant.q -> controller.q" in scenario.system.dropped
    same = with_units(load_scenario("planar_tracking"), {"controller": "controller"})
    assert same.system.joined == same.system.dropped == ()
    assert scenario.system.unfed == same.system.unfed == {}
    before = load_scenario("two_arms")
    parts = [name for name in before.system.parts if "controller" in name]
    assert len(parts) > 1
    after = with_units(before, dict.fromkeys(parts, "joint_torque"))
    for part in parts:
        plants = {
            source.partition(".")[0]
            for source, targets in before.system.connections.items()
            if f"{part}.kappa_dot" in targets
        }
        (plant,) = plants
        assert f"{plant}.tau_s -> {part}.tau_s" in after.system.joined
    after.resolved.check_connections()
