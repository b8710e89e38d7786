"""Make unit classes from a linear system, a CasADi function or a table of data."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from vdfmu.base.arrays import Floats
from vdfmu.base.csv_file import read_columns, repeated
from vdfmu.base.errors import UnitError, UsageError
from vdfmu.compiler.scalar.generic import clip, lookup
from vdfmu.compiler.scalar.symbol import casadi_call, shape_of
from vdfmu.compiler.unit.declaration import Declared, Derivative, Input, Output, Parameter, Sampled, State
from vdfmu.compiler.unit.declaration_check import check_unit
from vdfmu.compiler.unit.place import shown
from vdfmu.compiler.unit.unit import Unit


def linear_unit(
    A: npt.ArrayLike,
    B: npt.ArrayLike,
    C: npt.ArrayLike,
    D: npt.ArrayLike,
    dt: float | None = None,
    *,
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    states: Sequence[str] = (),
    name: str = "LinearUnit",
) -> type[Unit]:
    """Make the unit of a linear system: ``x_dot = A x + B u``, or ``x[k+1] = A x[k] + B u[k]``; ``y = C x + D u``.

    Its variables are ``u`` (m,), ``y`` (p,), ``x`` (n,) and the initial state ``x_0`` (n,), without units of
    measurement.

    Parameters
    ----------
    A, B, C, D : (n, n), (n, m), (p, n), (p, m) array_like
        A system without states, n = 0, is a matrix of gains: ``y = D u``.
    dt : float, optional [s]
        Sample period of a discrete system; None or 0 for continuous time.
    inputs, outputs, states : sequences of str, optional
        Descriptions of the elements.
    name : str, optional
        Name of the class and of its FMU.

    Raises
    ------
    UsageError
        For matrices of inconsistent shapes or without finite real numbers, or for a negative period.
    UnitError
        For a name that a unit cannot have.
    """
    a, b, c, d = _matrices(A, B, C, D)
    if dt is True or not 0.0 <= float(dt or 0.0) < np.inf:
        raise UsageError(f"dt must be the time between samples in s, such as dt=0.001, got {dt}.")
    n, (p, m), period = len(a), d.shape, float(dt or 0.0) if len(a) else 0.0
    output, state = (Sampled, Sampled) if period else (Output, State)
    variables: dict[str, Any] = {
        "u": Input("1", m, list(inputs) or "input"),
        "y": output("1", p, list(outputs) or "output"),
    }
    if n:
        variables["x"] = state("1", n, list(states) or "state")
    if period:
        variables["period"] = Parameter("s", text="time between samples", start=period, minimum=period, maximum=period)
    elif n:
        variables["x_dot"] = Derivative(variables["x"])

    class LinearEquations(Unit):
        u: Any

        def outputs(self) -> None:
            if not period:
                self.y = c @ self.x + d @ self.u if n else d @ self.u

        def derivatives(self) -> None:
            if n and not period:
                self.x_dot = a @ self.x + b @ self.u

        def update(self) -> None:
            if period:
                self.y, self.x = c @ self.x + d @ self.u, a @ self.x + b @ self.u

    law = "x[k+1] = A x[k] + B u[k]" if period else "x_dot = A x + B u"
    text = f"{law}\n    y = C x + D u" if n else "y = D u"
    return _made(LinearEquations, name, variables, f"Linear system.\n\n::\n\n    {text}\n")


def casadi_unit(function: ca.Function, *, name: str = "CasadiUnit") -> type[Unit]:
    """Make the unit class of a CasADi function: variables have its names and shapes, but no units of measurement.

    As in CasADi's integrators, ``x`` and ``ode`` are a state and its derivative, ``p`` a parameter, ``t`` the time.
    Other arguments are inputs, other results outputs.

    Parameters
    ----------
    function : casadi.Function
        A function of scalar operations.
    name : str, optional
        Name of the class and of its FMU.

    Raises
    ------
    UsageError
        For a function that cannot be a unit.
    UnitError
        For names that a unit and its variables cannot have.
    """
    scalar = _scalar(function)
    arguments, results = scalar.name_in(), scalar.name_out()
    moves = "x" in arguments and "ode" in results
    variables: dict[str, Any] = {}
    for key in (key for key in (*arguments, *results) if key != "t"):
        argument = key in arguments
        kind = Parameter if key == "p" else State if key == "x" and moves else Input if argument else Output
        size = scalar.size_in(key) if argument else scalar.size_out(key)
        variables[key] = kind("1", shape_of(size), f"{key} of {function.name()}")
    if moves:
        variables["ode"] = Derivative(variables["x"])

    class Evaluated(Unit):
        def outputs(self) -> None:
            self._set(Output)

        def derivatives(self) -> None:
            self._set(Derivative)

        def _set(self, kind: type[Declared]) -> None:
            values = casadi_call(scalar, *(getattr(self, key) for key in arguments))
            for key, value in zip(results, [values] if len(results) == 1 else values, strict=True):
                if isinstance(self.declared[key], kind):
                    setattr(self, key, value)

    return _made(Evaluated, name, variables, f"CasADi function {function.name()}.")


def table_unit(table: Mapping[str, npt.ArrayLike] | str | Path, *, name: str = "TableUnit") -> type[Unit]:
    """Make the unit class of a table: linear between the rows, constant beyond the first and the last.

    The first column is the input, or the time if it is called ``t`` or ``time``. The other columns are the outputs.

    Parameters
    ----------
    table : mapping of str to (m,) array_like, str or Path
        Columns by name, with their units of measurement in brackets: ``{"T [s]": [0, 20], "R [Ohm]": [1, 1.2]}``;
        or a CSV file with such names in its first line. Its units may also be in the second line. Semicolons, tabs or
        blanks may separate its columns; its numbers may then have decimal commas.
    name : str, optional
        Name of the class and of its FMU.

    Raises
    ------
    UsageError
        For a table without two columns and two rows of numbers, or whose first column does not increase.
    UnitError
        For names and units of measurement that a unit cannot have.
    """
    columns = list(table.items()) if isinstance(table, Mapping) else _columns(Path(table))
    heads = [head.partition("[") for head, _ in columns] or [("", "", "")]
    first, *names = (re.sub(r"\W+", "_", head[0].strip()).strip("_") for head in heads)
    units = [head[2].strip().removesuffix("]") or "1" for head in heads]
    if twice := repeated([first, *names]):
        raise UsageError(f"{twice[0]} must be one column of the table, got more than one. Rename the others.")
    numbers = np.array([values for _, values in columns], float).T
    if not names or len(numbers) < 2 or not np.isfinite(numbers).all():
        raise UsageError("A table must have names, and two columns and two rows of finite numbers.")
    x, y = numbers[:, 0], numbers[:, 1:]
    if (np.diff(x) <= 0.0).any():
        raise UsageError(f"Column {first} must increase from row to row. Sort the rows.")
    rows = np.hstack([numbers[:-1], np.diff(y, axis=0) / np.diff(x)[:, None]])
    timed = first == "t" or first.lower() == "time"

    class Interpolated(Unit):
        def outputs(self) -> None:
            at = clip(self.t if timed else getattr(self, first), x[0], x[-1])
            begin, *rest = lookup(at, x, rows)
            for k, key in enumerate(names):
                setattr(self, key, rest[k] + (at - begin) * rest[len(names) + k])

    variables: dict[str, Declared] = {} if timed else {first: Input(units[0], text=first)}
    variables |= {key: Output(unit, text=key) for key, unit in zip(names, units[1:], strict=True)}
    between = "linear between its rows, constant beyond the first and the last"
    return _made(Interpolated, name, variables, f"Table over {'t' if timed else first}: {between}.")


def _made(base: type[Unit], name: str, variables: Mapping[str, Declared], doc: str) -> type[Unit]:
    """Return a class that belongs to the module that calls a factory."""
    module = sys._getframe(2).f_globals.get("__name__", __name__)  # pyright: ignore[reportPrivateUsage]
    unit: Any = type(name, (base,), {**variables, "__module__": module, "__doc__": doc})
    try:
        check_unit(unit, None)
    except UnitError as error:  # `load_units` adds the line of the call
        raise UnitError(str(error).replace(f"{shown(unit)}: ", "")) from None
    return unit


def _matrices(*arrays: npt.ArrayLike) -> list[npt.NDArray[np.float64]]:
    """Return the matrices A, B, C and D of one system."""
    matrices = [np.atleast_2d(np.asarray(array)) for array in arrays]
    n, (p, m) = len(matrices[0]) if matrices[0].size else 0, matrices[3].shape
    shapes = ((n, n), (n, m), (p, n), (p, m))
    for key, matrix, shape in zip("ABCD", matrices, shapes, strict=True):
        if matrix.dtype.kind not in "iuf" or not np.isfinite(matrix).all():
            raise UsageError(f"{key} must hold finite real numbers.")
        if matrix.shape != shape and matrix.size + np.prod(shape):
            raise UsageError(f"{key} must have shape {shape}, because D has {(p, m)}, got {matrix.shape}.")
    if not matrices[3].size:
        raise UsageError("A linear system must have an input and an output.")
    return [matrix.astype(float).reshape(shape) for matrix, shape in zip(matrices, shapes, strict=True)]


def _scalar(function: ca.Function) -> ca.Function:
    """Return a function of scalar operations only."""
    name = function.name()
    arguments = {key: function.sparsity_in(key) for key in function.name_in()}
    results = {key: function.sparsity_out(key) for key in function.name_out()}
    for key, sparsity in (arguments | results).items():
        if not sparsity.numel() or (key in arguments and not sparsity.is_dense()):
            kind = "sparse" if sparsity.numel() else "empty"
            raise UsageError(f"{name}: {key} must be dense, got a matrix that is {kind}.")
    if "alg" in results:
        raise UsageError(f"{name} must not have the algebraic equations alg. Solve for z, or use only ode.")
    if "x" in arguments and "ode" in results and (x := arguments["x"].shape) != (ode := results["ode"].shape):
        raise UsageError(f"{name}: ode must have the shape of x, {x}, got {ode}.")
    try:
        scalar = function.expand()
    except RuntimeError:
        scalar = None
    if scalar is None or ca.OP_CALL in map(scalar.instruction_id, range(scalar.n_instructions())):
        raise UsageError(f"{name} must use only scalar operations, for C. Replace its solver or interpolant.")
    return scalar


def _columns(path: Path) -> list[tuple[str, Floats]]:
    """Return the names, with units in brackets, and the numbers of the columns of a CSV file."""
    columns = read_columns(path)
    file, heads = columns.file, columns.file.headings
    if columns.faults:
        raise UsageError("\n".join(f"{fault[:1].upper()}{fault[1:]}." for fault in columns.faults))
    if file.unit_row:
        heads = [f"{head}[{unit}]" for head, unit in zip(heads, file.units, strict=False)]
    return list(zip(heads, columns.values.T, strict=False))
