"""Checks of the arguments of motions, in the same words from Python and from files."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import wraps
from inspect import signature
from typing import Any, NamedTuple, ParamSpec, TypeVar

import numpy as np

from vdfmu.arm.robot.robot import robot_argument
from vdfmu.base.errors import UsageError
from vdfmu.base.toml_tables import value_text

NUMBERS = "a number, or a list or rows of them"
ONE = "one number"
P = ParamSpec("P")
R = TypeVar("R")


class Argument(NamedTuple):
    """Whether a parameter takes text, whole numbers alone, a single number, and is required, by its annotation."""

    text: bool
    whole: bool
    single: bool
    needed: bool


def arguments_of(make: Callable[..., Any]) -> dict[str, Argument]:
    """Return the parameters of a function except for the robot, by name."""
    arguments: dict[str, Argument] = {}
    for name, parameter in signature(make).parameters.items():
        words = {*re.findall(r"\w+", parameter.annotation)}
        text, single = bool(words & {"str", "Literal"}), words <= {"float", "int", "None"}
        arguments[name] = Argument(text, "int" in words, single, parameter.default is parameter.empty)
    arguments.pop("robot", None)
    return arguments


def of_numbers(make: Callable[P, R]) -> Callable[P, R]:
    """Check a function's robot and numbers: UsageError with a line for each wrong type."""
    bound, arguments = signature(make).bind, arguments_of(make)

    @wraps(make)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            values = bound(*args, **kwargs).arguments
        except TypeError:  # Python's message names the function
            return make(*args, **kwargs)
        if values.get("robot") is not None:
            robot_argument(values["robot"])
        problems = [
            f"{name}: expected {expected}, got {value_text(values[name])}."
            for name, argument in arguments.items()
            if name in values and (expected := _expected(argument, values[name]))
        ]
        if problems:
            raise UsageError("\n".join(problems))
        return make(*args, **kwargs)

    return checked


def _expected(argument: Argument, value: Any) -> str:
    """Return the expected type of an argument, or an empty text if it fits."""
    if value is None or (argument.text and isinstance(value, str)):
        return ""
    try:
        array = np.array(value)
    except ValueError:  # rows of different lengths
        return NUMBERS
    if array.size and array.dtype.kind not in "iuf":
        return ONE if argument.single else NUMBERS
    return ONE if array.ndim and argument.single else ""
