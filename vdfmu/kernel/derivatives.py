"""Derivatives of traced functions along directions, by automatic differentiation of the trace."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

__all__ = ["DIRECTIONS", "forward", "reverse"]


def forward(function: ca.Function) -> ca.Function:
    """Return the product of the Jacobian of `function` with a direction, ``<name>_forward``.

    Its arguments are those of `function` and a direction ``d_<argument>`` for each; its results are
    ``d_<result>``, (J direction).
    """
    arguments, results = _symbols(function)
    directions = {f"d_{name}": ca.SX.sym(name, *a.shape) for name, a in arguments.items()}
    tangent = ca.jtimes(
        ca.vertcat(*results.values()), ca.vertcat(*arguments.values()), ca.vertcat(*directions.values())
    )
    sizes = [r.numel() for r in results.values()]
    parts = ca.vertsplit(ca.densify(tangent), _offsets(sizes))
    return ca.Function(
        f"{function.name()}_forward",
        [*arguments.values(), *directions.values()],
        ca.cse(parts),
        [*arguments, *directions],
        [f"d_{name}" for name in results],
    )


def reverse(function: ca.Function) -> ca.Function:
    """Return the product of a direction with the Jacobian of `function`, ``<name>_reverse``.

    Its arguments are those of `function` and a direction ``bar_<result>`` for each result; its results are
    ``bar_<argument>``, (direction J).
    """
    arguments, results = _symbols(function)
    directions = {f"bar_{name}": ca.SX.sym(name, *r.shape) for name, r in results.items()}
    adjoint = ca.jtimes(
        ca.vertcat(*results.values()), ca.vertcat(*arguments.values()), ca.vertcat(*directions.values()), True
    )
    sizes = [a.numel() for a in arguments.values()]
    parts = ca.vertsplit(ca.densify(adjoint), _offsets(sizes))
    return ca.Function(
        f"{function.name()}_reverse",
        [*arguments.values(), *directions.values()],
        ca.cse(parts),
        [*arguments, *directions],
        [f"bar_{name}" for name in arguments],
    )


def _symbols(function: ca.Function) -> tuple[dict[str, ca.SX], dict[str, ca.SX]]:
    arguments = {name: ca.SX.sym(name, function.numel_in(name)) for name in function.name_in()}
    results = function.call(list(arguments.values()))
    return arguments, {name: ca.vec(r) for name, r in zip(function.name_out(), results, strict=True)}


def _offsets(sizes: list[int]) -> list[int]:
    offsets = [0]
    for size in sizes:
        offsets.append(offsets[-1] + size)
    return offsets


DIRECTIONS: dict[str, Callable[[ca.Function], ca.Function]] = {"forward": forward, "reverse": reverse}
"""Ending of the name to what makes the derivative."""
