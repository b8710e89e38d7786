"""The variables that the class of a unit declares.

    class Filter(Unit):
        u = Input("1", text="signal")
        T = Parameter("s", text="time constant", start=0.1, minimum=1e-6)
        y = State("1", text="filtered signal")
        y_dot = Derivative(y)

        def derivatives(self) -> None:
            self.y_dot = (self.u - self.y) / self.T

:mod:`vdfmu.compiler.unit.base` has the class.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field, fields
from typing import Any, ClassVar, Literal, Self, overload

import numpy as np

from vdfmu.base.errors import UnitError
from vdfmu.compiler.unit.machine import Machine


class _Joints:
    """The axis of a shape that has an element for each joint, or link."""

    def __repr__(self) -> str:
        return "JOINTS"


JOINTS = _Joints()
"""Length of an axis: the number of joints, or links, of the robot."""

Axis = int | _Joints
SOLVER_TOLERANCE = 1e-7
"""Tolerance of the plant's solver where nothing else is said, relative and absolute in SI units."""
SOLVERS = ("adaptive", *(f"fixed_{count}" for count in range(1, 5)))
"""Kinds of the solver: as many internal steps as the tolerance needs, or 1 to 4 in each communication step."""
PHASES = ("start", "outputs", "derivatives", "update")
"""The methods of a unit: what they set is in `Declared.set_by`."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Attributes:
    """Attributes of FMI that the elements of a variable share. A model description has them as they are here."""

    minimum: float | None = None
    maximum: float | None = None

    def attributes(self) -> dict[str, Any]:
        """Return the attributes by name."""
        return {each.name: getattr(self, each.name) for each in fields(Attributes)}


@dataclass(frozen=True, eq=False, repr=False)
class Declared(Attributes):
    """A variable of a unit, an attribute of its class.

    On an instance it is the variable's value: a number of shape ``()``, else an array.

    Parameters
    ----------
    unit : str or sequence of str
        Unit of measurement, ``"N.m"``, or a quantity of a joint, ``"position"``, whose unit follows from the joint's
        type; or one for each element. ``"1"`` is a number without a unit.
    shape : int, :data:`JOINTS`, or tuple of them
        ``()``, the default, is a scalar.
    text : str or sequence of str
        Its meaning, or one for each element. An element of a joint gets ``Joint 1:`` before it, others their indices
        behind it.
    start : number, array_like or function
        Start value, broadcast to the shape. The arguments of a function are the parameters of their names, and the
        robot, of any other name.
    minimum, maximum : float, optional
    when : str, optional
        Optional section of a robot file: the unit of a robot without it lacks the variable.
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

    @overload
    def __get__(self, unit: None, owner: type) -> Self: ...
    @overload
    def __get__(self, unit: object, owner: type) -> Any: ...
    def __get__(self, unit: Any, owner: type) -> Any:
        return self if unit is None else unit._read(self)  # pyright: ignore[reportPrivateUsage]

    def __set__(self, unit: Any, value: Any) -> None:
        unit._write(self, value)  # pyright: ignore[reportPrivateUsage]

    def sizes(self, n: int) -> tuple[int, ...]:
        """Shape for a robot of `n` joints."""
        return tuple(n if isinstance(axis, _Joints) else axis for axis in self.shape)

    def start_value(self, robot: Machine | None) -> np.ndarray[Any, Any]:
        """Start value in the shape for a robot; UnitError if it does not fit."""
        start: Any = self.start
        return self.shaped(np.asarray(start(robot) if callable(start) else start), robot)

    def shaped(self, value: np.ndarray[Any, Any], robot: Machine | None) -> np.ndarray[Any, Any]:
        """Return a value in the shape for a robot, constant; UnitError if it does not fit."""
        sizes = self.sizes(robot.n if robot is not None else 0)
        try:
            return constant(value, sizes)
        except ValueError:
            raise UnitError(f"{self.name}: start value: expected shape {sizes}, got {value.shape}.") from None


def constant(values: np.ndarray[Any, Any], shape: tuple[int, ...]) -> np.ndarray[Any, Any]:
    """Return a copy in a shape, whose elements cannot be set, which would be lost; ValueError for another shape."""
    copy = np.broadcast_to(values, shape).copy()
    copy.flags.writeable = False
    return copy


class Input(Declared):
    """A signal that the unit is given."""

    causality = "input"


class Output(Declared):
    """A signal that ``outputs`` calculates from inputs, parameters, states and time."""

    causality = "output"
    set_by = "outputs"


class State(Declared):
    """A continuous state, an output as well. It has a :class:`Derivative`.

    ``start`` sets it from parameters; without that method it starts at a parameter ``<name>_0``.
    """

    causality = "output"
    set_by = "start"


@dataclass(frozen=True, eq=False, repr=False)
class Sampled(State):
    """A state that ``update`` sets every ``period``, a parameter of the unit [s]; it is held in between.

    Its value holds from the sample on, so the unit is stepped before the units that read it. A `delayed` one reaches
    them at the next communication point: that breaks a loop of sampled units.

    Parameters: see :class:`Declared`, and

    delayed : bool
    """

    variability = "discrete"
    _: KW_ONLY
    delayed: bool = False


class Derivative(Declared):
    """The derivative in time of a state, which ``derivatives`` sets."""

    causality = "local"
    set_by = "derivatives"
    state: State

    def __init__(self, state: State) -> None:
        super().__init__(state.unit, state.shape, state.text, when=state.when)
        self._set("state", state)


@dataclass(frozen=True, eq=False, repr=False)
class Parameter(Declared):
    """A value that is fixed over a run, or `tunable` in it.

    Parameters: see :class:`Declared`.
    """

    _: KW_ONLY
    tunable: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set("variability", "tunable" if self.tunable else "fixed")


class Choice(Declared):
    """A fixed parameter with named values; on an instance it is the name. The first is the default."""

    variability = "fixed"
    type = "Integer"

    def __init__(self, *choices: str, text: str = "") -> None:
        super().__init__(text=text, start=0, minimum=0, maximum=len(choices) - 1)
        self._set("choices", choices)


class Switch(Declared):
    """A fixed parameter that is true or false."""

    variability = "fixed"
    type = "Boolean"

    def __init__(self, start: bool, text: str = "") -> None:
        super().__init__(text=text, start=start)


class RobotParameters:
    """Parameters of the robot that the unit is for; on an instance, a robot.

    Parameters
    ----------
    *fields : str
        Those of `Robot` that the unit has; default all that can be set at run time.
    """

    def __init__(self, *fields: str) -> None:
        self.fields = fields

    @overload
    def __get__(self, unit: None, owner: type) -> Self: ...
    @overload
    def __get__(self, unit: object, owner: type) -> Any: ...
    def __get__(self, unit: Any, owner: type) -> Any:
        return self if unit is None else unit._robot(self.fields)  # pyright: ignore[reportPrivateUsage]


@dataclass(frozen=True)
class Terminal:
    """Variables of a unit that are connected together.

    Units are connected by joining their terminals of the same name, output to input, member by member.

    Attributes
    ----------
    name : str
    side : "left", "right", "bottom" or "top"
        Where it is drawn.
    groups : tuple of str
        Names of the variables.
    description : str
    """

    name: str
    side: Literal["left", "right", "bottom", "top"]
    groups: tuple[str, ...]
    description: str
