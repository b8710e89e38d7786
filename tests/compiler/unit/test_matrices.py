"""Systems, inverses and exponentials of matrices in units: symbols against numpy and scipy, with exchanges of rows."""

import casadi as ca
import fmpy
import numpy as np
import pytest
from scipy import linalg

from vdfmu.arm.fmus import build_fmus
from vdfmu.base.errors import UsageError
from vdfmu.compiler.scalar.matrices import expm, inv, solve
from vdfmu.compiler.scalar.symbol import SymbolArray, from_sx, to_sx
from vdfmu.unit import Derivative, Input, Output, Parameter, State, Unit

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


class Solves(Unit):
    """A system, an inverse, and the exact discretization of an oscillator."""

    u = Input("1", 3)
    A = Parameter("1", (3, 3), start=[[0.0, 2.0, 1.0], [1.0, 0.0, 0.5], [0.1, 0.2, 4.0]])
    T = Parameter("s", start=0.1, minimum=1e-6, tunable=True)
    y = Output("1", 3)
    z = Output("1", 3)
    F = Output("1", (2, 2))
    x = State("1", 3)
    x_dot = Derivative(x)

    def outputs(self) -> None:
        self.y = np.linalg.solve(self.A, self.u)
        self.z = inv(self.A) @ self.u
        self.F = expm(np.array([[0.0, 1.0], [-1.0, -0.2]]) * self.T)

    def derivatives(self) -> None:
        a, b, c = self.u
        self.x_dot = solve([[a * 0.0, 1.0, b], [2.0, a, 0.0], [0.0, c, 1.0]], -self.x)


@pytest.mark.heavy
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_native_fmu_solves(tmp_path, version):
    (path,) = build_fmus(None, tmp_path, units=[Solves], backend="native", fmi_version=version).values()
    signals = np.array([(0.0, 1.0, -2.0, 0.5)], dtype=[("time", float), *((f"u[{i}]", float) for i in (1, 2, 3))])
    rows = fmpy.simulate_fmu(
        str(path), stop_time=0.1, output_interval=0.1, start_values={"x_0[1]": 1.0, "T": 2.0} if version == "2.0" else
        {"x_0": [1.0, 0.0, 0.0], "T": 2.0}, input=signals if version == "2.0" else None,
    )  # fmt: skip
    if version == "3.0":
        assert rows["F"][-1] == pytest.approx(linalg.expm(np.array([[0.0, 1.0], [-1.0, -0.2]]) * 2.0), abs=1e-14)
        return
    last = {name: rows[name][-1] for name in rows.dtype.names}
    u, start = [1.0, -2.0, 0.5], np.array(Solves.A.start)
    # 27 products of numbers around 1, well conditioned
    assert [last[f"y[{i}]"] for i in (1, 2, 3)] == pytest.approx(np.linalg.solve(start, u), abs=1e-14)
    assert [last[f"z[{i}]"] for i in (1, 2, 3)] == pytest.approx(np.linalg.solve(start, u), abs=1e-14)
    M = np.array([[0.0, 1.0, -2.0], [2.0, 1.0, 0.0], [0.0, 0.5, 1.0]])
    moved = linalg.expm(-np.linalg.inv(M) * 0.1) @ [1.0, 0.0, 0.0]
    # the solver's tolerance is 1e-7
    assert [last[f"x[{i}]"] for i in (1, 2, 3)] == pytest.approx(moved, abs=1e-6)
