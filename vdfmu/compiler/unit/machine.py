"""Machines that a unit may be built for: a machine with joints and with numbers of its own."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, Self

import casadi as ca

from vdfmu.base.arrays import Floats
from vdfmu.compiler.functions.traced import traced_function
from vdfmu.compiler.scalar.symbol import to_sx

STRICT = 1e-300
"""A margin holds from 0 on. Where equality must fail this is taken off: it changes no number but zero."""


@dataclass(frozen=True)
class Entry:
    """One number: the name of an array, and the index in it, from 0."""

    field: str
    index: tuple[int, ...]

    @property
    def name(self) -> str:
        """Structured name, counted from 1: ``centroid[1,3]``."""
        return self.field + (f"[{','.join(str(i + 1) for i in self.index)}]" if self.index else "")


@dataclass(frozen=True)
class Facts:
    """Text of a variable for an entry."""

    unit: str
    minimum: float
    maximum: float
    text: str


@dataclass(frozen=True)
class Requirement:
    """One condition on parameters."""

    expected: str
    """The condition as text."""
    parameters: tuple[Entry, ...]
    """Subject of the parameter."""
    margin: Callable[[Any, Entry], Any] | None = None
    """Returns the margin of a machine, given the first of the parameters; None where a unit calculates it."""


class Machine(Protocol):
    """A machine, :class:`vdfmu.Robot` is one: arrays of numbers, of which some stay parameters at run time."""

    reader: ClassVar[str]
    """``module:function`` that makes one of what `to_dict` returns, and the name of the file in messages."""
    flags: ClassVar[tuple[str, ...]]
    """Attributes that say whether it has an option; a variable may be there with one only."""
    joint_fields: ClassVar[tuple[str, ...]]
    """Arrays with one number for each joint."""

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def description(self) -> str: ...  # noqa: D102
    @property
    def joint_types(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def n(self) -> int:
        """Number of joints."""
        ...

    def entries(self) -> list[Entry]:
        """Return its run-time parameters, in the order of the parameter vector of every traced function."""
        ...

    def facts(self, entry: Entry) -> Facts:
        """Return what a variable says of one of its numbers."""
        ...

    def values(self) -> Floats:
        """Return its parameter vector, in the order of `entries`."""
        ...

    def with_values(self, vector: Sequence[float] | Floats) -> Self:
        """Return a copy with another parameter vector."""
        ...

    def with_parameters(self, **arrays: Any) -> Self:
        """Return a copy with other arrays."""
        ...

    def symbolic(self) -> tuple[Any, ca.SX]:
        """Return a copy with symbols for run-time parameters, constants elsewhere; and the symbols' vector."""
        ...

    def key(self) -> str:
        """Return what decides its traced functions: the same for machines that differ in run-time parameters only."""
        ...

    def shorter(self) -> Sequence[Self]:
        """Return the same with fewer joints, where the ones left out are like their neighbours; nothing where not."""
        ...

    def requirements(self) -> list[Requirement]:
        """Return what its run-time parameters must meet together."""
        ...

    def to_dict(self, looks: bool = True) -> dict[str, Any]:
        """Return it as plain lists, numbers and texts; `looks` with what nothing calculates with."""
        ...


def margins(machine: Any, requirements: Collection[Requirement]) -> list[Any]:
    """Return the margin of each condition, of floats or symbols; a condition holds where its margin is >= 0."""
    return [each.margin(machine, each.parameters[0]) for each in requirements if each.margin is not None]


def traced_margins(machine: Machine) -> list[ca.Function]:
    """Return the function ``margins`` of the parameter vector to what `margins` returns; none without conditions."""
    requirements = machine.requirements()
    if not requirements:
        return []
    symbols, p = machine.symbolic()
    return [traced_function("margins", {"p": p}, {"margin": to_sx(margins(symbols, requirements))})]
