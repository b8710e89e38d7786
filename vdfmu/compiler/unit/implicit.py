"""Symbolic equations that the solver integrates: derivatives or residual, with their linearisation."""

from __future__ import annotations

import casadi as ca
import numpy as np
import numpy.typing as npt

from vdfmu.compiler.functions.rodas import Stages, permuted, rodas_step, stage_equations
from vdfmu.compiler.functions.traced import traced_function
from vdfmu.compiler.scalar.generic import cutting
from vdfmu.compiler.scalar.matrices import factorize, solve_factorized
from vdfmu.compiler.scalar.symbol import from_sx, to_sx
from vdfmu.compiler.unit.base import BaseUnit
from vdfmu.compiler.unit.trace import Symbols, argument_name, run, state_slices


class ImplicitEquations:
    """The right-hand side of a unit and its linearisation, as expressions.

    ``E`` and ``EJ`` are the derivatives of the balance with respect to derivatives and states, if the unit has one;
    else the identity and the Jacobian. `Ef_t` is E times the derivative along inputs that change at `rates`, and time.
    With `cut` and a long chain, rows and columns of arguments of ``cut`` come after the states'; E is 0 in these
    columns. `order` is the order of elimination.
    """

    def __init__(self, record: Symbols, cut: bool = False) -> None:
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
        first = [name for name in type(unit).elimination if name in where]
        names = [*first[:-1], *(name for name in where if name not in ("", *first)), *first[-1:]]
        self.order = np.concatenate([np.arange(where[name].start, where[name].stop) for name in names])
        if type(unit).balance is BaseUnit.balance:
            self.E, self.EJ = ca.SX.eye(n_x), _jacobian(self.x_dot, x)
            self.Ef_t = _along(self.x_dot, changing, changes)
            self._residual = None
        else:
            balance = Symbols(unit, "balance", record.fixed, record)
            x_dot = balance.symbol("x_dot", n_x)
            long = cut and unit.chain is not None and unit.n >= unit.chain
            with cutting(balance.cut if long else None):
                residual = to_sx(run(unit, "balance", balance))
            cuts = balance.cuts
            unknown = x
            if cuts:
                residual = ca.vertcat(residual, *[value - symbols for _, symbols, value in cuts])
                unknown = ca.vertcat(x, *[symbols for _, symbols, _ in cuts])
                self.order = _along_chain([where[name].start for name in names], unit.n, n_x, cuts)
            at = list(self.inputs.values())
            parts = [
                _jacobian(residual, unknown),
                -ca.horzcat(_jacobian(residual, x_dot), ca.SX(residual.numel(), unknown.numel() - n_x)),
                _along(residual, changing, changes),
                residual[:n_x],
            ]
            if cuts:
                _, symbols, values = zip(*cuts, strict=True)
                _, parts = ca.substitute_inplace(list(symbols), list(values), parts, False)
            linear = ca.Function("linear", [x_dot, *at, *self.rates.values()], parts[:3])
            self._residual = ca.Function("residual", [x_dot, *at], parts[3:])
            E = parts[1]
            if not cuts and not ca.depends_on(E, x_dot):
                rest, order = from_sx(self._residual(ca.SX(n_x, 1), *at)), self.order
                y = np.empty(n_x, dtype=object)
                y[order] = solve_factorized(factorize(permuted(E, order)), rest[order])
                self.x_dot = to_sx(y)
            self.EJ, self.E, self.Ef_t = linear(self.x_dot, *at, *self.rates.values())

    def step(self, name: str, derivatives: ca.Function) -> ca.Function:
        """One Rodas4 step, inputs linear in time, and its local error relative to the tolerance, by component.

        It calls functions that are traced once: `derivatives`, and further ones with its name as prefix.
        """
        n_x, (h, tolerance, time) = self.x.numel(), map(ca.SX.sym, ("h", "tolerance", "time"))
        rates = {f"rate_{key}": rate for key, rate in self.rates.items()}
        stages = stage_equations(h, self.E, self.EJ, self.Ef_t, self.order, n_x, name)
        used = {**self.inputs, **rates, "h": h}
        # the Jacobian needs most of the derivative at the start
        made = {"factors": stages.factors, "x_dot": ca.densify(self.x_dot)}
        started = ca.cse([*made.values()])
        start = ca.Function(f"{name}_start", list(used.values()), started, list(used), list(made))
        if stages.carried:
            derivatives = self._balance(f"{name}_balance", stages)
        elif not derivatives.n_in():  # constant rates: CasADi makes no call without arguments
            derivatives = ca.Function(f"{name}_rate", [self.x], [ca.densify(self.x_dot)], ["x"], ["x_dot"])

        moving = {key: value for key, value in self.inputs.items() if key in self.rates or key == "t"}
        later = [value + time * self.rates.get(key, 1.0) for key, value in moving.items()]
        move = ca.Function(f"{name}_move", [time, *moving.values(), *self.rates.values()], later)

        x, x_new, error = (ca.SX.sym(name, n_x) for name in ("x", "x_new", "error"))
        nominal = 1.0  # SI unit, of every state
        ratio = error / (tolerance * (nominal + ca.fmax(ca.fabs(x), ca.fabs(x_new))))
        norm = ca.sqrt(ca.sumsqr(ratio) / n_x)
        size = ca.Function(f"{name}_size", [x, x_new, error, tolerance], ca.cse([norm, ratio]))

        arguments = self.inputs | rates | {"h": h, "tolerance": tolerance}
        now = {key: ca.MX.sym(key, value.numel()) for key, value in arguments.items()}

        def f(x_i: ca.MX, after: ca.MX, *y_i: ca.MX) -> ca.MX:
            moved = move.call([after, *(now[key] for key in (*moving, *rates))]) if moving else []
            at = now | dict(zip(moving, moved, strict=True)) | {"x": x_i} | dict(zip(["x_dot_new"], y_i, strict=False))
            return derivatives(*(at[key] for key in derivatives.name_in()))

        factors, x_dot = start(*(now[key] for key in start.name_in()))
        x_end, last = rodas_step(f, now["x"], x_dot, now["h"], factors, stages, name)
        results = [x_end, *size(now["x"], x_end, last, now["tolerance"])]
        return ca.Function(name, list(now.values()), results, list(now), ["x_new", "norm", "ratio"])

    def _balance(self, name: str, stages: Stages) -> ca.Function:
        """Residual of a stage, in explicit rows the derivative, as a function of carried unknowns and inputs."""
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


def _along_chain(states: list[int], n: int, n_x: int, cuts: list[tuple[int, ca.SX, ca.SX]]) -> npt.NDArray[np.int_]:
    """Order of elimination from the last joint to the first: states, cuts from the last to the first, the last state.

    `states` are places of the first joint's states, `n` and `n_x` numbers of joints and states. Unknowns of `cuts`, see
    :class:`Symbols`, come after the states.
    """
    ends = n_x + np.cumsum([symbols.numel() for _, symbols, _ in cuts])
    order: list[int] = []
    for i in reversed(range(n)):
        order += [start + i for start in states[:-1]]
        for (joint, symbols, _), end in reversed(list(zip(cuts, ends, strict=True))):
            order += range(end - symbols.numel(), end) if joint == i else ()
        order.append(states[-1] + i)
    return np.array(order)


def _jacobian(results: ca.SX, arguments: ca.SX) -> ca.SX:
    """Differentiate row by row, in reverse. By columns the Jacobian of an arm has a sixth more operations."""
    return ca.jacobian(results, arguments, {"helper_options": {"ad_weight": 1.0}})


def _along(expression: ca.SX, changing: list[ca.SX], changes: list[ca.SX]) -> ca.SX:
    if not changing:
        return ca.SX(*expression.shape)
    return ca.jtimes(expression, ca.vertcat(*changing), ca.vertcat(*changes))
