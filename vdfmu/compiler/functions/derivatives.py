"""Derivatives of traced functions along directions, by automatic differentiation of the trace."""

from __future__ import annotations

from collections.abc import Callable
from itertools import accumulate
from typing import Any

import casadi as ca

DIRECTIONS = ("forward", "reverse")
"""Endings of the names of derivatives: Jacobian times direction, and direction times Jacobian."""


def derivative_names(function: ca.Function, ending: str) -> tuple[list[str], list[str]]:
    """Return the names of the arguments and of the results of a derivative."""
    forward = ending == "forward"
    prefix = "d" if forward else "bar"
    given, made = [function.name_in(), function.name_out()][:: 1 if forward else -1]
    return [*function.name_in(), *(f"{prefix}_{name}" for name in given)], [f"{prefix}_{name}" for name in made]


def derivative(function: ca.Function, ending: str, rounded: bool = False) -> ca.Function:
    """Return the product of the Jacobian of `function` with a direction, ``<name>_forward``, or ``<name>_reverse``.

    Forward takes the arguments of `function` and a direction ``d_<argument>`` for each, and returns ``d_<result>``,
    (J direction). Reverse takes the arguments and a direction ``bar_<result>`` for each result, and returns
    ``bar_<argument>``, (direction J). With `rounded`, what depends on an argument by rounding alone, as an encoder
    does, has the slope of the line that the rounding follows, instead of 0.
    """
    transposed = ending == "reverse"
    arguments = [ca.SX.sym(name, function.numel_in(name)) for name in function.name_in()]
    results = list(map(ca.vec, function.call(arguments)))
    given, made = (results, arguments) if transposed else (arguments, results)
    directions = [ca.SX.sym("direction", *v.shape) for v in given]
    result, argument, direction = ca.vertcat(*results), ca.vertcat(*arguments), ca.vertcat(*directions)
    product = ca.jtimes(result, argument, direction, transposed)
    if rounded and has_roundings(function):
        lines = _slopes_of_rounding(function, result, argument, arguments)
        product += (lines.T if transposed else lines) @ direction
    offsets = [0, *accumulate(v.numel() for v in made)]
    return ca.Function(
        f"{function.name()}_{ending}",
        [*arguments, *directions],
        ca.vertsplit(ca.densify(product), offsets),  # cse would take nine tenths of the time to save 1 % of operations
        *derivative_names(function, ending),
    )


def has_roundings(function: ca.Function) -> bool:
    """Whether a function rounds and calls no other."""
    operations = {function.instruction_id(k) for k in range(function.n_instructions())}
    return bool(operations & _ROUNDING.keys()) and ca.OP_CALL not in operations


_ROUNDING = {ca.OP_FLOOR: -0.5, ca.OP_CEIL: 0.5}
"""Operation to how far it is from its argument in the mean."""


def _slopes_of_rounding(function: ca.Function, result: ca.SX, argument: ca.SX, arguments: list[ca.SX]) -> ca.SX:
    """Return those elements of a Jacobian that are 0 except for the lines that roundings follow."""
    lines = rebuilt(
        function, arguments, lambda operation, read: read[0] + _ROUNDING[operation] if operation in _ROUNDING else None
    )
    exact, followed = (ca.sparsify(ca.jacobian(each, argument)) for each in (result, ca.vertcat(*map(ca.vec, lines))))
    known = set(zip(*exact.sparsity().get_triplet(), strict=True))
    new = [place for place in zip(*followed.sparsity().get_triplet(), strict=True) if place not in known]
    found = ca.SX(*exact.shape)
    for row, column in new:
        found[row, column] = followed[row, column]
    return found


def rebuilt(
    function: ca.Function, arguments: list[ca.SX], replace: Callable[[int, list[ca.SX]], ca.SX | None]
) -> list[ca.SX]:
    """Return the results of a function of SX, without calls, as expressions of `arguments`.

    `replace` gets each operation and what it reads, and returns what takes its place, or None.
    """
    work: list[Any] = [0.0] * function.sz_w()
    results = [ca.SX(function.size_out(i)[0], 1) for i in range(function.n_out())]
    for k in range(function.n_instructions()):
        operation, read = function.instruction_id(k), function.instruction_input(k)
        place = function.instruction_output(k)
        if operation == ca.OP_CONST:
            work[place[0]] = ca.SX(function.instruction_constant(k))
        elif operation == ca.OP_INPUT:
            work[place[0]] = arguments[read[0]][read[1]]
        elif operation == ca.OP_OUTPUT:
            results[place[0]][place[1]] = work[read[0]]
        else:
            operands = [work[i] for i in read]
            made = replace(operation, operands)
            apply = ca.SX.unary if len(read) == 1 else ca.SX.binary
            work[place[0]] = apply(operation, *operands) if made is None else made
    return results
