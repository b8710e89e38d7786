"""Derivatives of traced functions along directions, and the time until they switch, both from the trace."""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate

import casadi as ca
import numpy as np
import numpy.typing as npt

from vdfmu.compiler.functions.operations import Operations, instructions
from vdfmu.compiler.scalar.symbol import LOOKUP, MATRIX

DIRECTIONS = ("forward", "reverse")
"""Suffixes of the names of derivatives: Jacobian times direction, and direction times Jacobian."""


def derivative_names(function: ca.Function, ending: str) -> tuple[list[str], list[str]]:
    """Return the names of the arguments and of the results of a derivative."""
    prefix, seeds, made = "d", function.name_in(), function.name_out()
    if ending == "reverse":
        prefix, seeds, made = "bar", made, seeds
    return [*function.name_in(), *(f"{prefix}_{name}" for name in seeds)], [f"{prefix}_{name}" for name in made]


def derivative(function: ca.Function, ending: str, rounded: bool = False) -> ca.Function:
    """Return the product of the Jacobian of `function` with a direction, ``<name>_forward``, or ``<name>_reverse``.

    Forward takes the arguments of `function` and a direction ``d_<argument>`` for each, and returns ``d_<result>``, (J
    direction). Reverse takes the arguments and a direction ``bar_<result>`` for each result, and returns
    ``bar_<argument>``, (direction J). With `rounded`, a result that depends on an argument only through rounding, as in
    an encoder, has the slope of the line that the rounding follows, instead of 0.
    """
    transposed = ending == "reverse"
    if not function.is_a("SXFunction"):
        return _of_calls(function, ending)
    arguments = [ca.SX.sym(name, function.numel_in(name)) for name in function.name_in()]
    results = list(map(ca.vec, function.call(arguments)))
    seeds, made = (results, arguments) if transposed else (arguments, results)
    directions = [ca.SX.sym("direction", *v.shape) for v in seeds]
    result, argument, direction = ca.vertcat(*results), ca.vertcat(*arguments), ca.vertcat(*directions)
    product = ca.jtimes(result, argument, direction, transposed)
    if rounded and has_roundings(function):
        lines = _slopes_of_rounding(function, result, argument, arguments)
        product += (lines.T if transposed else lines) @ direction
    offsets = [0, *accumulate(v.numel() for v in made)]
    return ca.Function(
        f"{function.name()}_{ending}",
        [*arguments, *directions],
        ca.vertsplit(ca.densify(product), offsets),  # cse would take 90 % of the time to save 1 % of the operations
        *derivative_names(function, ending),
    )


def _of_calls(function: ca.Function, ending: str) -> ca.Function:
    """Return a derivative of a function of vectors; it calls derivatives of the called functions."""
    arguments = [ca.MX.sym(name, function.numel_in(name)) for name in function.name_in()]
    results = [ca.MX(size, 1) for size in map(function.numel_out, range(function.n_out()))]  # no derivative needs them
    seeds = map(function.numel_out if ending == "reverse" else function.numel_in, range(
        function.n_out() if ending == "reverse" else function.n_in()
    ))  # fmt: skip
    directions = [ca.MX.sym("direction", size) for size in seeds]
    made = getattr(function, ending)(1).call([*arguments, *results, *directions], True)
    names = derivative_names(function, ending)
    return ca.Function(f"{function.name()}_{ending}", [*arguments, *directions], list(map(ca.densify, made)), *names)


def has_roundings(function: ca.Function) -> bool:
    """Return whether a function rounds and calls no other."""
    operations = {function.instruction_id(k) for k in range(function.n_instructions())}
    return bool(operations & _ROUNDING.keys()) and ca.OP_CALL not in operations


_ROUNDING = {ca.OP_FLOOR: -0.5, ca.OP_CEIL: 0.5}
"""Operation to its mean difference from the argument."""


def _slopes_of_rounding(function: ca.Function, result: ca.SX, argument: ca.SX, arguments: list[ca.SX]) -> ca.SX:
    """Return the elements of a Jacobian that would be 0 without the lines that roundings follow."""
    lines = rebuilt(
        function, arguments, lambda operation, read: read[0] + _ROUNDING[operation] if operation in _ROUNDING else None
    )
    exact, followed = (ca.sparsify(ca.jacobian(each, argument)) for each in (result, ca.vertcat(*map(ca.vec, lines))))
    places = [set(zip(*each.sparsity().get_triplet(), strict=True)) for each in (exact, followed)]
    slopes = ca.SX(*exact.shape)
    for row, column in places[1] - places[0]:
        slopes[row, column] = followed[row, column]
    return slopes


def lookup_table(function: ca.Function) -> tuple[list[float], list[float]]:
    """Return the edges of a table, and its rows concatenated."""
    constants = [k for k, operation, *_ in instructions(function) if operation == ca.OP_CONST]
    edges, rows = (function.instruction_MX(k).to_DM().nonzeros() for k in constants)
    return edges, rows


def matrix_of(function: ca.Function) -> tuple[str, bool] | None:
    """Return the name of a product's matrix and whether the product is transposed; None for other functions.

    The product may be the derivative of another; then its arguments come before the direction.
    """
    direction, name, digest = function.name().rpartition(MATRIX)
    return (name + digest, direction == "adj1_") if name and direction in ("", "fwd1_", "adj1_") else None


def matrix_numbers(function: ca.Function) -> npt.NDArray[np.float64]:
    """Return the matrix (m, n) of an untransposed product."""
    inputs = [ca.DM(*function.size_in(i)) for i in range(function.n_in())]
    inputs[-1] = ca.DM.eye(function.numel_in(function.n_in() - 1))
    return function.call(inputs)[0].full()


def rebuilt(
    function: ca.Function, arguments: list[ca.SX], replace: Callable[[int, list[ca.SX]], ca.SX | None]
) -> list[ca.SX]:
    """Return the results of an SX function without calls as expressions of `arguments`.

    `replace` is called with each operation and its operands, and returns a replacement or None.
    """
    operations = Operations(function)

    def replaced(k: int, operands: list[ca.SX]) -> ca.SX | None:
        return replace(operations.listed[k].code, operands) if operands else None

    values = operations.values(arguments, replaced)
    return [ca.vertcat(ca.SX(0, 1), *(values[k] for k in elements)) for elements in operations.results]


NEVER = 1e300
"""Time [s] until the next switch if there is none."""
_JUMPS = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE)
_BENDS = (ca.OP_FMIN, ca.OP_FMAX)
_SIGNS = {ca.OP_SIGN: 0, ca.OP_FABS: 0, ca.OP_COPYSIGN: 1}
"""Operation to the position of the operand whose zero switches it."""
_WHOLE = (ca.OP_FLOOR, ca.OP_CEIL, ca.OP_FMOD)


def time_left(function: ca.Function, inputs: dict[str, ca.SX], changing: dict[str, ca.SX]) -> ca.SX | None:
    """Return the time [s] until a choice on the time ``t`` changes, or None without such a choice.

    `inputs` are the arguments of an SX function, `changing` their time derivatives; other arguments are constant. The
    time is exact for conditions that are linear in time; otherwise tangents are followed. ValueError for a jump at a
    condition that is not linear in time, or if a table is read.
    """
    t = inputs["t"]
    operations = {function.instruction_id(k) for k in range(function.n_instructions())}
    if not operations & {*_JUMPS, *_BENDS, *_SIGNS, *_WHOLE, ca.OP_CALL}:
        return None
    if ca.OP_CALL in operations:
        tables = any(callee.name().startswith(LOOKUP) for callee in function.find_functions(0))
        call = "reads a table by lookup" if tables else "multiplies by a large matrix"
        raise ValueError(f"it depends on the time and {call}, so its switching times are unknown")
    levels: list[tuple[ca.SX, bool]] = []

    def choice(operation: int, read: list[ca.SX]) -> None:
        if operation in (*_JUMPS, *_BENDS):
            level = read[0] - read[1]
        elif operation in _SIGNS:
            level = read[_SIGNS[operation]]
        elif operation in _WHOLE:
            level = read[0] / read[1] if operation == ca.OP_FMOD else read[0]
        else:
            return
        if not ca.depends_on(level, t):
            return
        curve = ca.sparsify(ca.jacobian(ca.jacobian(level, t), t))
        if curve.nnz() == 0:
            levels.append((level, operation in _WHOLE))
        elif operation not in (*_BENDS, ca.OP_FABS):
            raise ValueError("a condition is not linear in time, so its switching times are unknown")

    rebuilt(function, list(inputs.values()), choice)
    if not levels:
        return None
    moving = {"t": ca.SX(1.0), **changing}
    level_column = ca.vertcat(*[level for level, _ in levels])
    rates = ca.jtimes(level_column, ca.vertcat(*[inputs[key] for key in moving]), ca.vertcat(*moving.values()))
    left = ca.SX(NEVER)
    for (level, whole), rate in zip(levels, ca.vertsplit(rates), strict=True):
        if whole:
            up, down = (ca.floor(level) + 1.0 - level) / rate, (ca.ceil(level) - 1.0 - level) / rate
            time = ca.if_else(rate > 0.0, up, ca.if_else(rate < 0.0, down, NEVER))
        else:
            time = ca.if_else(level * rate < 0.0, -level / rate, NEVER)
        left = ca.fmin(left, time)
    return left
