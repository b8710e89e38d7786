"""Systems of foreign FMUs linearised: closed forms, differences instead of derivatives, what is refused and noted."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

from tests.conftest import heavy
from tests.engine.reference import models
from vdfmu.base.errors import UsageError
from vdfmu.base.state_space import expm
from vdfmu.engine.linear.linearise import linear_system

LAG = replace(models.LAG, name="LagME", kinds=("ModelExchange",))
RING = ["a.x -> b.u", "b.x -> a.u"]
STEP = 0.2


@pytest.mark.parametrize("norm", [0.0, 1e-8, 0.5, 5.0, 40.0])
def test_the_exponential_of_a_matrix_is_that_of_scipy(norm):
    A = np.random.default_rng(3).standard_normal((9, 9))
    A *= norm / np.abs(A).sum(axis=0).max()
    exact = scipy.linalg.expm(A)
    # each squaring doubles the rounding of the scaled one, 9 terms a sum: 9 eps norm of the largest entry, and scipy's
    limit = 2 * 9 * np.finfo(float).eps * max(norm, 1.0) * np.abs(exact).max()
    np.testing.assert_allclose(expm(A), exact, rtol=0.0, atol=limit)


@pytest.mark.parametrize("at", [*heavy(None), 1.0])
def test_two_lags_that_follow_each_other_have_their_closed_form(system, at):
    path = system({"a": (LAG, "2.0"), "b": (LAG, "3.0")}, RING)
    linear = linear_system(path, at, step=STEP, algorithm="jacobi")
    continuous, sampled = linear.continuous(), linear.sampled()
    assert continuous.states == ("a.x", "b.x") and continuous.inputs == ("a.u", "b.u")
    # differences of a linear model: rounding, 1e-16 over 1e-6
    np.testing.assert_allclose(continuous.A, [[-1, 1], [1, -1]], atol=1e-9)
    np.testing.assert_allclose(continuous.B, np.eye(2), atol=1e-9)
    np.testing.assert_allclose(continuous.C, np.eye(2), atol=1e-9)
    # x of each goes to the other's x of the last communication point, with e^-h left of its own: sum and difference
    e = np.exp(-STEP)
    poles = np.sort(np.abs(np.linalg.eigvals(sampled.A)))
    np.testing.assert_allclose(poles[-2:], np.sort([1.0, abs(2 * e - 1)]), atol=1e-9)
    assert sampled.step == STEP and sampled.states[2:] == ("at a.u", "at b.u")
    assert [note.partition(": ")[2] for note in continuous.notes] == ["a", "b"]
    assert "without directional derivatives, by differences" in continuous.notes[0]


def test_an_opened_loop_is_what_comes_back_and_what_gives_no_derivatives_is_refused(system):
    """Through both lags, 1 / (s + 1)^2; opened at both, one each."""
    linear = linear_system(system({"a": (LAG, "2.0"), "b": (LAG, "2.0")}, RING), step=STEP)
    w = np.array([0.1, 1.0, 10.0])
    opened = linear.continuous(["a.u"])
    assert opened.outputs == ("a.x", "b.x", "a.u")
    # rounding of the differences
    np.testing.assert_allclose(opened.response(w)[:, 2, 0], 1 / (1j * w + 1) ** 2, atol=1e-9)
    both = linear.continuous(["a", "b.u"][1:] + ["a.u"]).response(w)
    np.testing.assert_allclose(both[:, 2:, 0], np.array([1 / (1j * w + 1), 0 * w]).T, atol=1e-9)
    with pytest.raises(UsageError, match=r"a\.x: expected connected continuous inputs. There are: a\.u, b\.u"):
        linear.continuous(["a.x"])
    with pytest.raises(UsageError, match="b: expected FMUs with directional derivatives, or for model exchange"):
        linear_system(system({"a": (LAG, "2.0"), "b": (models.LAG, "2.0")}, RING), step=STEP)
    derives = models.CONTROLLER.simulation | {"providesDirectionalDerivatives": "true"}
    sampled = replace(models.CONTROLLER, name="SampledDerives", simulation=derives)
    path = system({"c": (sampled, "3.0"), "p": (LAG, "3.0")}, ["p.x -> c.e", "c.u -> p.u"])
    linear = linear_system(path, step=STEP)
    notes = linear.continuous().notes
    assert "treated as constant, because it changes only at communication points: c.u" in notes
    with pytest.raises(
        UsageError, match=r"c\.u: the sampled loop cannot be linearised, because these change at communication points"
    ):
        linear.sampled()
