"""Systems, inverses and exponentials of matrices in units: symbols against numpy and scipy, with exchanges of rows."""

import casadi as ca
import numpy as np
import pytest
from scipy import linalg

from vdfmu.base.errors import UsageError
from vdfmu.compiler.scalar.matrices import expm, inv, solve
from vdfmu.compiler.scalar.symbol import SymbolArray, from_sx, to_sx

EPS = np.finfo(float).eps
RNG = np.random.default_rng(22)


def symbols(name, *shape):
    column = ca.SX.sym(name, int(np.prod(shape)))
    return column, from_sx(column).reshape(shape).view(SymbolArray)


def permuted(n):
    """Return a matrix without a diagonal that could be divided by, and one that only exchanges make safe."""
    yield np.eye(n)[RNG.permutation(n)] * RNG.uniform(0.5, 2.0, n)
    tiny = RNG.normal(size=(n, n))
    tiny[np.diag_indices(n)] = 1e-17
    yield tiny


@pytest.mark.parametrize("n", [1, 2, 3, 5, 8])
def test_solutions_are_those_of_numpy(n):
    a, A = symbols("A", n, n)
    b, B = symbols("b", n, 2)
    solved = ca.Function("solved", [a, b], [to_sx(np.linalg.solve(A, B)), to_sx(np.linalg.inv(A))])
    for M in [*RNG.normal(size=(200, n, n)), *permuted(n), *permuted(n)]:
        right = RNG.normal(size=(n, 2))
        x, inverse = (np.array(value).reshape(n, -1) for value in solved(M.ravel(), right.ravel()))
        # partial pivoting is backward stable: n^2 roundings of growth at most 2^(n-1), in practice below n
        bound = 10 * n**3 * EPS * np.linalg.cond(M)
        expected = np.linalg.solve(M, right)
        np.testing.assert_allclose(x, expected, rtol=0, atol=bound * np.abs(expected).max())
        expected = np.linalg.inv(M)
        np.testing.assert_allclose(inverse, expected, rtol=0, atol=bound * np.abs(expected).max())


def test_a_singular_matrix_gives_no_finite_number():
    a, A = symbols("A", 3, 3)
    solved = ca.Function("solved", [a], [to_sx(solve(A, [1.0, 2.0, 3.0]))])
    for M in (np.zeros((3, 3)), np.ones((3, 3)), np.outer([1.0, 2.0, 4.0], [1.0, 1.0, 8.0])):
        assert not np.isfinite(np.array(solved(M.ravel()))).any()
        with pytest.raises(np.linalg.LinAlgError):
            solve(M, np.ones(3))


@pytest.mark.parametrize("norm", [0.0, 1e-8, 0.3, 1.0, 7.0, 60.0, 900.0, 4000.0])
@pytest.mark.parametrize("n", [1, 2, 4])
def test_exponentials_are_those_of_scipy(n, norm):
    a, A = symbols("A", n, n)
    traced = ca.Function("expm", [a], [to_sx(expm(A))])
    for M in RNG.normal(size=(20, n, n)):
        M -= np.eye(n) * (0.1 + max(0.0, np.linalg.eigvals(M).real.max()))  # of a stable system
        M *= norm / np.linalg.norm(M, 1)
        actual, expected = np.array(traced(M.ravel())).reshape(n, n), linalg.expm(M)
        # the condition of an exponential of a normal matrix is its norm; those at hand are not far from normal
        bound = 1e3 * n * EPS * max(norm, 1.0) * np.abs(expected).max()
        np.testing.assert_allclose(actual, expected, rtol=0, atol=bound)


def test_an_exponential_beyond_its_squarings_is_refused_and_derivatives_are_those_at_hand():
    a, A = symbols("A", 2, 2)
    assert np.isnan(np.array(ca.Function("expm", [a], [to_sx(expm(A))])([-5000.0, 0.0, 0.0, -1.0]))).all()
    with pytest.raises(UsageError, match=r"expm: expected a matrix of a norm up to 4096, got 5000\."):
        expm(np.diag([-5000.0, -1.0]))
    with pytest.raises(UsageError, match=r"expm: expected the shape \(n, n\), got \(2, 3\)"):
        expm(np.zeros((2, 3)))
    with pytest.raises(UsageError, match=r"solve: expected shapes .*, got \(2, 2\) and \(3,\)"):
        solve(np.eye(2), np.ones(3))
    # d(A^-1) = -A^-1 dA A^-1; of an exponential, its Frechet derivative.
    a, A = symbols("A", 3, 3)
    along = ca.SX.sym("along", 9)
    both = ca.vertcat(to_sx(inv(A)), to_sx(expm(A)))
    slope = ca.Function("slope", [a, along], [ca.jtimes(both, a, along)])
    for M, dM in zip(RNG.normal(size=(50, 3, 3)), RNG.normal(size=(50, 3, 3)), strict=True):
        of_inverse, of_exponential = np.array(slope(M.ravel(), dM.ravel())).reshape(2, 3, 3)
        inverse = np.linalg.inv(M)
        expected = -inverse @ dM @ inverse
        bound = 1e3 * EPS * np.linalg.cond(M) ** 2  # each of two inverses has the condition once
        np.testing.assert_allclose(of_inverse, expected, rtol=0, atol=bound * np.abs(expected).max())
        expected = linalg.expm_frechet(M, dM, compute_expm=False)
        # of norm 3 or so, as above
        np.testing.assert_allclose(of_exponential, expected, rtol=0, atol=1e4 * EPS * np.abs(expected).max())
