"""One state and large batches from Python: what is prepared once and compiled says the same."""

import threading

import numpy as np
import pytest

import vdfmu
from vdfmu.arm import kernel
from vdfmu.arm.kernel import Kernel
from vdfmu.base.errors import KernelError
from vdfmu.compiler.c import loaded


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


def test_a_large_batch_runs_compiled_and_says_the_same(arm, monkeypatch):
    q, q_dot, q_ddot = motion(arm.n, 300)
    F_e = np.arange(6.0)
    plain = vdfmu.dynamics.inverse_dynamics(arm, q, q_dot[0], q_ddot, F_e)
    monkeypatch.setattr(kernel, "_WORTH", 400)

    def refused(*_):
        raise AssertionError("not compiled")

    monkeypatch.setattr(Kernel, "calculate", refused)
    fast = vdfmu.dynamics.inverse_dynamics(arm, q, q_dot[0], q_ddot, F_e)
    monkeypatch.undo()
    # the same operations; sin and cos of another library differ by a rounding of terms of at most some 100 N m
    np.testing.assert_allclose(fast, plain, rtol=0, atol=1e-12)
    pose = vdfmu.dynamics.forward_dynamics(arm, q[:, ::-1], q_dot, q_ddot)  # not contiguous, and not yet compiled
    monkeypatch.setattr(kernel, "_WORTH", 0)
    # accelerations of at most some 1e3 rad/s2
    np.testing.assert_allclose(
        vdfmu.dynamics.forward_dynamics(arm, q[:, ::-1], q_dot, q_ddot), pose, rtol=1e-12, atol=1e-10
    )


def test_a_large_batch_is_checked_too_and_without_the_compiler_the_same(arm, monkeypatch):
    monkeypatch.setattr(kernel, "_WORTH", 0)
    q = np.zeros((100, arm.n))
    q[7, 1] = np.nan
    with pytest.raises(KernelError, match=r"q\[7, 1\]: expected a finite number, got nan"):
        vdfmu.dynamics.gravity_torque(arm, q)
    assert vdfmu.dynamics.gravity_torque(arm, q[:0]).shape == (0, arm.n)
    q, q_dot, q_ddot = motion(arm.n, 10)
    plain = vdfmu.dynamics.inverse_dynamics(arm, q, q_dot, q_ddot)
    monkeypatch.setattr(kernel, "_WORTH", 0)
    monkeypatch.setattr(loaded, "native_available", lambda: False)
    np.testing.assert_array_equal(vdfmu.dynamics.inverse_dynamics(arm, q, q_dot, q_ddot), plain)
