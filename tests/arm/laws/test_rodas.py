"""The solver's step on linear problems: its stability function, A- and L-stability, order of both methods."""

import casadi as ca
import numpy as np
import pytest

from vdfmu.compiler.functions.rodas import ALPHA, GAMMA, GAMMA_I, A, C, rodas_step, stage_equations

EPS = np.finfo(float).eps
STAGES = len(A)


def tableau(rows):
    matrix = np.zeros((STAGES, STAGES))
    for i, row in enumerate(rows):
        matrix[i, : len(row)] = row
    return matrix


def stability(z):
    """Return R(z) of the method and of its embedded one, straight from the coefficients."""
    # On x_dot = lambda x, with z = h lambda, the stages are (1/gamma - z) u_i = z (x + sum a_ij u_j) + sum c_ij u_j.
    ones = np.ones(STAGES)
    W = (1.0 / GAMMA - z) * np.eye(STAGES) - z * tableau(A) - tableau(C)
    u = np.linalg.solve(W, z * ones)
    embedded = 1.0 + tableau(A)[-1] @ u
    return embedded + u[-1], embedded


def step_of(matrix):
    """Return a CasADi function of state and step size: one step of A x - x_dot = 0."""
    m = len(matrix)
    x, h, A = ca.SX.sym("x", m), ca.SX.sym("h"), ca.SX(ca.DM(matrix))
    stages = stage_equations(h, ca.SX.eye(m), A, ca.SX(m, 1), np.arange(m), m)

    def residual(state, t, y=None):
        value = A @ state
        return value if y is None else value - y

    step = rodas_step(residual, x, A @ x, h, stages.factors, stages)
    return ca.Function("step", [x, h], [*step])


@pytest.mark.parametrize("z", [-1e9, -1e3, -30.0, -1.0, -1e-3, 0.3, 1.0])
def test_step_on_a_linear_problem_equals_the_stability_function(z):
    x_new, error = step_of([[z]])(1.0, 1.0)
    R, embedded = stability(z)
    # Six stages with coefficients up to 34, whose products cancel: 1e4 roundings.
    assert float(x_new) == pytest.approx(R, abs=1e4 * EPS)
    assert float(error) == pytest.approx(R - embedded, abs=1e4 * EPS)


def test_step_is_L_stable_of_order_four_and_the_embedded_one_three():
    # R(inf) = 0: R(z) = O(1/z), so it falls with z until rounding (1e-12) takes over.
    assert abs(stability(-1e4)[0]) < 1e-3
    assert abs(stability(-1e12)[0]) < 1e-11
    assert abs(stability(1e12j)[0]) < 1e-11
    assert abs(stability(-1e12)[1]) < 1e-11  # the embedded method too
    # A-stable: |R| <= 1 on the imaginary axis, so in the left half plane, as its poles are at 1/gamma only.
    for y in np.logspace(-2, 4, 400):
        assert abs(stability(1j * y)[0]) <= 1.0 + 1e4 * EPS
    # |R(z) - exp(z)| = O(z^5) and O(z^4). z = 1/8 and 1/16: the next term is smaller by z, so the measured
    # exponent is off by about z / ln 2 * (a ratio of order 1) = 0.1; rounding, 1e-12, is below 1e-4 of the
    # error.
    for k, order in ((0, 4), (1, 3)):
        errors = [abs(stability(z)[k] - np.exp(z)) for z in (-1 / 8, -1 / 16)]
        assert np.log2(errors[0] / errors[1]) == pytest.approx(order + 1, abs=0.3)


@pytest.mark.parametrize("embedded", [False, True])
def test_coefficients_meet_the_order_conditions(embedded):
    # Hairer and Wanner II, table IV.7.1, back in the untransformed coefficients: Gamma = (1/gamma - C)^-1,
    # alpha = A Gamma, b = m Gamma, beta = alpha + Gamma. The coefficients are printed with 16 digits;
    # products with entries up to 34.
    Gamma = np.linalg.inv(np.eye(STAGES) / GAMMA - tableau(C))
    alpha, m = tableau(A) @ Gamma, tableau(A)[-1] + (0.0 if embedded else np.eye(STAGES)[-1])
    b, beta = m @ Gamma, alpha + Gamma
    a_i, beta_i = alpha.sum(axis=1), beta.sum(axis=1)
    atol = 1e-12
    # the alpha_i are those of the book's table 6.1
    np.testing.assert_allclose(a_i, [0.0, 0.386, 0.21, 0.63, 1.0, 1.0], rtol=0, atol=atol)
    # those of problems that depend on time are row sums too, printed with 15 digits
    np.testing.assert_allclose([a_i, Gamma.sum(axis=1)], [ALPHA, GAMMA_I], rtol=0, atol=1e-13)
    third = [b.sum() - 1, b @ beta_i - 1 / 2, b @ a_i**2 - 1 / 3, b @ beta @ beta_i - 1 / 6]
    np.testing.assert_allclose(third, 0.0, rtol=0, atol=atol)
    fourth = [
        b @ a_i**3 - 1 / 4, (b * a_i) @ alpha @ beta_i - 1 / 8, b @ beta @ a_i**2 - 1 / 12,
        b @ beta @ beta @ beta_i - 1 / 24,
    ]  # fmt: skip
    if embedded:
        assert np.abs(fourth).max() > 1e-3  # of order 3 only, so that the difference estimates an error
    else:
        np.testing.assert_allclose(fourth, 0.0, rtol=0, atol=atol)
