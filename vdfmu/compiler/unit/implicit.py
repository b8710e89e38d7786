"""Symbolic equations that the solver integrates: derivatives or residual, with their linearisation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from vdfmu.compiler.functions.rodas import Stages, StepVectors, permuted, rodas_step, stage_equations
from vdfmu.compiler.functions.traced import traced_function
from vdfmu.compiler.scalar.matrices import factorize, solve_factorized
from vdfmu.compiler.scalar.symbol import from_sx, to_sx
from vdfmu.compiler.unit.base import BaseUnit
from vdfmu.compiler.unit.trace import Symbols, argument_name, run, state_slices


class ImplicitEquations:
    """The right-hand side of a unit and its linearisation, as expressions.

    ``E`` and ``EJ`` are the derivatives of the balance with respect to derivatives and states if the unit has a
    balance, else the identity and the Jacobian. `Ef_t` is E times the derivative along time and the inputs, which
    change at `rates`. `order` is the order of elimination.
    """

    def __init__(self, record: Symbols) -> None:
        unit, where = record.unit, state_slices(record.unit)
        n_x = where[""].stop
        self.inputs = record.symbols
        x = self.x = record.symbol("x", n_x)
        self.x_dot = record.expressions()["x_dot"]
        inputs = [argument_name(name) for name, d in unit.declared.items() if d.causality == "input"]
        read = [name for name in self.inputs if name in inputs]
        self.rates = {name: ca.SX.sym(f"rate_{name}", self.inputs[name].numel()) for name in read}
        moving = [name for name in (*self.rates, "t") if name in self.inputs]
        changing = [self.inputs[name] for name in moving]
        changes = [self.rates.get(name, ca.SX(1)) for name in moving]
        names = elimination_order(unit)
        self.order = np.concatenate([np.arange(where[name].start, where[name].stop) for name in names])
        if type(unit).balance is BaseUnit.balance:
            self.E, self.EJ = ca.SX.eye(n_x), _jacobian(self.x_dot, x)
            self.Ef_t = _along(self.x_dot, changing, changes)
            self._residual = None
        else:
            balance = Symbols(unit, "balance", record.fixed, record)
            x_dot = balance.symbol("x_dot", n_x)
            residual = to_sx(run(unit, "balance", balance))
            at = list(self.inputs.values())
            parts = [_jacobian(residual, x), -_jacobian(residual, x_dot), _along(residual, changing, changes)]
            linear = ca.Function("linear", [x_dot, *at, *self.rates.values()], parts)
            self._residual = ca.Function("residual", [x_dot, *at], [residual])
            E = parts[1]
            if not ca.depends_on(E, x_dot):
                rest, order = from_sx(self._residual(ca.SX(n_x, 1), *at)), self.order
                y = np.empty(n_x, dtype=object)
                y[order] = solve_factorized(factorize(permuted(E, order)), rest[order])
                self.x_dot = to_sx(y)
            self.EJ, self.E, self.Ef_t = linear(self.x_dot, *at, *self.rates.values())

    def step(self, name: str, derivatives: ca.Function) -> ca.Function:
        """One Rodas4 step with inputs linear in time, and its local error relative to the tolerance, by component.

        It calls functions that are traced once: `derivatives`, and others with its name as prefix.
        """
        n_x, h = self.x.numel(), ca.SX.sym("h")
        rates = {f"rate_{key}": rate for key, rate in self.rates.items()}
        stages = stage_equations(h, self.E, self.EJ, self.Ef_t, self.order, n_x, name)
        used = {**self.inputs, **rates, "h": h}
        # the Jacobian shares most of the derivative at the start
        made = {"factors": stages.factors, "x_dot": ca.densify(self.x_dot)}
        started = ca.cse([*made.values()])
        start = ca.Function(f"{name}_start", list(used.values()), started, list(used), list(made))
        if stages.carried:
            derivatives = self._balance(f"{name}_balance", stages)
        elif not derivatives.n_in():  # for constant rates, because CasADi makes no call without arguments
            derivatives = ca.Function(f"{name}_rate", [self.x], [ca.densify(self.x_dot)], ["x"], ["x_dot"])

        sizes = {key: value.numel() for key, value in self.inputs.items()}
        return solver_step(name, sizes, list(self.rates), start, derivatives, stages)

    def _balance(self, name: str, stages: Stages) -> ca.Function:
        """Residual of a stage, or the derivative in explicit rows, as a function of carried unknowns and inputs."""
        assert self._residual is not None
        y = ca.SX.sym("y", len(stages.carried))
        x_dot = ca.SX(self.x.numel(), 1)
        x_dot[stages.carried] = y
        at = {"x_dot_new": y} | self.inputs
        value = self._residual(x_dot, *self.inputs.values()) + stages.explicit * x_dot
        return ca.Function(name, list(at.values()), ca.cse([ca.densify(value)]), list(at), ["value"])

    def jacobian(self, name: str) -> ca.Function:
        """Jacobian of the derivatives with respect to the states."""
        n_x, order = self.x.numel(), self.order
        rows = from_sx(ca.densify(self.EJ)).reshape(n_x, n_x)
        factors = factorize(permuted(self.E, order))
        J = np.empty((n_x, n_x), dtype=object)
        for j in range(n_x):
            J[order, j] = solve_factorized(factors, rows[order, j])
        column = ca.reshape(ca.reshape(to_sx(J), n_x, n_x).T, n_x, n_x)
        return traced_function(name, self.inputs, {"J": column})


def solver_step(
    name: str,
    sizes: Mapping[str, int],
    inputs: Sequence[str],
    start: ca.Function,
    derivatives: ca.Function,
    stages: Stages,
) -> ca.Function:
    """Return the function of a step, see :meth:`ImplicitEquations.step`.

    `sizes` are those of the arguments of the derivatives, of which `inputs` have rates. `start` returns the factors and
    the derivative at the start of the step. `derivatives` is the right-hand side, or the balance if y is carried.
    """
    vectors = StepVectors(name, stages)
    time, rates = vectors.symbol("time"), {key: vectors.symbol(f"rate_{key}", sizes[key]) for key in inputs}
    moving = {key: vectors.symbol(key, size) for key, size in sizes.items() if key in rates or key == "t"}
    later = [value + time * rates.get(key, 1.0) for key, value in moving.items()]
    move = vectors.made("move", [time, *moving.values(), *rates.values()], later) if moving else None

    n_x = sizes["x"]
    x, x_new, error = (vectors.symbol(name, n_x) for name in ("x", "x_new", "error"))
    tolerance = vectors.symbol("tolerance")
    nominal = 1.0  # SI unit of every state
    ratio = error / (tolerance * (nominal + ca.fmax(ca.fabs(x), ca.fabs(x_new))))
    norm = ca.sqrt(ca.sumsqr(ratio) / n_x)
    size = vectors.made("size", [x, x_new, error, tolerance], [norm, ratio])

    arguments = {**sizes, **{f"rate_{key}": sizes[key] for key in inputs}, "h": 1, "tolerance": 1}
    now = {key: ca.MX.sym(key, size) for key, size in arguments.items()}

    def f(x_i: ca.MX, after: ca.MX, *y_i: ca.MX) -> ca.MX:
        moved = move(after, *(now[key] for key in (*moving, *(f"rate_{key}" for key in rates)))) if move else ()
        moved = moved if isinstance(moved, (tuple, list)) else [moved]
        at = now | dict(zip(moving, moved, strict=True)) | {"x": x_i} | dict(zip(["x_dot_new"], y_i, strict=False))
        return derivatives(*(at[key] for key in derivatives.name_in()))

    factors, x_dot = start(*(now[key] for key in start.name_in()))
    x_end, last = rodas_step(f, now["x"], x_dot, now["h"], factors, stages, name)
    results = [x_end, *size(now["x"], x_end, last, now["tolerance"])]
    return ca.Function(name, list(now.values()), results, list(now), ["x_new", "norm", "ratio"])


def elimination_order(unit: BaseUnit) -> list[str]:
    """Return the names of the states in the order of elimination."""
    where = state_slices(unit)
    first = [name for name in type(unit).elimination if name in where]
    return [*first[:-1], *(name for name in where if name not in ("", *first)), *first[-1:]]


def _jacobian(results: ca.SX, arguments: ca.SX) -> ca.SX:
    """Differentiate row by row, in reverse mode. By columns an arm's Jacobian has a sixth more operations."""
    return ca.jacobian(results, arguments, {"helper_options": {"ad_weight": 1.0}})


def _along(expression: ca.SX, changing: list[ca.SX], changes: list[ca.SX]) -> ca.SX:
    if not changing:
        return ca.SX(*expression.shape)
    return ca.jtimes(expression, ca.vertcat(*changing), ca.vertcat(*changes))
