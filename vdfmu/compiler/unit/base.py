"""Base class of units: variables, and methods in numpy that run on floats and on symbols."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Literal

import numpy as np

from vdfmu.base.errors import UnitError, UsageError
from vdfmu.compiler.unit.declaration import (
    AT,
    JOINTS,
    SOLVER_TOLERANCE,
    SOLVERS,
    Choice,
    Declared,
    Event,
    Input,
    Machine,
    Mode,
    Parameter,
    RobotParameters,
    State,
    Switch,
    Terminal,
    Variables,
    constant,
)

ABOUT = ("version", "author", "copyright", "license")
"""Attributes of a unit's class and of a model description, in the order of the latter."""


class Values:
    """The values `sets` of an instance at the time `now` [s]; subclasses use other values, and record access."""

    def __init__(self, unit: Any) -> None:
        self.unit, self.now = unit, 0.0
        self.sets: dict[str, Any] = {}

    def read(self, declared: Declared) -> Any:
        """Return the value of a variable."""
        if declared.name not in self.sets:
            raise UnitError(f"{type(self.unit).__name__}.{declared.name} is read before it is set.")
        return self.sets[declared.name]

    def write(self, declared: Declared, value: Any) -> None:
        """Set a variable."""
        self.sets[declared.name] = self.unit.fitting(declared, value)

    def keep(self, name: str) -> None:
        """Raise UnitError if an attribute that is not a variable may not be set."""

    def time(self) -> Any:
        """Return the time [s]."""
        return self.now

    def robot(self, fields: tuple[str, ...]) -> Any:
        """Return the robot, for the fields that a unit declares."""
        return self.unit.of_robot


class BaseUnit:
    """A unit without the methods to run it in Python; see :class:`vdfmu.unit.Unit`."""

    backend: ClassVar[Literal["native", "python"]] = "native"
    """``"python"``: the methods cannot be traced; the FMU runs them in Python."""
    files: ClassVar[tuple[str, ...]] = ()
    """Modules and data that the unit loads from its file's folder; a Python FMU contains them."""
    made_of: ClassVar[Mapping[str, bytes] | None] = None
    """Name to content of ``unit.py`` and the files next to it, for a class that no file declares."""
    author: ClassVar[str | None] = None
    """Author of the FMU; like `license`, `copyright` and `version` it is omitted if None."""
    license: ClassVar[str | None] = None
    copyright: ClassVar[str | None] = None
    version: ClassVar[str | None] = None
    terminals: ClassVar[tuple[Terminal, ...]] = ()
    elimination: ClassVar[tuple[str, ...]] = ()
    """Order in which the solver eliminates the states; it affects the cost, not the result."""
    exchange: ClassVar[bool] = False
    """Whether the native FMU has model exchange even without states. Generated systems then use it for model
    exchange."""
    chain: ClassVar[int | None] = None
    """Number of joints from which each joint calls its own functions, see :mod:`.joints`. None: never."""
    sampled: ClassVar[bool | None] = None
    """True if the unit samples its inputs, every ``period`` or once per step, and holds its outputs. False for a law in
    continuous time, which a shorter communication step approximates better. None if not declared."""
    experiment_stop: ClassVar[float] = 1.0
    """End of the experiment of the FMU's reference results [s]."""
    declared: Mapping[str, Declared] = {}
    """Variables by name: all of the class, or on an instance those for its robot."""
    robot_fields: ClassVar[tuple[str, ...] | None] = None
    """Fields of the :class:`RobotParameters`; empty for all, None without parameters of the robot."""
    in_use: Values
    """The values that the methods read and set: those of the instance or, during a run, others."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        variables = dict(super(cls, cls).declared)  # pyright: ignore[reportAttributeAccessIssue]
        for name, value in _members(cls):
            if not isinstance(value, (Declared, RobotParameters)):
                continue
            if hasattr(BaseUnit, name) or name in ("of_robot", "store", "in_use"):
                raise UnitError(f"{cls.__name__}: a variable cannot be called {name}: every unit has it. Rename it.")
            if isinstance(value, Declared):
                variables[name] = value
            else:
                cls.robot_fields = value.fields
        states = [d for d in variables.values() if isinstance(d, State)]
        added: dict[str, Declared] = {
            f"{state.name}_0": _start_parameter(state) for state in states if cls.start is BaseUnit.start
        }
        if any(type(d) is State for d in states):
            added["tolerance"] = Parameter("1", (), _TOLERANCE, start=SOLVER_TOLERANCE, minimum=1e-12, maximum=0.1)
        if cls.backend == "python":  # scipy integrates it
            variables.pop("solver", None)
        elif "tolerance" in variables | added:
            added["solver"] = Choice(*SOLVERS, text=_SOLVER)
        for name, parameter in added.items():
            if name not in variables:
                parameter.__set_name__(cls, name)
                setattr(cls, name, parameter)
                variables[name] = parameter
        cls.declared = variables

    def __init__(self, robot: Machine | None = None, **values: Any) -> None:
        if robot is None and self.needs_robot():
            raise UnitError(f"{type(self).__name__} needs a robot, for its joints. Pass robot=load_robot(..).")
        self.in_use = Values(self)
        self.store = self.in_use.sets
        self.of_robot = robot
        self.declared = self.declared_for(robot)
        for name, declared in self.declared.items():
            if declared.set_by is None:
                start = declared.start_value(robot)[()]
                self.store[name] = declared.choices[int(start)] if declared.choices else start
        for name, value in values.items():
            if name not in self.store:
                raise UsageError(f"{type(self).__name__} has no {name!r} to set. There are: {', '.join(self.store)}.")
            setattr(self, name, value)

    @classmethod
    def needs_robot(cls) -> bool:
        """Return whether some variable has an element for each joint, or belongs to the robot."""
        return cls.robot_fields is not None or any(JOINTS in d.shape or d.when for d in cls.declared.values())

    @classmethod
    def declared_for(cls, robot: Machine | None) -> dict[str, Declared]:
        """Return the variables by name, without optional ones (`when`) that the robot does not have."""
        return {name: d for name, d in cls.declared.items() if d.when is None or getattr(robot, d.when, False)}

    @classmethod
    def event_methods(cls, robot: Machine | None) -> tuple[str, ...]:
        """Names of the methods that run at the events, ``at_<name>``, in the order of the events."""
        return tuple(f"{AT}{name}" for name, d in cls.declared_for(robot).items() if isinstance(d, Event))

    @classmethod
    def description(cls) -> str:
        """First line of the docstring, without its full stop."""
        return ((cls.__doc__ or "").strip() or cls.__name__).splitlines()[0].rstrip(".")

    def start(self) -> None:
        """Set the states from the parameters."""
        for name, declared in self.declared.items():
            if isinstance(declared, State):
                setattr(self, name, getattr(self, f"{name}_0"))

    def outputs(self) -> None:
        """Set the outputs."""

    def derivatives(self) -> None:
        """Set the derivatives of the continuous states."""

    def update(self) -> None:
        """Set the sampled states until the next sample. A state that is not set keeps its value."""

    def events(self) -> None:
        """Set the event indicators. When one rises above 0, this is an event, and its ``at_<name>`` runs."""

    def balance(self) -> Any:
        """Return the residual of the equations in the order of the states, (n_x,): zero at the right derivatives.

        The solver linearises it instead of ``derivatives``. This may be much shorter: a balance of forces needs no
        inverse of a mass matrix.
        """
        raise NotImplementedError

    def requirements(self) -> Mapping[Any, tuple[str, Any]]:
        """Return conditions on parameters in addition to their limits.

        Keys are the name of a parameter, or a tuple of names. Values are the condition as text and a number that is
        positive if it holds, calculated only from parameters that are not choices. A scenario is rejected before its
        run, an FMU at its initialization.
        """
        return {}

    def experiment(self) -> None:
        """Set the inputs for the time ``self.t`` of the experiment of the FMU's reference results.

        Inputs with two indices stay constant, because their names contain a comma, which tables of FMI 2.0 do not
        allow.
        """
        phase = 0.0
        for name, declared in self.declared.items():
            if isinstance(declared, Input) and len(declared.shape) < 2:
                size = np.shape(getattr(self, name))
                count = math.prod(size)
                wave = 0.1 * np.sin(2.0 * self.t + phase + 0.4 * np.arange(count)).reshape(size)
                setattr(self, name, np.clip(wave, declared.minimum, declared.maximum))
                phase += 1.0

    def __setattr__(self, name: str, value: Any) -> None:
        values = vars(self).get("in_use")  # a subclass may set attributes before it calls this class
        if values is not None and name not in self.declared and name != "in_use":
            values.keep(name)
        super().__setattr__(name, value)

    def _read(self, declared: Declared | RobotParameters) -> Any:
        if isinstance(declared, RobotParameters):
            return self.in_use.robot(declared.fields)
        self._check_there(declared)
        return self.in_use.read(declared)

    def _write(self, declared: Declared, value: Any) -> None:
        self._check_there(declared)
        self.in_use.write(declared, value)

    def _check_there(self, declared: Declared) -> None:
        if declared.name not in self.declared:
            raise UnitError(f"{type(self).__name__}.{declared.name} exists only for a robot with {declared.when}")

    def fitting(self, declared: Declared, value: Any) -> Any:
        """Return a value in a variable's shape; UsageError if it does not fit."""
        where = f"{type(self).__name__}.{declared.name}"
        if declared.choices and (isinstance(declared, Choice) or isinstance(value, str)):
            if value not in declared.choices:
                raise UsageError(f"{where}: expected {' or '.join(declared.choices)}, got {value!r}.")
            return value if isinstance(declared, Choice) else np.float64(declared.choices.index(value))
        if isinstance(declared, Switch) and (np.ndim(value) or value not in (True, False)):
            raise UsageError(f"{where}: expected True or False, got {value!r}.")
        sizes = declared.sizes(self.n)
        array = np.asarray(value)
        kinds = (float, int, np.number)
        if array.dtype.kind not in "biuf" and not all(isinstance(v, kinds) or hasattr(v, "sx") for v in array.flat):
            raise UsageError(f"{where}: expected numbers, got {value!r}.")
        try:
            return constant(array, sizes)[()]
        except ValueError:
            raise UsageError(f"{where}: expected shape {sizes}, got {array.shape}.") from None

    @property
    def n(self) -> int:
        """Number of joints; 0 without a robot."""
        return self.of_robot.n if self.of_robot is not None else 0

    @property
    def t(self) -> Any:
        """Time [s]."""
        return self.in_use.time()

    @t.setter
    def t(self, value: float) -> None:
        self.in_use.now = value


def unit_name(unit: type[BaseUnit]) -> str:
    """Return a unit's name in commands, systems and scenarios: its file if shipped, or its class, ``pd_controller``."""
    return unit.__module__.rpartition(".")[2] if is_shipped(unit) else snake_case(unit.__name__)


def is_shipped(unit: type[BaseUnit]) -> bool:
    """Return whether a unit is a class in a module of this package, not one made at run time."""
    ours = unit.__module__.startswith(f"{__name__.partition('.')[0]}.")
    return ours and getattr(sys.modules[unit.__module__], unit.__name__, None) is unit


def snake_case(name: str) -> str:
    """Return ``my_filter`` of ``MyFilter``."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()


_SOLVER = "Internal steps of the solver: as many as the tolerance needs, or that number in each communication step"
_TOLERANCE = (
    "Tolerance of the solver, relative and absolute in SI units; a smaller tolerance of the experiment replaces it"
)


def _members(unit: type[BaseUnit]) -> Iterator[tuple[str, Any]]:
    """Yield the attributes of a class in order, with each `Variables` replaced by its variables."""
    for name, value in list(vars(unit).items()):
        if not isinstance(value, Variables):
            yield name, value
            continue
        delattr(unit, name)
        for each, variable in value.items():
            setattr(unit, each, variable)
            yield each, variable


def _start_parameter(state: State) -> Declared:
    if isinstance(state, Mode):
        return Choice(*state.choices, text=f"start of {state.text or state.name}")
    text = state.text if isinstance(state.text, str) else list(state.text)
    text = f"start of {text or state.name}" if isinstance(text, str) else [f"start of {each}" for each in text]
    return Parameter(state.unit, state.shape, text, start=state.start, when=state.when, **state.attributes())
