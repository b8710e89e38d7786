"""One step of Rodas4, an L-stable, stiffly accurate Rosenbrock method of order 4 with error estimate.

Hairer and Wanner, Solving Ordinary Differential Equations II, 2nd ed. 1996, section VI.4. The step is traced
like the equations: its matrix with the elimination, and what a stage calculates once for all six.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from vdfmu.scalar.elimination import factorize, pattern, solve
from vdfmu.scalar.symbol import from_sx, to_sx

__all__ = ["ORDER", "rodas_step", "stage_equations"]

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


def stage_equations(
    h: ca.SX, E: ca.SX, EJ: ca.SX, Ef_t: ca.SX, order: npt.NDArray[np.int_], m: int, name: str = "rodas"
) -> tuple[ca.SX, ca.Function]:
    """Factorize the matrix of the stage equations, and trace their solution.

    Parameters
    ----------
    h : (1, 1) step [s]
    E, EJ : (m + k, m + k) an invertible matrix and its product with the Jacobian ``J = df/dx``. The stage
        equations are multiplied by E; where E holds a mass matrix, ``E J`` is cheaper than J and needs no
        inverse. With k rows and columns of algebraic equations and unknowns after the m states, the columns of E are 0
        there.
    Ef_t : (m + k, 1) product of E with the partial derivative of f with respect to time
    order : elimination order of the m + k unknowns; it decides the fill-in, not the result
    name : of the function, ``<name>_solve``

    Returns
    -------
    factors : (l, 1) elements of the factors, of E and of Ef_t that are not constant, each once
    solve : function of them, of the right-hand side (m, 1) of a stage and of the factor of Ef_t [s], to the increment
    """
    size = len(order)
    W = from_sx(E / (h * GAMMA) - EJ).reshape(size, size)
    factorized = factorize(W[np.ix_(order, order)])
    filled = pattern(factorized)
    columns, rows = np.nonzero(filled.T)
    factors, symbols, (kept, E, Ef_t) = _varying([to_sx(factorized[rows, columns]), E, Ef_t])
    LU = from_sx(ca.SX(ca.Sparsity.triplet(size, size, rows, columns), kept)).reshape(size, size)
    right, delay = ca.SX.sym("right", m), ca.SX.sym("delay")
    u = np.empty(size, dtype=object)
    u[order] = solve(LU, from_sx(E[:, :m] @ right + delay * Ef_t)[order], filled)
    arguments = {"factors": symbols, "right": right, "delay": delay}
    increment = ca.cse([to_sx(u[:m])])
    return factors, ca.Function(f"{name}_solve", list(arguments.values()), increment, list(arguments), ["u"])


def _varying(expressions: list[ca.SX]) -> tuple[ca.SX, ca.SX, list[ca.SX]]:
    """Return the different elements that are not constant, symbols for them, and the expressions of the symbols."""
    expressions = ca.cse(expressions)
    nonzeros: list[list[Any]] = [expression.nonzeros() for expression in expressions]
    elements: dict[int, Any] = {}
    for element in chain.from_iterable(nonzeros):
        if not element.is_constant():
            elements.setdefault(element.element_hash(), element)
    symbols = ca.SX.sym("factors", len(elements))
    places: dict[int, Any] = dict(zip(elements, symbols.nonzeros(), strict=True))
    replaced = [
        ca.SX(expression.sparsity(), ca.vertcat(*(places.get(one.element_hash(), one) for one in row)))
        for expression, row in zip(expressions, nonzeros, strict=True)
    ]
    return ca.vertcat(*elements.values()), symbols, replaced


def rodas_step(
    f: Callable[[Any, Any], Any], x: Any, h: Any, solve: Callable[[Any, Any], Any], name: str = "rodas"
) -> tuple[Any, Any]:
    """Take one step of the system ``x_dot = f(x, t)``.

    Of SX, the step is traced as a whole; of MX, it calls functions that are traced once: `f`, `solve` and those that
    form the arguments of the two, ``<name>_point_1``, ``<name>_right_1``, ..

    Parameters
    ----------
    f : right-hand side of state and time since the start of the step
    x : (m, 1) state at the start of the step
    h : (1, 1) step [s]
    solve : as of :func:`stage_equations`, with its first argument given

    Returns
    -------
    x_new : (m, 1) state at the end, local error O(h^5)
    error : (m, 1) difference to the embedded solution of order 3
    """
    m = x.numel()
    start, rate, size = ca.SX.sym("x", m), ca.SX.sym("x_dot", m), ca.SX.sym("h")
    given: list[ca.SX] = []  # increments before the stage
    u: list[Any] = []
    x_i = x
    for k, (a_i, c_i, alpha, gamma) in enumerate(zip(A, C, ALPHA, GAMMA_I, strict=True), 1):
        at = start + sum((a * u_j for a, u_j in zip(a_i, given, strict=True)), start=ca.SX(m, 1))
        right = rate + sum((c * u_j for c, u_j in zip(c_i, given, strict=True)), start=ca.SX(m, 1)) / size
        x_i, time = ca.Function(f"{name}_point_{k}", [start, size, *given], [at, alpha * size])(x, h, *u)
        equation = ca.Function(f"{name}_right_{k}", [rate, size, *given], [right, gamma * size])
        u.append(solve(*equation(f(x_i, time), h, *u)))
        given.append(ca.SX.sym(f"u_{k}", m))
    # stiffly accurate: the last stage is the embedded solution of order 3, and its increment the error
    return ca.Function(f"{name}_end", [start, rate], [start + rate])(x_i, u[5]), u[5]
