"""One state and large batches from Python: what is prepared once and compiled says the same."""

import threading

import numpy as np
import pytest

import vdfmu
from vdfmu.base.errors import KernelError

LARGE = 60_000
"""States from which on a batch is worth a compilation, and some more."""


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


def test_a_large_batch_is_compiled_says_the_same_and_is_checked(arm, tmp_path, monkeypatch):
    monkeypatch.setenv("VDFMU_CACHE_DIR", str(tmp_path))
    q, q_dot, q_ddot = motion(arm.n, LARGE)
    F_e = np.arange(6.0)
    fast = vdfmu.dynamics.inverse_dynamics(arm, q, q_dot[0], q_ddot, F_e)
    assert any((tmp_path / "native").iterdir())  # where a library is
    plain = vdfmu.dynamics.inverse_dynamics(arm.with_parameters(f_v=1.0), q[:300], q_dot[0], q_ddot[:300], F_e)
    # the same operations; sin and cos of another library differ by a rounding of terms of at most some 100 N m
    np.testing.assert_allclose(fast[:300], plain, rtol=0, atol=1e-12)
    # not contiguous; accelerations of at most some 1e3 rad/s2
    fast = vdfmu.dynamics.forward_dynamics(arm, q[:, ::-1], q_dot, q_ddot)
    plain = vdfmu.dynamics.forward_dynamics(arm.with_parameters(f_v=1.0), q[:300, ::-1], q_dot[:300], q_ddot[:300])
    np.testing.assert_allclose(fast[:300], plain, rtol=1e-12, atol=1e-10)
    q[7, 1] = np.nan
    with pytest.raises(KernelError, match=r"q\[7, 1\]: expected a finite number, got nan"):
        vdfmu.dynamics.inverse_dynamics(arm, q, q_dot, q_ddot)
    assert vdfmu.dynamics.inverse_dynamics(arm, q[:0], q_dot[:0], q_ddot[:0]).shape == (0, arm.n)
