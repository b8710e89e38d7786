"""One step of Rodas4, an L-stable, stiffly accurate Rosenbrock method of order 4 with error estimate.

Hairer and Wanner, Solving Ordinary Differential Equations II, 2nd ed. 1996, sections VI.3 and VI.4. The step is traced
like the equations. The elimination of its matrix is traced once, and so is the function that all six stages call.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import numpy.typing as npt

from vdfmu.compiler.scalar.matrices import Rows, factorize, solve_factorized, sparse
from vdfmu.compiler.scalar.symbol import Symbol, from_sx, to_sx

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


class Stages(NamedTuple):
    """The equations of the stages of ``R(x, y, t) = 0`` with ``y = x_dot``, factorized."""

    factors: Any
    """Distinct non-constant elements (l, 1) of the factors, of E and of R_t."""
    solve: ca.Function
    """Increment of a stage as a function of `factors`, `right` (m, 1), `slope`, which are the derivatives of the
    carried rows, and `delay` [s]. The right-hand side of the stage is ``right + (E - explicit) slope + delay R_t``."""
    explicit: ca.DM
    """(m, 1): 1 for rows ``f(x, t) - y`` that need no y, else 0."""
    carried: list[int]
    """Rows whose y is carried from stage to stage; an explicit right-hand side has none."""


def stage_equations(
    h: ca.SX, E: ca.SX, J: ca.SX, R_t: ca.SX, order: npt.NDArray[np.int_], m: int, name: str = "rodas"
) -> Stages:
    """Factorize the matrix of the stage equations, and trace their solution.

    Parameters ---------- h : (1, 1) step [s] E, J : (m + k, m + k) ``-dR/dy`` and ``dR/dx`` at the start. E is
    invertible, but its inverse, which would contain that of a mass matrix, is not computed. If k algebraic equations
    and unknowns follow the m states, their columns
        of E are 0.
    R_t : (m + k, 1) partial derivative of R with respect to time
    order : elimination order of the m + k unknowns. It affects the fill-in, not the result.
    name : prefix of the function, ``<name>_solve``
    """
    size = len(order)
    factorized = factorize(permuted(E / (h * GAMMA) - J, order))
    in_row = np.bincount(E.sparsity().row(), minlength=size)
    explicit = ca.DM([in_row[i] == 1 and E[i, i].is_one() for i in range(m)])
    rest = ca.sparsify(E[:, :m] - ca.vertcat(ca.diag(ca.SX(explicit)), ca.SX(size - m, m)))
    carried = np.flatnonzero(np.diff(rest.sparsity().colind())).tolist()
    columns, rows = zip(*sorted((j, i) for i, row in enumerate(factorized) for j in row), strict=True)
    elements = to_sx([factorized[i][j] for i, j in zip(rows, columns, strict=True)])
    factors, symbols, (kept, rest, R_t) = varying([elements, rest[:, carried], R_t])
    LU = sparse(size, zip(rows, columns, map(Symbol, kept.nonzeros()), strict=True))
    right, slope, delay = ca.SX.sym("right", m), ca.SX.sym("slope", len(carried)), ca.SX.sym("delay")
    u = np.empty(size, dtype=object)
    right_side = ca.vertcat(right, ca.SX(size - m, 1)) + rest @ slope + delay * R_t
    u[order] = solve_factorized(LU, from_sx(right_side)[order])
    arguments = {"factors": symbols, "right": right} | ({"slope": slope} if carried else {}) | {"delay": delay}
    increment = ca.cse([to_sx(u[:m])])
    function = ca.Function(f"{name}_solve", list(arguments.values()), increment, list(arguments), ["u"])
    return Stages(factors, function, explicit, carried)


def permuted(matrix: ca.SX, order: npt.NDArray[np.int_]) -> Rows:
    """Return a square matrix with rows and columns reordered."""
    place = np.argsort(order)
    rows, columns = matrix.sparsity().get_triplet()
    return sparse(len(order), zip(place[rows], place[columns], map(Symbol, matrix.nonzeros()), strict=True))


def varying(expressions: list[ca.SX]) -> tuple[ca.SX, ca.SX, list[ca.SX]]:
    """Return the distinct elements that are not constant, symbols for them, and the expressions of the symbols."""
    expressions = ca.cse(expressions)
    nonzeros: list[list[Any]] = [expression.nonzeros() for expression in expressions]
    elements: dict[int, Any] = {}
    for element in chain.from_iterable(nonzeros):
        if not element.is_constant():
            elements.setdefault(element.element_hash(), element)
    symbols = ca.SX.sym("factors", len(elements))
    places: dict[int, Any] = dict(zip(elements, symbols.nonzeros(), strict=True))
    replaced = [
        ca.SX(expression.sparsity(), ca.vertcat(*(places.get(x.element_hash(), x) for x in row)))
        for expression, row in zip(expressions, nonzeros, strict=True)
    ]
    return ca.vertcat(*elements.values()), symbols, replaced


def rodas_step(
    f: Callable[..., Any], x: Any, x_dot: Any, h: Any, factors: Any, stages: Stages, name: str = "rodas"
) -> tuple[Any, Any]:
    """Take one step of the system ``R(x, x_dot, t) = 0``.

    x_dot is carried along as the algebraic unknown of ``x_dot = y, 0 = R(x, y, t)``. Rodas4 is designed for such
    systems, so no stage solves R for x_dot. Rows of the form ``f(x, t) - y`` are stepped as ordinary differential
    equations, because their y is eliminated.

    In SX the step is traced as a whole. In MX it calls functions that are traced once: `f`, the function in `stages`,
    and functions that form the arguments of both, ``<name>_point_2``, ``<name>_right_1``, ..

    Parameters
    ----------
    f : function of the state, the time since the start of the step and, if y is carried, its rows
        Returns R (m, 1), with f in explicit rows.
    x, x_dot : (m, 1) state at the start of the step, and its derivative there
    h : (1, 1) step [s]
    factors, stages : see :func:`stage_equations`. The factors may also be numbers.

    Returns
    -------
    x_new : (m, 1) state at the end, local error O(h^5)
    error : (m, 1) difference to the embedded solution of order 3
    """
    m, l = x.numel(), len(stages.carried)
    vectors = StepVectors(name, stages)
    start, rate, size = vectors.symbol("x", m), vectors.symbol("x_dot", m), vectors.symbol("h")
    begin, point = vectors.symbol("y_0", l), vectors.symbol("y", l)
    before: list[Any] = []  # symbols of the increments u of x
    rises: list[Any] = []  # symbols of the increments w of carried y
    u: list[Any] = []
    w: list[Any] = []
    explicit = vectors.kind(stages.explicit)
    value: Any = vectors.made("begin", [rate], [explicit * rate])(x_dot)
    y_0: Any = vectors.made("carried", [rate], [rate[stages.carried]])(x_dot) if l else None
    x_i, y_i = x, y_0
    for k, (a_i, c_i, alpha, gamma) in enumerate(zip(A, C, ALPHA, GAMMA_I, strict=True), 1):
        if k > 1:
            at = start + _combined(a_i, before, m)
            x_i, time = vectors.made(f"point_{k}", [start, size, *before], [at, alpha * size])(x, h, *u)
            if l:
                moved = begin + _combined(a_i, rises, l)
                y_i = vectors.made(f"slope_{k}", [begin, *rises], [moved])(y_0, *w)
            value = f(x_i, time, y_i) if l else f(x_i, time)
        past = _combined(c_i, before, m) / size
        right = [rate + explicit * past, gamma * size]
        right_i, delay = vectors.made(f"right_{k}", [rate, size, *before], right)(value, h, *u)
        if l:
            slope = vectors.made(f"along_{k}", [point, size, *before], [point + past[stages.carried]])
            slope_i = slope(y_i, h, *u)
            u.append(stages.solve(factors, right_i, slope_i, delay))
            rise = vectors.made("rise", [start, point, size], [start[stages.carried] / (size * GAMMA) - point])
            w.append(rise(u[-1], slope_i, h))
            rises.append(vectors.symbol(f"w_{k}", l))
        else:
            u.append(stages.solve(factors, right_i, delay))
        before.append(vectors.symbol(f"u_{k}", m))
    # stiffly accurate: the last stage is the embedded solution of order 3, and its increment the error
    return vectors.made("end", [start, rate], [start + rate])(x_i, u[5]), u[5]


class StepVectors:
    """Functions of the vectors of a step, traced element by element or, for a chain, with loops over the elements."""

    def __init__(self, name: str, stages: Stages) -> None:
        self._name, self._in_loops = name, not stages.solve.is_a("SXFunction")
        self.kind: Any = ca.MX if self._in_loops else ca.SX

    def symbol(self, name: str, size: int = 1) -> Any:
        """Return a vector of symbols."""
        return self.kind.sym(name, size)

    def made(self, name: str, symbols: Sequence[Any], results: Sequence[Any]) -> Callable[..., Any]:
        """Return the function of symbols with these results."""
        function = ca.Function(f"{self._name}_{name}", symbols, results)
        if not self._in_loops:
            return function

        def inlined(*arguments: Any) -> Any:
            made = function.call(list(arguments), True)
            return made[0] if len(made) == 1 else made

        return inlined


def _combined(coefficients: Sequence[float], vectors: Sequence[Any], m: int) -> Any:
    terms = [c * v for c, v in zip(coefficients, vectors, strict=True)]
    return sum(terms[1:], start=terms[0]) if terms else ca.DM.zeros(m)
