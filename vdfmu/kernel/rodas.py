"""One step of Rodas4, an L-stable, stiffly accurate Rosenbrock method of order 4 with error estimate.

Hairer and Wanner, Solving Ordinary Differential Equations II, 2nd ed. 1996, section VI.4. The step is traced
like the equations, with its Jacobian, its elimination and its six stages, so that one call makes one step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np
import numpy.typing as npt

from vdfmu.scalar.elimination import factorize, pattern, solve
from vdfmu.scalar.symbol import from_sx, to_sx

__all__ = ["ORDER", "rodas_step"]

ORDER = 4
GAMMA = 0.25
# Coefficients in the transformed variables u_i of the book: a_ij of the stage values, c_ij of the stage
# equations, alpha_i of the stage times, gamma_i of the time derivative.
A = (
    (),
    (1.544,),
    (0.9466785280815826, 0.2557011698983284),
    (3.314825187068521, 2.896124015972201, 0.9986419139977817),
    (1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950),
    (1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 1.0),
)
ALPHA = (0.0, 0.386, 0.21, 0.63, 1.0, 1.0)
GAMMA_I = (0.25, -0.1043, 0.1035, -0.03620000000000023, 0.0, 0.0)
C = (
    (),
    (-5.6688,),
    (-2.430093356833875, -0.2063599157091915),
    (-0.1073529058151375, -9.594562251023355, -20.47028614809616),
    (7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160),
    (8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054),
)


def rodas_step(
    balance: Callable[[ca.SX, ca.SX, ca.SX], ca.SX],
    x: ca.SX,
    x_dot: ca.SX,
    h: ca.SX,
    E: ca.SX,
    EJ: ca.SX,
    Ef_t: ca.SX,
    order: npt.NDArray[np.int_],
) -> tuple[ca.SX, ca.SX]:
    """Trace one step of the system ``balance(x, x_dot, t) = 0``, such as ``f(x, t) - x_dot``.

    x_dot is carried along as the algebraic unknown of ``x_dot = y, 0 = balance(x, y, t)``, for which Rodas4 was made.
    So no stage solves the balance for x_dot. On ``f(x, t) - x_dot`` the step is that of the method for ordinary
    differential equations.

    Parameters
    ----------
    balance : residual (m, 1) of state, its derivative and time since the start of the step, all expressions
    x, x_dot : (m, 1) state at the start of the step and its derivative there, which balances
    h : (1, 1) step [s]
    E, EJ : (m, m) derivative of the balance with respect to x_dot, times -1, and with respect to x, at the start. E is
        invertible; where it holds a mass matrix, the step needs no inverse of it. With k more rows and columns, of
        algebraic equations and unknowns, the columns of E are 0 there.
    Ef_t : (m + k, 1) partial derivative of the balance with respect to time
    order : elimination order of the m + k unknowns; it decides the fill-in, not the result

    Returns
    -------
    x_new : (m, 1) state at the end, local error O(h^5)
    error : (m, 1) difference to the embedded solution of order 3
    """
    m = x.shape[0]
    algebraic = ca.SX(EJ.shape[0] - m, 1)
    W = from_sx(E / (h * GAMMA) - EJ).reshape(EJ.shape)
    LU = factorize(W[np.ix_(order, order)])
    filled = pattern(LU)
    explicit = _explicit_rows(E[:m, :m])

    u: list[ca.SX] = []
    w: list[ca.SX] = []  # increments of y, as u are those of x
    x_i, y_i = x, x_dot
    for a_i, c_i, alpha, gamma in zip(A, C, ALPHA, GAMMA_I, strict=True):
        before = _combined(c_i, u, m) / h
        residual = ca.SX(m, 1)
        if a_i:
            x_i, y_i = x + _combined(a_i, u, m), x_dot + _combined(a_i, w, m)
            residual = balance(x_i, y_i, alpha * h)
        y_explicit = explicit * y_i  # first, so that y_i cancels
        known = ca.vertcat(residual + y_explicit + explicit * before, algebraic)
        rest = E - ca.diag(ca.vertcat(explicit, algebraic))
        rhs = known + ca.sparsify(rest) @ ca.vertcat(y_i + before, algebraic) + gamma * h * Ef_t
        solution = np.empty(len(order), dtype=object)
        solution[order] = solve(LU, from_sx(rhs)[order], filled)
        u.append(to_sx(solution[:m]))
        w.append(u[-1] / (h * GAMMA) - (y_i + before))
    # stiffly accurate: the last stage is the embedded solution of order 3, and its increment the error
    return x_i + u[5], u[5]


def _combined(coefficients: Sequence[float], vectors: Sequence[ca.SX], m: int) -> ca.SX:
    return sum((c * v for c, v in zip(coefficients, vectors, strict=True)), start=ca.SX(m, 1))


def _explicit_rows(E: ca.SX) -> ca.SX:
    """1 for each row of E that is a row of the identity, else 0: (m, 1)."""
    rows = [E[i, :].nnz() == 1 and E[i, i].is_one() for i in range(E.shape[0])]
    return ca.sparsify(ca.SX(ca.DM(rows)))
