"""The public functions of positions, one state and batches: against Pinocchio, the equations, and each other."""

import numpy as np
import pinocchio as pin
import pytest

from tests.arm.balanced import EVERY_CHAIN
from vdfmu import dynamics
from vdfmu.base.errors import KernelError, UsageError

FUNCTIONS = (dynamics.gravity_torque, dynamics.mass_matrix, dynamics.jacobian, dynamics.forward_kinematics)


def positions(chain, draw, seed):
    return np.array([state.q for state in draw(chain, 20, seed=seed)])


def test_batches_agree_with_pinocchio(chain, draw, pinocchio_model):
    model = pinocchio_model(chain)
    data = model.createData()
    tool = pin.SE3(chain.tool_rotation, chain.tool_offset)
    q = positions(chain, draw, seed=80)
    p_O, R_O = dynamics.forward_kinematics(chain, q)
    results = zip(q, dynamics.gravity_torque(chain, q), dynamics.mass_matrix(chain, q), dynamics.jacobian(chain, q),
                  p_O, R_O, strict=True)  # fmt: skip
    for q_k, G, M, J_q, p, R in results:
        theirs = pin.computeGeneralizedGravity(model, data, q_k)
        # 1e-12 of the largest entry, some 5000 roundings, as the inverse dynamics; gravity without torque rounds too.
        np.testing.assert_allclose(G, theirs, rtol=0, atol=1e-12 * max(np.abs(theirs).max(), 1.0))
        theirs = pin.crba(model, data, q_k)
        theirs = np.triu(theirs) + np.triu(theirs, 1).T
        np.testing.assert_allclose(M, theirs, rtol=0, atol=1e-12 * np.abs(theirs).max())
        theirs = tool.toActionMatrixInverse() @ pin.computeJointJacobian(model, data, q_k, chain.n)
        # Some 20 n products; prismatic joints reach up to pi m.
        np.testing.assert_allclose(J_q, theirs, rtol=0, atol=1e-13)
        pin.forwardKinematics(model, data, q_k)
        pose = data.oMi[chain.n].act(tool)
        np.testing.assert_allclose(p, pose.translation, rtol=0, atol=1e-13)
        np.testing.assert_allclose(R, pose.rotation, rtol=0, atol=1e-14)  # of size 1, else as above


@EVERY_CHAIN
def test_gravity_torque_and_mass_matrix_make_up_the_inverse_dynamics(chain, draw):
    state = draw(chain, 1, seed=82)[0]
    tau = dynamics.inverse_dynamics(chain, state.q, np.zeros(chain.n), state.q_ddot, state.F_e)
    parts = (
        dynamics.mass_matrix(chain, state.q) @ state.q_ddot
        + dynamics.gravity_torque(chain, state.q)
        + dynamics.jacobian(chain, state.q).T @ state.F_e
    )
    # n products more than the inverse dynamics, whose bound is 1e-12.
    np.testing.assert_allclose(parts, tau, rtol=0, atol=1e-12 * np.abs(tau).max())


def test_pose_of_no_position_is_empty(planar):
    p_O, R_O = dynamics.forward_kinematics(planar, np.empty((0, 2)))
    assert p_O.shape == (0, 3) and R_O.shape == (0, 3, 3)


@pytest.mark.parametrize(("q", "message"), [
    ([0.0], r"q: expected shape \(2,\) or \(m, 2\), got \(1,\)"),
    (0.0, r"q: expected shape \(2,\) or \(m, 2\), got \(\)"),
    (np.zeros((2, 2, 2)), r"q: expected shape .*, got \(2, 2, 2\)"),
    ([0.0, np.nan], r"q\[1\]: expected a finite number, got nan"),
    ([[0.0, 0.0], [np.inf, 0.0]], r"q\[1, 0\]: expected a finite number, got inf"),
    (["a", "b"], r"q: expected numbers of shape \(2,\) or \(m, 2\)"),
    ([[0.0, 0.0], [0.0]], r"q: expected numbers of shape \(2,\) or \(m, 2\)"),
])  # fmt: skip
def test_wrong_arguments_are_named(planar, q, message):
    for function in FUNCTIONS:
        with pytest.raises(KernelError, match=message):
            function(planar, q)
        with pytest.raises(UsageError, match="expected a Robot, got .*planar_2dof.. Load it with vdfmu.load_robot"):
            function("planar_2dof", [0.0, 0.0])
    with pytest.raises(KernelError, match=r"batches of different lengths \[2, 3\]: expected one length"):
        dynamics.inverse_dynamics(planar, np.zeros((2, 2)), np.zeros((3, 2)), np.zeros(2))


def test_a_result_that_is_not_finite_is_an_error(planar):
    """Also of a batch; numbers beyond floats are those of wrong arguments."""
    broken, zero = planar.with_parameters(mass=0.0, inertia=np.zeros((3, 3))), np.zeros(2)
    for q in (zero, np.zeros((3, 2))):
        with pytest.raises(KernelError, match="forward_dynamics: expected a finite result, got nan .* check_robot"):
            dynamics.forward_dynamics(broken, q, zero, zero)
    with pytest.raises(KernelError, match="q: expected numbers of shape .* int too large"):
        dynamics.gravity_torque(planar, [10**400, 0.0])
