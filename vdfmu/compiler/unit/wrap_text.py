"""Texts of the units that :mod:`vdfmu.compiler.unit.wrap` writes."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pprint import pformat
from typing import Any, NamedTuple

import casadi as ca

from vdfmu.base.arrays import Floats
from vdfmu.compiler.scalar.casadi_call import shape_of

_CONTINUOUS = '''
import numpy as np

from vdfmu.unit import Derivative, Input, Output, State, Unit

MATRICES

class NAME(Unit):
    """Linear system.

    ::

        x_dot = A x + B u
        y     = C x + D u
    """

    u = Input("1", N_U, TEXT_U)
    y = Output("1", N_Y, TEXT_Y)
    x = State("1", N_X, TEXT_X)
    x_dot = Derivative(x)

    def outputs(self) -> None:
        self.y = _C @ self.x + _D @ self.u

    def derivatives(self) -> None:
        self.x_dot = _A @ self.x + _B @ self.u
'''
_DISCRETE = '''
import numpy as np

from vdfmu.unit import Input, Parameter, Sampled, Unit

MATRICES

class NAME(Unit):
    """Linear system of discrete time.

    ::

        y[k]   = C x[k] + D u[k]
        x[k+1] = A x[k] + B u[k]
    """

    u = Input("1", N_U, TEXT_U)
    y = Sampled("1", N_Y, TEXT_Y)
    x = Sampled("1", N_X, TEXT_X)
    period = Parameter("s", text="time between samples, that of A and B", start=STEP, minimum=STEP, maximum=STEP)

    def update(self) -> None:
        self.y = _C @ self.x + _D @ self.u
        self.x = _A @ self.x + _B @ self.u
'''
_GAIN = '''
import numpy as np

from vdfmu.unit import Input, Output, Unit

MATRICES

class NAME(Unit):
    """Matrix of gains, y = D u."""

    u = Input("1", N_U, TEXT_U)
    y = Output("1", N_Y, TEXT_Y)

    def outputs(self) -> None:
        self.y = _D @ self.u
'''
_FUNCTION = '''
from pathlib import Path

import casadi as ca

from vdfmu.unit import IMPORTED

_FUNCTION = ca.Function.load(str(Path(__file__).with_name("FILE")))


class NAME(Unit):
    """CasADi function OF."""

    files = ("FILE",)

DECLARED
'''
_METHOD = """
    def METHOD(self) -> None:
        TARGETS = casadi_call(_FUNCTION, ARGUMENTS)
"""
_TABLE = '''
from pathlib import Path

import numpy as np

from vdfmu.unit import IMPORTED

_TABLE = np.loadtxt(Path(__file__).with_name("FILE"), delimiter=",", skiprows=1)
_X, _Y = _TABLE[:, 0], _TABLE[:, 1:]
_ROWS = np.hstack([_TABLE[:-1], np.diff(_Y, axis=0) / np.diff(_X)[:, None]])
"""Begin, values and slopes of each interval."""


class NAME(Unit):
    """Table over FIRST: linear between the points of FILE, with the first and last values beyond them."""

    files = ("FILE",)

DECLARED

    def outputs(self) -> None:
        x = clip(self.FIRST, _X[0], _X[-1])
        begin, *rest = lookup(x, _X, _ROWS)
        (TARGETS) = (value + (x - begin) * slope for value, slope in zip(rest[:WIDTH], rest[WIDTH:], strict=True))
'''


class Matrices(NamedTuple):
    """``x_dot = A x + B u``, or ``x[k+1] = A x[k] + B u[k]`` with a step `dt` [s]; ``y = C x + D u``."""

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    dt: float | None
    labels: Mapping[str, Sequence[str]]


class DataTable(NamedTuple):
    """The rows of a CSV file: names and units of the columns, and their numbers (m, k)."""

    names: Sequence[str]
    units: Sequence[str]
    rows: Floats


def _filled(text: str, **values: Any) -> str:
    """Return the text with values in the place of names."""
    return re.sub(rf"\b({'|'.join(values)})\b", lambda found: str(values[found[0]]), text).lstrip("\n")


def linear_text(name: str, system: Matrices) -> str:
    """Return the code of a linear system."""
    n, (p, m) = len(system.A), system.D.shape
    kind = _GAIN if not n else _CONTINUOUS if system.dt is None else _DISCRETE
    matrices = [(key, getattr(system, key)) for key in ("ABCD" if n else "D")]
    plain = {"u": "input", "y": "output", "x": "state"} | ({"x": "state of the next sample"} if system.dt else {})
    texts = {f"TEXT_{key.upper()}": repr(list(system.labels.get(key, ())) or text) for key, text in plain.items()}
    constants = "\n".join(f"_{key} = np.array({pformat(matrix.tolist(), width=110)})" for key, matrix in matrices)
    return _filled(kind, MATRICES=constants + "\n", NAME=name, N_U=m, N_Y=p, N_X=n, STEP=repr(system.dt), **texts)


def function_text(name: str, function: ca.Function, file: str) -> str:
    """Return the code of a CasADi function; t, x, p and ode are time, state, parameter and derivative, as in CasADi."""
    given, found = function.name_in(), function.name_out()
    state = "x" in given and "ode" in found
    kinds = {key: "Parameter" if key == "p" else "Input" for key in given if key != "t"}
    kinds |= {key: "Output" for key in found} | ({"x": "State", "ode": "Derivative"} if state else {})
    declared = [
        f"    {key} = Derivative(x)" if kind == "Derivative" else
        f'    {key} = {kind}("1", {shape_of(function.size_in(key) if key in given else function.size_out(key))}, '
        f'"{key} of {function.name()}")'
        for key, kind in kinds.items()
    ]  # fmt: skip
    methods = [
        _filled(
            _METHOD, METHOD=method, ARGUMENTS=", ".join(f"self.{key}" for key in given),
            TARGETS=", ".join(f"self.{key}" if kinds[key] == kind else "_" for key in found),
        )
        for method, kind in (("outputs", "Output"), ("derivatives", "Derivative")) if kind in kinds.values()
    ]  # fmt: skip
    imported = ", ".join([*sorted({*kinds.values(), "Unit"}), "casadi_call"])
    text = _filled(_FUNCTION, IMPORTED=imported, FILE=file, NAME=name, OF=function.name(), DECLARED="\n".join(declared))
    return "\n".join([text, *methods])


def table_text(name: str, table: DataTable, file: str) -> str:
    """Return the code of a table, over time where its first column is ``t`` or ``time``, else over an input."""
    (first, *names), (unit, *units) = table.names, table.units
    timed = first == "t" or first.lower() == "time"
    declared = [] if timed else [f"    {first} = Input({unit!r}, text={first!r})"]
    declared += [f"    {key} = Output({of!r}, text={key!r})" for key, of in zip(names, units, strict=True)]
    return _filled(
        _TABLE, IMPORTED=", ".join([*([] if timed else ["Input"]), "Output", "Unit", "clip", "lookup"]), FILE=file,
        NAME=name, DECLARED="\n".join(declared), FIRST="t" if timed else first,
        TARGETS=", ".join(f"self.{key}" for key in names) + "," * (len(names) == 1), WIDTH=len(names),
    )  # fmt: skip
