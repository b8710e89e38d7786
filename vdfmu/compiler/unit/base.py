"""Units: a unit is one class that declares variables and says in numpy what it computes.

The methods run on floats as they stand, and on symbols, from which the functions of an FMU are traced.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import numpy as np

from vdfmu.base.errors import UnitError, UsageError
from vdfmu.compiler.unit.declaration import (
    JOINTS,
    SOLVER_TOLERANCE,
    SOLVERS,
    Choice,
    Declared,
    Input,
    Parameter,
    RobotParameters,
    Sampled,
    State,
    Switch,
    Terminal,
    constant,
)
from vdfmu.compiler.unit.machine import Machine
from vdfmu.compiler.unit.values import Values

ABOUT = ("version", "author", "copyright", "license")
"""Attributes of a unit's class, and of a model description, in their order there."""


class BaseUnit:
    """A unit without what runs it; see :class:`vdfmu.unit.Unit`."""

    backend: ClassVar[Literal["native", "python"]] = "native"
    """``"python"``: the methods cannot be traced; the FMU runs them in Python."""
    files: ClassVar[tuple[str, ...]] = ()
    """Modules and data that the unit loads from the folder of its file; a Python FMU carries them."""
    made_of: ClassVar[Mapping[str, bytes] | None] = None
    """Name to content of ``unit.py`` and the files beside it, of a class that no file declares."""
    author: ClassVar[str | None] = None
    """Author of the FMU, as `license`, `copyright` and `version`; None: the author of the project with the file."""
    license: ClassVar[str | None] = None
    copyright: ClassVar[str | None] = None
    version: ClassVar[str | None] = None
    terminals: ClassVar[tuple[Terminal, ...]] = ()
    elimination: ClassVar[tuple[str, ...]] = ()
    """States in the order in which the solver eliminates them; it decides the cost, not the result."""
    exchange: ClassVar[bool] = False
    """Whether the native FMU is for model exchange without states as well, and is so where a system is written."""
    chain: ClassVar[int | None] = None
    """Joints from which :meth:`balance` is linearised with what it hands to ``cut`` as unknowns of their own."""
    experiment_stop: ClassVar[float] = 1.0
    """End of the experiment of the FMU's reference results [s]."""
    declared: Mapping[str, Declared] = {}
    """Variables by name: of the class all, of an instance those that it has for its robot."""
    robot_fields: ClassVar[tuple[str, ...] | None] = None
    """Fields of the :class:`RobotParameters`; empty: all; None: the unit has none."""
    in_use: Values
    """The values that the methods read and set: those of the instance, but in a run on others."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        own = {key: v for key, v in vars(cls).items() if isinstance(v, (Declared, RobotParameters))}
        for name in own:
            if hasattr(BaseUnit, name) or name in ("of_robot", "store", "in_use"):
                raise UnitError(f"{cls.__name__}: a variable cannot be called {name}, which every unit has already.")
        found = dict(cls.declared)
        for name, value in own.items():
            if isinstance(value, Declared):
                found[name] = value
            else:
                cls.robot_fields = value.fields
        states = [d for d in found.values() if isinstance(d, State)]
        if cls.start is BaseUnit.start:
            for state in states:
                name = f"{state.name}_0"
                if name not in found:
                    found[name] = _added(name, _start_parameter(state), cls)
        if any(not isinstance(d, Sampled) for d in states) and "tolerance" not in found:
            found["tolerance"] = _added("tolerance", _tolerance(), cls)
        if cls.backend == "python":  # scipy integrates it
            found.pop("solver", None)
        elif "tolerance" in found and "solver" not in found:
            found["solver"] = _added("solver", Choice(*SOLVERS, text=_SOLVER), cls)
        cls.declared = found

    def __init__(self, robot: Machine | None = None, **values: Any) -> None:
        if robot is None and self.needs_robot():
            raise UnitError(f"{type(self).__name__} needs a robot, for its joints. Give one: robot=load_robot(..).")
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
        """Whether some variable has an element for each joint, or belongs to the robot."""
        return cls.robot_fields is not None or any(JOINTS in d.shape or d.when for d in cls.declared.values())

    @classmethod
    def declared_for(cls, robot: Machine | None) -> dict[str, Declared]:
        """Variables by name, except for those of options that the robot lacks."""
        return {name: d for name, d in cls.declared.items() if d.when is None or getattr(robot, d.when, False)}

    @classmethod
    def description(cls) -> str:
        """First line of the docstring, without its full stop."""
        return ((cls.__doc__ or "").strip() or cls.__name__).splitlines()[0].rstrip(".")

    # ---------------------------------------------------------------- what a subclass overrides

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
        """Set the sampled states for the time until the next sample; what is not set keeps its value."""

    def balance(self) -> Any:
        """Return what is zero where the derivatives are right, in the order of the states, (n_x,).

        The solver uses its derivatives, which may be much shorter than the derivatives of ``derivatives``: a balance of
        forces needs no inverse of a mass matrix.
        """
        raise NotImplementedError

    def requirements(self) -> Mapping[Any, tuple[str, Any]]:
        """Return what parameters must meet that their limits cannot say.

        A parameter's name, or names of several, to what is expected of it, and a number that is above 0 where that
        holds. It is calculated from parameters alone, without choices. A scenario is refused before its run, an FMU at
        its initialization.
        """
        return {}

    def experiment(self) -> None:
        """Set the inputs for the time ``self.t`` of the experiment of the FMU's reference results.

        Inputs of two indices, with a comma in their names, stay: tables of FMI 2.0 have none.
        """
        phase = 0.0
        for name, declared in self.declared.items():
            if isinstance(declared, Input) and len(declared.shape) < 2:
                size = np.shape(getattr(self, name))
                count = math.prod(size)
                wave = 0.1 * np.sin(2.0 * self.t + phase + 0.4 * np.arange(count)).reshape(size)
                setattr(self, name, np.clip(wave, declared.minimum, declared.maximum))
                phase += 1.0

    # ---------------------------------------------------------------- values

    def __setattr__(self, name: str, value: Any) -> None:
        values = vars(self).get("in_use")  # a subclass may set attributes before it calls this class
        if values is not None and name not in self.declared and name != "in_use":
            values.keep(name)
        super().__setattr__(name, value)

    def _read(self, declared: Declared) -> Any:
        self._check_there(declared)
        return self.in_use.read(declared)

    def _write(self, declared: Declared, value: Any) -> None:
        self._check_there(declared)
        self.in_use.write(declared, value)

    def _check_there(self, declared: Declared) -> None:
        if declared.name not in self.declared:
            raise UnitError(f"{type(self).__name__}.{declared.name} is there for a robot with {declared.when} only")

    def fitting(self, declared: Declared, value: Any) -> Any:
        """Return a value in the shape of a variable; UsageError if it does not fit."""
        where = f"{type(self).__name__}.{declared.name}"
        if declared.choices:
            if value not in declared.choices:
                raise UsageError(f"{where}: expected {' or '.join(declared.choices)}, got {value!r}.")
            return value
        if isinstance(declared, Switch) and (np.ndim(value) or value not in (True, False)):
            raise UsageError(f"{where}: expected True or False, got {value!r}.")
        sizes = declared.sizes(self.n)
        array = np.asarray(value)
        if array.dtype.kind not in "biuf" and not all(_is_number(v) for v in array.flat):
            raise UsageError(f"{where}: expected numbers, got {value!r}.")
        try:
            return constant(array, sizes)[()]
        except ValueError:
            raise UsageError(f"{where}: expected shape {sizes}, got {array.shape}.") from None

    @property
    def n(self) -> int:
        """Number of joints of the robot; 0 without one."""
        return self.of_robot.n if self.of_robot is not None else 0

    @property
    def t(self) -> Any:
        """Time [s]."""
        return self.in_use.time()

    @t.setter
    def t(self, value: float) -> None:
        self.in_use.now = value

    def _robot(self, fields: tuple[str, ...]) -> Any:
        return self.in_use.robot(fields)


def unit_name(unit: type[BaseUnit]) -> str:
    """Name of a unit in commands, systems and scenarios: its file's for a shipped one, else ``pd_controller``."""
    return unit.__module__.rpartition(".")[2] if is_shipped(unit) else snake_case(unit.__name__)


def is_shipped(unit: type[BaseUnit]) -> bool:
    """Whether a unit is one of this package, in a file of its name; not a class that is made while it runs."""
    ours = unit.__module__.startswith(f"{__name__.partition('.')[0]}.")
    return ours and getattr(sys.modules[unit.__module__], unit.__name__, None) is unit


def snake_case(name: str) -> str:
    """Return ``my_filter`` of ``MyFilter``."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()


def _is_number(value: Any) -> bool:
    """Whether a value is a number, or a symbol."""
    return isinstance(value, (float, int, np.number)) or hasattr(value, "sx")


def _added(name: str, parameter: Any, owner: type) -> Any:
    parameter.__set_name__(owner, name)
    setattr(owner, name, parameter)
    return parameter


_SOLVER = "Internal steps of the solver: as many as the tolerance needs, or that number in each communication step"


def _start_parameter(state: State) -> Parameter:
    text = state.text if isinstance(state.text, str) else list(state.text)
    text = f"start of {text or state.name}" if isinstance(text, str) else [f"start of {one}" for one in text]
    return Parameter(state.unit, state.shape, text, start=state.start, when=state.when, **state.attributes())


def _tolerance() -> Parameter:
    text = (
        "Tolerance of the solver, relative and absolute in SI units; a smaller tolerance of the experiment replaces it"
    )
    return Parameter("1", (), text, start=SOLVER_TOLERANCE, minimum=1e-12, maximum=1e-1)
