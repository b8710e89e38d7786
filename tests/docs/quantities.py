"""Quantities of which `docs/claims.toml` speaks, where no command prints them."""

import numpy as np

import vdfmu
from vdfmu.arm.equations.plant import equilibrium_torque
from vdfmu.arm.units import find_unit as find_unit
from vdfmu.arm.units import shipped_units
from vdfmu.arm.units.devices.encoder import PAST as PAST
from vdfmu.compiler.functions.rodas import ALPHA as ALPHA
from vdfmu.compiler.functions.rodas import GAMMA_I as GAMMA_I
from vdfmu.compiler.unit.interface import Interface
from vdfmu.study.analysis.loops import margins_along
from vdfmu.study.analysis.reach import steepest_fall as steepest_fall
from vdfmu.system.scenario import load_scenario
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


def gains_and_margins():
    """Return K_p, K_v, modulus margin and delay margin [ms] of each joint of `tracking`, the smallest along the run."""
    margins = margins_along("tracking").margins
    modulus, delay = (np.min([getattr(each, name) for each in margins], axis=0) for name in ("modulus", "delay"))
    K_p, K_v = (group_value(load_scenario("tracking"), f"controller.{name}") for name in ("K_p", "K_v"))
    return np.stack([K_p, K_v, modulus, 1e3 * delay], axis=1)
