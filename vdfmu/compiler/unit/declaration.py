"""Variables that a unit's class declares, and the machine for which it is made.

For example::

    class Filter(Unit):
        u = Input("1", text="signal")
        T = Parameter("s", text="time constant", start=0.1, minimum=1e-6)
        y = State("1", text="filtered signal")
        y_dot = Derivative(y)

        def derivatives(self) -> None:
            self.y_dot = (self.u - self.y) / self.T
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, fields
from typing import Any, ClassVar, Literal, Protocol, Self, overload

import numpy as np

from vdfmu.base.arrays import Floats, element_name
from vdfmu.base.domain import NO_LIMIT as NO_LIMIT  # units import it from here
from vdfmu.base.errors import UnitError


class _Joints:
    """The axis of a shape that has an element for each joint, or link."""

    def __repr__(self) -> str:
        return "JOINTS"


JOINTS = _Joints()
"""Length of an axis: the number of joints, or links, of the robot."""
SOLVER_TOLERANCE = 1e-7
"""Default tolerance of the plant's solver, relative and absolute in SI units."""
SOLVERS = ("adaptive", *(f"fixed_{count}" for count in range(1, 5)))
"""Kinds of the solver: as many internal steps as the tolerance requires, or 1 to 4 per communication step."""
PHASES = ("start", "outputs", "derivatives", "update")
"""The methods of every unit. `Declared.set_by` is one of them or ``events``."""
AT = "at_"
"""Start of the name of a method that runs at an event."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Attributes:
    """FMI attributes shared by a variable's elements, with their names and values in a model description."""

    minimum: float | None = None
    maximum: float | None = None

    def attributes(self) -> dict[str, Any]:
        """Return the attributes by name."""
        return {each.name: getattr(self, each.name) for each in fields(Attributes)}


class _OnInstance:
    """Descriptor that is itself on a unit's class and its value on an instance."""

    @overload
    def __get__(self, unit: None, owner: type) -> Self: ...
    @overload
    def __get__(self, unit: object, owner: type) -> Any: ...
    def __get__(self, unit: Any, owner: type) -> Any:
        return self if unit is None else unit._read(self)  # pyright: ignore[reportPrivateUsage]


@dataclass(frozen=True, eq=False, repr=False)
class Declared(Attributes, _OnInstance):
    """A variable of a unit, an attribute of its class.

    On an instance it is the variable's value: a number for the shape ``()``, else an array.

    Parameters
    ----------
    unit : str or sequence of str
        Unit of measurement, ``"N.m"``, or a quantity of a joint, ``"position"``, whose unit follows from the joint's
        type; or one for each element. ``"1"`` is a number without a unit.
    shape : int, :data:`JOINTS`, or tuple of them
        ``()``, the default, is a scalar.
    text : str or sequence of str
        Its meaning, or one for each element. The text of an element is preceded by ``Joint 1:`` if it belongs to a
        joint, otherwise followed by its indices.
    start : number, array_like or function
        Start value, broadcast to the shape. A function is called with the parameters that its arguments name; an
        argument of any other name gets the robot.
    minimum, maximum : float, optional
    when : str, optional
        Optional section of a robot file; without it in the robot, the unit does not have the variable.
    """

    causality: ClassVar[str] = "parameter"
    type: ClassVar[str] = "Real"
    set_by: ClassVar[str | None] = None
    variability = "continuous"
    name = ""
    choices: tuple[str, ...] = field(default=(), init=False)
    unit: str | Sequence[str] = "1"
    shape: Any = ()
    text: str | Sequence[str] = ""
    _: KW_ONLY
    start: Any = 0.0
    when: str | None = None

    def __post_init__(self) -> None:
        self._set("shape", self.shape if isinstance(self.shape, tuple) else (self.shape,))

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)

    def __set_name__(self, owner: type, name: str) -> None:
        self._set("name", name)

    def __set__(self, unit: Any, value: Any) -> None:
        unit._write(self, value)  # pyright: ignore[reportPrivateUsage]

    def sizes(self, n: int) -> tuple[int, ...]:
        """Shape for a robot of `n` joints."""
        return tuple(n if isinstance(axis, _Joints) else axis for axis in self.shape)

    def start_value(self, robot: Machine | None) -> np.ndarray[Any, Any]:
        """Start value in the shape for a robot, constant; UnitError if it does not fit."""
        value = np.asarray(self.start(robot) if callable(self.start) else self.start)
        sizes = self.sizes(robot.n if robot is not None else 0)
        try:
            return constant(value, sizes)
        except ValueError:
            raise UnitError(f"{self.name}: start value: expected shape {sizes}, got {value.shape}.") from None


def constant(values: np.ndarray[Any, Any], shape: tuple[int, ...]) -> np.ndarray[Any, Any]:
    """Return a copy in a shape, read-only as changes of its elements would be lost. ValueError if it does not fit."""
    copy = np.broadcast_to(values, shape).copy()
    copy.flags.writeable = False
    return copy


class Input(Declared):
    """A signal that the unit receives."""

    causality = "input"


class Output(Declared):
    """A signal that ``outputs`` calculates from inputs, parameters, states and time."""

    causality = "output"
    set_by = "outputs"


class State(Declared):
    """A continuous state, which is also an output. It needs a :class:`Derivative`.

    ``start`` sets it from parameters; without ``start`` its initial value is a parameter ``<name>_0``.
    """

    causality = "output"
    set_by = "start"


@dataclass(frozen=True, eq=False, repr=False)
class Sampled(State):
    """A state that ``update`` sets every ``period``, a parameter of the unit [s], and that is held in between.

    Its value is valid from the sample on, so the unit is stepped before the units that read it. A `delayed` one reaches
    them at the next communication point, which breaks a loop of sampled units.

    Parameters: see :class:`Declared`, and

    delayed : bool
    """

    variability = "discrete"
    _: KW_ONLY
    delayed: bool = False


class Held(State):
    """A state that methods of events set and that is held in between."""

    variability = "discrete"


class Event(Output):
    """An event indicator, set by ``events``: its rise above 0 is an event. The method ``at_<name>`` then sets states.

    The solver ends an internal step there. Before the next event the indicator must fall to 0 or below and rise
    again. An indicator that is above 0 at the start is not an event.
    """

    set_by = "events"


class Derivative(Declared):
    """The time derivative of a state, set by ``derivatives``."""

    causality = "local"
    set_by = "derivatives"
    state: State

    def __init__(self, state: State) -> None:
        super().__init__(state.unit, state.shape, state.text, when=state.when)
        self._set("state", state)


@dataclass(frozen=True, eq=False, repr=False)
class Parameter(Declared):
    """A value that is fixed over a run, or `tunable` during it.

    Parameters: see :class:`Declared`.
    """

    _: KW_ONLY
    tunable: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set("variability", "tunable" if self.tunable else "fixed")


class _Named(Declared):
    """An integer whose values 0, 1, .. have names."""

    type = "Integer"

    def __init__(self, *choices: str, text: str = "") -> None:
        super().__init__(text=text, start=0, minimum=0, maximum=len(choices) - 1)
        self._set("choices", choices)


class Choice(_Named):
    """A fixed parameter with named values, the first of which is the default; on an instance it is the name."""

    variability = "fixed"


class Mode(_Named, Held):
    """A held state with named values, which is an output. Methods set it by name or number, and read the number.

    It starts at the parameter ``<name>_0``, a `Choice`.
    """


class Switch(Declared):
    """A fixed parameter that is true or false."""

    variability = "fixed"
    type = "Boolean"

    def __init__(self, start: bool, text: str = "") -> None:
        super().__init__(text=text, start=start)


class Variables(dict[str, Declared]):
    """Variables by name. As an attribute of a class they are declared at its place, instead of the attribute."""

    def __init__(self, variables: Mapping[str, Declared]) -> None:
        super().__init__(variables)
        for name, variable in self.items():
            variable.__set_name__(Variables, name)


class RobotParameters(_OnInstance):
    """Parameters of the robot for which the unit is made; on an instance, a robot.

    Parameters
    ----------
    *fields : str
        Names of fields of `Robot`; default all that can be set at run time.
    """

    def __init__(self, *fields: str) -> None:
        self.fields = fields


@dataclass(frozen=True)
class Terminal:
    """Variables of a unit that are connected as a group.

    Units are connected through their terminals of the same name, output to input, member by member.

    Attributes
    ----------
    name : str
    side : "left", "right", "bottom" or "top"
        Side of the unit on which it is drawn.
    groups : tuple of str
        Names of the variables.
    description : str
    """

    name: str
    side: Literal["left", "right", "bottom", "top"]
    groups: tuple[str, ...]
    description: str


# ------------------------------------------------------------------ machines


STRICT = 1e-300
"""Tiny number subtracted from a margin where 0 must fail, because a requirement holds if its margin is >= 0."""


@dataclass(frozen=True)
class Entry:
    """One number of a machine: the name of its array and its index in it, from 0."""

    field: str
    index: tuple[int, ...]

    @property
    def name(self) -> str:
        """Structured name, counted from 1: ``centroid[1,3]``."""
        return element_name(self.field, self.index)


@dataclass(frozen=True)
class Requirement:
    """A condition on parameters."""

    expected: str
    """The condition as text."""
    parameters: tuple[Entry, ...]
    """The condition's parameters; an error names the first."""
    margin: Callable[[Any, Entry], Any] | None = None
    """Function of a machine and the first parameter that returns the margin, or None if a unit calculates it."""


class Machine(Protocol):
    """A machine, such as :class:`vdfmu.arm.robot.Robot`: arrays of numbers, some of them parameters at run time."""

    reader: ClassVar[str]
    """``module:function`` that makes a machine from the result of `to_dict` and a file name for messages."""
    flags: ClassVar[tuple[str, ...]]
    """Attributes that tell whether it has an option, on which a variable may depend."""
    joint_fields: ClassVar[tuple[str, ...]]
    """Arrays with one number for each joint."""

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def description(self) -> str: ...  # noqa: D102
    @property
    def joint_types(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def n(self) -> int: ...  # noqa: D102  # joints

    def entries(self) -> list[Entry]:
        """Return its run-time parameters, in the order of the parameter vector of every traced function."""
        ...

    def constants(self) -> list[str]:
        """Return the names of its numbers that are constants in every traced function."""
        ...

    def facts(self, entry: Entry) -> tuple[str, float, float, str]:
        """Return the unit of measurement, minimum, maximum and description of a number."""
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

    def symbolic(self) -> tuple[Any, Any]:
        """Return a copy with symbols for run-time parameters and constants elsewhere, and the symbols, a casadi.SX."""
        ...

    def key(self) -> str:
        """Return an identifier of its traced functions, shared by machines that differ only in run-time parameters."""
        ...

    def joint(self, i: int, /) -> Self:
        """Return the machine with only joint `i`, counted from 0."""
        ...

    def requirements(self) -> list[Requirement]:
        """Return conditions on its run-time parameters."""
        ...

    def to_dict(self, looks: bool = True) -> dict[str, Any]:
        """Return it as plain lists, numbers and texts, with `looks` including data that no calculation uses."""
        ...

    @property
    def files(self) -> Mapping[str, str]:
        """Name to text of the files that `to_dict` names; its reader accepts them as a third argument."""
        ...
