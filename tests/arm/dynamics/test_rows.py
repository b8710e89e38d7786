"""States and batches of them from Python, also in threads."""

import threading

import numpy as np
import pytest

import vdfmu
from vdfmu.base.errors import KernelError


@pytest.fixture
def arm(planar):
    return planar.with_parameters(gravity=planar.gravity)


def motion(n, m, seed=1):
    return tuple(np.random.default_rng(seed).standard_normal((3, m, n)))


def test_results_of_one_state_are_copies_and_threads_do_not_meet(arm):
    first = vdfmu.dynamics.gravity_torque(arm, np.zeros(arm.n))
    before = first.copy()
    vdfmu.dynamics.gravity_torque(arm, np.ones(arm.n))
    np.testing.assert_array_equal(first, before)
    q, q_dot, q_ddot = motion(arm.n, 200)
    expected = vdfmu.dynamics.inverse_dynamics(arm, q, q_dot, q_ddot)
    wrong = []

    def work():
        for _ in range(5):
            for k in range(200):
                tau = vdfmu.dynamics.inverse_dynamics(arm, q[k], q_dot[k], q_ddot[k])
                wrong.extend([k] if np.any(tau != expected[k]) else [])

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


def test_a_batch_says_the_same_as_its_states_and_is_checked(arm):
    q, q_dot, q_ddot = motion(arm.n, 30)
    F_e = np.arange(6.0)
    batch = vdfmu.dynamics.inverse_dynamics(arm, q, q_dot[0], q_ddot, F_e)
    alone = [vdfmu.dynamics.inverse_dynamics(arm, q[k], q_dot[0], q_ddot[k], F_e) for k in range(30)]
    np.testing.assert_array_equal(batch, alone)
    # not contiguous
    batch = vdfmu.dynamics.forward_dynamics(arm, q[:, ::-1], q_dot, q_ddot)
    alone = [vdfmu.dynamics.forward_dynamics(arm, q[k, ::-1], q_dot[k], q_ddot[k]) for k in range(30)]
    np.testing.assert_array_equal(batch, alone)
    q[7, 1] = np.nan
    with pytest.raises(KernelError, match=r"q\[7, 1\]: expected a finite number, got nan"):
        vdfmu.dynamics.inverse_dynamics(arm, q, q_dot, q_ddot)
    assert vdfmu.dynamics.inverse_dynamics(arm, q[:0], q_dot[:0], q_ddot[:0]).shape == (0, arm.n)
