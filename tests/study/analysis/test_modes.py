"""The arm at a pose as a linear system, and its modes: closed forms, energies, differences and runs of the plant."""

import dataclasses
import sys

import numpy as np
import pytest
from scipy.linalg import eigh

import vdfmu
from tests.study.analysis.lift import ONE_JOINT, POSES, roots
from vdfmu.arm.equations.harmonic_drive import deformation_derivative
from vdfmu.arm.equations.plant import plant_outputs
from vdfmu.arm.units.plant import Plant
from vdfmu.base.errors import UsageError
from vdfmu.compiler.unit.evaluate import Plain
from vdfmu.compiler.unit.interface import Interface
from vdfmu.study.analysis.modes import middle_pose, natural_modes


@pytest.mark.parametrize("dry", [False, True])
def test_friction_of_one_joint_has_its_closed_form(lift, dry):
    f = float(lift.f_v[0] + (lift.f_s[0] / lift.eps[0] if dry else 0.0))  # (54) at rest
    modes, (s, *_) = natural_modes(lift, [0.1], dry=dry), roots(lift, f)
    (up,) = s[s.imag > 0]
    # rounding, as above
    assert modes.frequency == pytest.approx(abs(up) / (2 * np.pi), rel=1e-9)
    assert modes.damping == pytest.approx(-up.real / abs(up), rel=1e-7)
    np.testing.assert_allclose(modes.rates, [*s[s.imag == 0].real, 0.0], rtol=1e-7, atol=1e-7)


@pytest.mark.few(3)
@pytest.mark.parametrize("coupling", [False, True])
@pytest.mark.parametrize("name", POSES)
def test_modes_without_friction_are_those_of_the_energies(name, coupling):
    """Frequencies of the kinetic energy of links and rotors, and of springs and gravity."""
    robot = dataclasses.replace(vdfmu.load_robot(name), rotor_coupling=coupling).with_parameters(f_v=0.0)
    n, q = robot.n, np.array(POSES[name])
    unit = np.eye(2 * n)

    def energy(v):
        return plant_outputs(robot, np.concatenate([q, v, np.zeros(n)])).E_kin

    M = np.array([[energy(a + b) - energy(a) - energy(b) for b in unit] for a in unit])
    slope = [
        (vdfmu.dynamics.gravity_torque(robot, q + d) - vdfmu.dynamics.gravity_torque(robot, q - d)) / 2e-6
        for d in 1e-6 * np.eye(n)
    ]
    k = np.diag(1.0 / deformation_derivative(robot, vdfmu.dynamics.gravity_torque(robot, q)))
    K = np.block([[k + np.array(slope).T, -k], [-k, k]])
    K = (K + K.T) / 2.0  # of rounding of the differences
    for motors, size in (("free", 2 * n), ("held", n)):
        w2, shapes = eigh(K[:size, :size], M[:size, :size])
        modes = natural_modes(robot, q, motors=motors)
        # gravity's difference quotient has errors of 1e-8 N.m, of stiffnesses of 1e3 and more
        np.testing.assert_allclose(modes.frequency[-n:], np.sqrt(w2[-n:]) / (2 * np.pi), rtol=1e-8)
        np.testing.assert_allclose(modes.damping[-n:], 0.0, atol=1e-8)
        both = np.hstack([modes.links, modes.rotors])[-n:, :size]
        for mine, other in zip(both, shapes.T[-n:], strict=True):
            scaled = other * (mine @ other) / (other @ other)
            # eigenvectors of frequencies that are a few per cent apart: 30 times the error of the matrix
            np.testing.assert_allclose(mine, scaled, atol=1e-5)
        np.testing.assert_allclose(modes.share.sum(axis=1), 1.0, rtol=1e-12)


@pytest.mark.parametrize("dry", [False, True])
@pytest.mark.parametrize("name", ["planar_2dof", "slider_3dof"])
def test_the_linear_system_has_the_differences_of_the_plant(name, dry):
    robot = vdfmu.load_robot(name)
    system = vdfmu.linearize(robot, POSES[name], dry=dry)
    plain = plain_plant(robot, dry)
    plain.group("tau")[:] = system.u[: robot.n]

    def both(x, u):
        plain.group("tau")[:], plain.group("F_e")[:] = u[: robot.n], u[robot.n :]
        x_dot = plain.rate(0.0, x)
        plain.outputs()
        return np.concatenate([x_dot, x, plain.group("kappa"), plain.group("p_O")])

    x, u, n_x = system.x, system.u, len(system.x)
    rest = both(x, u)
    # the equilibrium: rounding of torques of some 10 N.m over inertias of 1e-3 kg m2
    np.testing.assert_allclose(rest[:n_x], 0.0, atol=1e-10)
    np.testing.assert_allclose(rest[n_x:], system.y, atol=1e-14)
    h = 1e-7
    A_C = np.array([(both(x + d, u) - both(x - d, u)) / (2 * h) for d in h * np.eye(n_x)]).T
    B_D = np.array([(both(x, u + d) - both(x, u - d)) / (2 * h) for d in h * np.eye(len(u))]).T
    # rounding of the differences, 1e-16 of 1e4 rad/s2 over 1e-7; slopes of springs bend at zero torque: c_w h K / ell
    scale = np.abs(system.A).max()
    np.testing.assert_allclose(A_C, np.vstack([system.A, system.C]), rtol=1e-4, atol=1e-8 * scale)
    np.testing.assert_allclose(B_D, np.vstack([system.B, system.D]), rtol=1e-6, atol=1e-6)


def test_springs_without_load_deflect_by_their_compliance():
    """Three joints of the arm carry no weight; |tau| has no slope there, the deformation has."""
    robot = vdfmu.load_robot("manipulator_6dof")
    system, joints = vdfmu.linearize(robot, np.zeros(6)), range(1, 7)
    kappa = [system.outputs.index(f"kappa[{i}]") for i in joints]
    tau_s = [system.states.index(f"tau_s[{i}]") for i in joints]
    assert (system.x[tau_s] == 0.0).sum() == 3
    # a sum of two terms, each of some 5 operations
    expected = np.diag(deformation_derivative(robot, system.x[tau_s]))
    np.testing.assert_allclose(system.C[np.ix_(kappa, tau_s)], expected, rtol=1e-15 * 10)


def plain_plant(robot, dry):
    plain = Plain(Interface(Plant, robot))
    if not dry:
        for name in ("f_c", "f_s", "f_ck"):
            if name in plain.interface.groups:
                plain.group(name)[:] = 0.0
    return plain


def test_the_linear_system_goes_to_other_tools(monkeypatch):
    system = vdfmu.linearize(vdfmu.load_robot("slider_3dof"), POSES["slider_3dof"])
    assert system.states[:2] == ("q[1]", "q[2]") and system.state_units[:2] == ("rad", "m")
    assert system.inputs[2:4] == ("tau[3]", "F_e[1]") and system.input_units[2:4] == ("N.m", "N")
    assert system.outputs[-1] == "p_O[3]" and system.output_units[-4:] == ("rad", "m", "m", "m")
    dotted = dataclasses.replace(system, inputs=("plant.tau[1]", *system.inputs[1:]))
    for other in (system.to_scipy(), dotted.to_control()):
        for name in "ABCD":
            np.testing.assert_array_equal(getattr(other, name), getattr(system, name))
    # python-control refuses names with a dot
    assert other.input_labels == ["plant_tau[1]", *system.inputs[1:]] and other.state_labels == [*system.states]
    assert other.output_labels == [*system.outputs]
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(UsageError, match="pip install control"):
        system.to_control()


def test_what_cannot_be_linearised_is_said(lift, tmp_path):
    with pytest.raises(UsageError, match="expected a Robot, got str"):
        vdfmu.linearize("planar_2dof", [0.0, 0.0])
    for at in ([0.0, 1.0], [np.nan], 0.0):
        with pytest.raises(UsageError, match="lift: expected 1 finite position"):
            vdfmu.linearize(lift, at)
    with pytest.raises(UsageError, match="motors: expected free or held, got 'off'"):
        natural_modes(lift, [0.0], motors="off")
    limits = "[joints.limits]\nq_min = 0.05\nq_max = 0.5\nstop_stiffness = 1e5\nstop_damping = 1.0\n"
    weak = "kappa_dot_max = 0.5\ntau_stall = 0.01\n"
    (tmp_path / "weak.toml").write_text(ONE_JOINT + limits + weak)
    with pytest.raises(UsageError) as raised:
        vdfmu.linearize(vdfmu.load_robot(tmp_path / "weak.toml"), [0.6])
    assert "joint 1 at 0.6: expected 0.05 to 0.5, between its end stops" in str(raised.value)
    # 2.5 kg x 9.81 m/s2 / 600 rad/m
    assert "at most 0.01 N.m, but it takes 0.04088 N.m" in str(raised.value)
    (tmp_path / "strong.toml").write_text(ONE_JOINT + limits + weak.replace("0.01", "1.0"))
    assert middle_pose(vdfmu.load_robot(tmp_path / "strong.toml")) == [0.275]  # 0 is beyond an end stop
