"""One step of Rodas4, an L-stable, stiffly accurate Rosenbrock method of order 4 with error estimate.

Hairer and Wanner, Solving Ordinary Differential Equations II, 2nd ed. 1996, section VI.4. The step is traced
like the equations, with its Jacobian, its elimination and its six stages, so that one call makes one step.
"""

from __future__ import annotations

from collections.abc import Callable

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
    f: Callable[[ca.SX, ca.SX], ca.SX],
    x: ca.SX,
    h: ca.SX,
    E: ca.SX,
    EJ: ca.SX,
    Ef_t: ca.SX,
    order: npt.NDArray[np.int_],
) -> tuple[ca.SX, ca.SX]:
    """Trace one step of the system ``x_dot = f(x, t)``.

    Parameters
    ----------
    f : right-hand side of state and time since the start of the step, both expressions
    x : (m, 1) state at the start of the step
    h : (1, 1) step [s]
    E, EJ : (m, m) an invertible matrix and its product with the Jacobian ``J = df/dx``. The stage
        equations are multiplied by E; where E holds a mass matrix, ``E J`` is cheaper than J and needs no
        inverse. With k more rows and columns, of algebraic equations and unknowns, the columns of E are 0 there.
    Ef_t : (m + k, 1) product of E with the partial derivative of f with respect to time
    order : elimination order of the m + k unknowns; it decides the fill-in, not the result

    Returns
    -------
    x_new : (m, 1) state at the end, local error O(h^5)
    error : (m, 1) difference to the embedded solution of order 3
    """
    zero = ca.SX(*x.shape)
    algebraic = ca.SX(EJ.shape[0] - x.shape[0], 1)
    W = from_sx(E / (h * GAMMA) - EJ).reshape(EJ.shape)
    LU = factorize(W[np.ix_(order, order)])
    filled = pattern(LU)

    u: list[ca.SX] = []
    x_i = x
    for a_i, c_i, alpha, gamma in zip(A, C, ALPHA, GAMMA_I, strict=True):
        x_i = x + sum((a * u_j for a, u_j in zip(a_i, u, strict=True)), start=zero)
        rhs = f(x_i, alpha * h) + sum((c * u_j for c, u_j in zip(c_i, u, strict=True)), start=zero) / h
        solution = np.empty(len(order), dtype=object)
        scaled = E @ ca.vertcat(rhs, algebraic)
        solution[order] = solve(LU, from_sx(scaled + gamma * h * Ef_t)[order], filled)
        u.append(to_sx(solution[: x.shape[0]]))
    # stiffly accurate: the last stage is the embedded solution of order 3, and its increment the error
    return x_i + u[5], u[5]
