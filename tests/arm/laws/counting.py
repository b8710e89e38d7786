"""A scalar without a value that counts the operations done with it.

The equations are generic in dtype and never branch on a value, so they run on object arrays of it as they are
written. The counts are exact and the same on every machine.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from benchmarks.chains import repeated_link
from vdfmu.arm.robot import Robot

_RIGID = ("rotation", "offset", "mass", "centroid", "inertia")


class Count(NamedTuple):
    """Multiplications (and divisions), additions (and subtractions), and calls of sin and cos."""

    multiplications: int
    additions: int
    functions: int


class Counter:
    """Stands for every number of the robot and of the motion; a sign change counts nothing.

    An operation counts if a Counter takes part, whatever the other operand: products with the zeros of a
    6 x 6 matrix count, as numpy does them on floats; products of two constants do not.
    """

    __slots__ = ("additions", "functions", "multiplications")

    def __init__(self) -> None:
        self.multiplications = self.additions = self.functions = 0

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented  # numpy takes the array apart
        self.multiplications += 1
        return self

    def __add__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return NotImplemented
        self.additions += 1
        return self

    __rmul__ = __truediv__ = __rtruediv__ = __mul__
    __radd__ = __sub__ = __rsub__ = __add__

    def __neg__(self) -> Counter:
        return self

    def sin(self) -> Counter:
        """Sine; numpy calls it by name."""
        self.functions += 1
        return self

    def cos(self) -> Counter:
        """Cosine."""
        self.functions += 1
        return self

    def array(self, *shape: int) -> np.ndarray:
        """Array of this counter."""
        out = np.empty(shape, dtype=object)
        out.fill(self)
        return out


def count_operations(equations: Callable[[Counter], Any]) -> Count:
    counter = Counter()
    equations(counter)
    return Count(counter.multiplications, counter.additions, counter.functions)


def counting_chain(n: int, counter: Counter) -> Robot:
    robot = repeated_link(n)
    fields = {name: counter.array(*getattr(robot, name).shape) for name in (*_RIGID, "gravity", "tool_offset")}
    return dataclasses.replace(robot, **fields)
