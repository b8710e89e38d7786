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
    """Values that a parameter takes, by its annotation."""

    text: bool
    """Whether a text is one of them."""
    whole: bool
    """Whether numbers are whole."""
    single: bool
    """Whether it is one number."""
    needed: bool


def arguments_of(make: Callable[..., Any]) -> dict[str, Argument]:
    """Return the parameters of a function except for the robot, by name."""
    found: dict[str, Argument] = {}
    for name, parameter in signature(make).parameters.items():
        words = {*re.findall(r"\w+", parameter.annotation)}
        single = words <= {"float", "int", "None"}
        found[name] = Argument(
            bool(words & {"str", "Literal"}), "int" in words, single, parameter.default is parameter.empty
        )
    found.pop("robot", None)
    return found


def of_numbers(make: Callable[P, R]) -> Callable[P, R]:
    """Have a function raise UsageError for a robot and numbers that are something else, with a line for each."""
    bound, arguments = signature(make).bind, arguments_of(make)

    @wraps(make)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            given = bound(*args, **kwargs).arguments
        except TypeError:  # in Python's words, which name the function
            return make(*args, **kwargs)
        if given.get("robot") is not None:
            robot_argument(given["robot"])
        problems = [
            f"{name}: expected {expected}, got {value_text(given[name])}."
            for name, argument in arguments.items()
            if name in given and (expected := _expected(argument, given[name]))
        ]
        if problems:
            raise UsageError("\n".join(problems))
        return make(*args, **kwargs)

    return checked


def _expected(argument: Argument, value: Any) -> str:
    """Return what an argument should be, if it is something else."""
    if value is None or (argument.text and isinstance(value, str)):
        return ""
    try:
        array = np.array(value)
    except ValueError:  # rows of different lengths
        return NUMBERS
    if array.size and array.dtype.kind not in "iuf":
        return ONE if argument.single else NUMBERS
    return ONE if array.ndim and argument.single else ""
