"""Quantities of which `docs/claims.toml` speaks, where no command prints them."""

import numpy as np

import vdfmu
from vdfmu.arm.equations.mapping import jacobian
from vdfmu.arm.equations.plant import equilibrium_torque
from vdfmu.arm.robot import robot_names as robot_names
from vdfmu.arm.robot.catalogue import catalogue, spring_residual
from vdfmu.arm.units import find_unit as find_unit
from vdfmu.arm.units import shipped_units
from vdfmu.compiler.functions.rodas import ALPHA as ALPHA
from vdfmu.compiler.functions.rodas import GAMMA_I as GAMMA_I
from vdfmu.compiler.unit.interface import Interface
from vdfmu.engine.inspect import trial as trial
from vdfmu.engine.package import archive as archive
from vdfmu.extras.inspect import abilities as abilities
from vdfmu.extras.inspect import reference as reference
from vdfmu.extras.laws.units.devices.encoder import PAST as PAST
from vdfmu.extras.robots.reach import steepest_fall as steepest_fall
from vdfmu.study import coupling_error as coupling_error
from vdfmu.study.analysis.loops import margins_along
from vdfmu.system.scenario import load_scenario as load_scenario
from vdfmu.system.scenario import scenario_names as scenario_names
from vdfmu.system.scenario.values import group_value

N = 6
END = np.radians([90.0, 60.0, 60.0, 90.0, 60.0, 90.0])
"""Position at the end of (57) in `tracking`."""


def plant_jacobian(robot):
    call = Interface(shipped_units()["plant"], robot).functions.function("plant_jacobian")
    call.args["p"][:] = robot.values()

    def jacobian(x):
        call.args["x"][:] = x
        call.run()
        return call.results["J"].reshape(4 * N, 4 * N, order="F").copy()

    return jacobian


def elastic_modes(gravity_holds, locked):
    """Return the lowest and highest elastic frequency [Hz] of the paper's arm over the poses of (57), at rest."""
    arm = vdfmu.load_robot("manipulator_6dof").with_parameters(f_c=0.0, f_s=0.0, f_v=0.0)
    jacobian, frequencies = plant_jacobian(arm), []
    for s in np.linspace(0.0, 1.0, 101):
        tau_s = equilibrium_torque(arm, s * END) if gravity_holds else np.zeros(N)
        J = jacobian(np.concatenate([s * END, np.zeros(2 * N), tau_s]))
        if locked:
            keep = np.delete(np.arange(4 * N), np.s_[2 * N : 3 * N])
            J = J[np.ix_(keep, keep)]
        modes = np.sort(np.abs(np.linalg.eigvals(J).imag) / (2.0 * np.pi))
        modes = modes[modes > 2.0][::2]  # below is the pendulum, not the springs
        assert len(modes) == N  # one for each joint
        frequencies += [modes[0], modes[-1]]
    return min(frequencies), max(frequencies)


def stability_numbers():
    """Return K_v h / (ell I_m) of each joint of `tracking`."""
    scenario = load_scenario("tracking")
    return group_value(scenario, "controller.K_v") * scenario.step / (scenario.robot.ell * scenario.robot.I_m)


def friction_rate():
    """Return the largest rate [1/s] that friction near standstill adds to the paper's arm."""
    arm = vdfmu.load_robot("manipulator_6dof")
    return (arm.f_s / (arm.eps * arm.ell * arm.I_m)).max()


def growth(source, share=1.0):
    """Return the largest real parts [1/s] of the loop of `tracking` at 0.5 rad/s, at poses of (57).

    K_v acts on `source`, "kappa_dot" or "q_dot", both gains with a `share`. Nothing is sampled.
    """
    scenario = load_scenario("tracking")
    arm, jacobian = scenario.robot, plant_jacobian(scenario.robot)
    K_p, K_v = (share * group_value(scenario, f"controller.{name}") for name in ("K_p", "K_v"))
    rotor, rates = slice(2 * N, 3 * N), []
    velocity = rotor if source == "kappa_dot" else slice(N, 2 * N)
    for s in (0.0, 0.5, 1.0):
        q = s * END
        J = jacobian(np.concatenate([q, np.full(2 * N, 0.5), equilibrium_torque(arm, q)]))
        J[rotor, :N] -= np.diag(K_p / arm.ell / arm.I_m)
        J[rotor, velocity] -= np.diag(K_v / arm.ell / arm.I_m)
        rates.append(np.linalg.eigvals(J).real.max())
    return rates


def spring_fits():
    """Return the deviation of (2)-(3) from the catalogue for each gear, in % of the largest torsion."""
    return [100.0 * spring_residual(gear)[1] for gear in catalogue()["gears"].values()]


def contact_dampings():
    """Return the dampings [N.s/m] at the end of `wall`: least, actual, largest along the normal; actual, largest along.

    They are k h / 2, c N and 2 m / h with the apparent mass m of the arm; mu N / v_eps and 2 m / h.
    """
    scenario = load_scenario("wall")
    results = vdfmu.run(scenario, reference=False, out=False)
    q, R, normal = (results[name][-1] for name in ("plant.q", "plant.R_O", "wall.N"))
    wall, J = scenario.sections["wall"], jacobian(scenario.robot, q)
    levers = [np.concatenate([R.T @ axis, np.zeros(3)]) @ J for axis in ([0.0, 0.0, 1.0], [1.0, 0.0, 0.0])]
    M = vdfmu.dynamics.mass_matrix(scenario.robot, q)
    across, along = (2.0 / scenario.step / (lever @ np.linalg.solve(M, lever)) for lever in levers)
    sliding = wall["mu"] * normal / find_unit("wall").declared["v_eps"].start
    return 0.5 * wall["k"] * scenario.step, wall["c"] * normal, across, sliding, along


def gains_and_margins():
    """Return K_p, K_v, modulus margin and delay margin [ms] of each joint of `tracking`, the smallest along the run."""
    margins = margins_along("tracking").margins
    modulus, delay = (np.min([getattr(each, name) for each in margins], axis=0) for name in ("modulus", "delay"))
    K_p, K_v = (group_value(load_scenario("tracking"), f"controller.{name}") for name in ("K_p", "K_v"))
    return np.stack([K_p, K_v, modulus, 1e3 * delay], axis=1)
