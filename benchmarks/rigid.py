"""Generated rigid-body dynamics against Pinocchio, both called from Python."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from itertools import cycle
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from benchmarks.chains import random_motion, repeated_link
from benchmarks.report import COLOURS, Report, Table, new_figure, tidy
from benchmarks.timing import Case, measure
from vdfmu.arm.kernel import Kernel
from vdfmu.arm.robot import Robot, load_robot

pin: Any = import_module("pinocchio")  # a binary module that no type checker sees into

TITLE = "Generated rigid-body dynamics against Pinocchio, from Python"
_STATES = 64


class Comparison(NamedTuple):
    """Times of one call [s] and the largest relative difference of the results."""

    robot: str
    n: int
    algorithm: str
    run: float
    call: float
    pinocchio: float
    difference: float


def run(report: Report, quick: bool = False) -> None:
    """Measure, tabulate and draw."""
    robots = [load_robot("manipulator_6dof"), repeated_link(6)]
    report.say("timing, in turns")
    found = compare(robots, rounds=20 if quick else 200)
    tabulate(found, report)
    report.save(draw(found))


def pinocchio_model(robot: Robot) -> Any:
    """Model of the same rigid links in Pinocchio."""
    model = pin.Model()
    joint = 0
    for i in range(robot.n):
        kind = pin.JointModelPZ() if robot.joint_types[i] == "prismatic" else pin.JointModelRZ()
        placement = pin.SE3(np.array(robot.rotation[i]), np.array(robot.offset[i]))
        joint = model.addJoint(joint, kind, placement, f"joint_{i + 1}")
        body = pin.Inertia(float(robot.mass[i]), np.array(robot.centroid[i]), np.array(robot.inertia[i]))
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    model.gravity.linear = -np.array(robot.gravity)  # Eq. (62) has g upward
    return model


def compare(robots: list[Robot], rounds: int) -> list[Comparison]:
    """Time inverse and forward dynamics of both libraries on the same random states, all in turns."""
    cases: list[Case] = []
    groups: list[tuple[Robot, str, tuple[Case, Case, Case], float]] = []
    for robot in robots:
        model = pinocchio_model(robot)
        data = model.createData()
        kernel = Kernel(robot)
        for name, theirs in (("inverse_dynamics", pin.rnea), ("forward_dynamics", pin.aba)):
            function = kernel.function(name)
            function.args["p"][:] = kernel.p
            inputs = [function.args[k] for k in list(function.args)[:3]]
            (result,) = function.results.values()
            states = [random_motion(robot.n, seed) for seed in range(_STATES)]

            difference = 0.0
            for state in states:
                for buffer, value in zip(inputs, state, strict=True):
                    buffer[:] = value
                function.run()
                expected = theirs(model, data, *state)
                difference = max(
                    difference, float(np.max(np.abs(result - expected)) / np.max(np.abs(expected)))
                )

            trio = (
                Case(f"{name} run", function.run, function),
                Case(f"{name} call", _caller(function.run, inputs, states), function),
                Case(f"{name} pinocchio", _pinocchio_caller(theirs, model, data, states)),
            )
            cases += trio
            groups.append((robot, name, trio, difference))
    measure(cases, rounds, batch=1e-3)
    return [
        Comparison(robot.name, robot.n, name, ready.best, copied.best, theirs.best, difference)
        for robot, name, (ready, copied, theirs), difference in groups
    ]


def _caller(
    run: Callable[[], None], inputs: list[np.ndarray], states: list[list[np.ndarray]]
) -> Callable[[], None]:
    """Write the next state into the buffers and run: what a caller with arrays of its own pays."""
    following = cycle(states)
    a, b, c = inputs

    def call() -> None:
        a[:], b[:], c[:] = next(following)
        run()

    return call


def _pinocchio_caller(
    function: Callable[..., Any], model: Any, data: Any, states: list[list[np.ndarray]]
) -> Callable[[], None]:
    following = cycle(states)

    def call() -> None:
        a, b, c = next(following)
        function(model, data, a, b, c)

    return call


def tabulate(found: list[Comparison], report: Report) -> None:
    """Show and keep the table and facts."""
    table = Table(
        "rigid",
        f"Rigid-body dynamics from Python, generated code in CasADi's virtual machine; Pinocchio {pin.__version__}",
        [("robot", ""), ("n", "d"), ("algorithm", ""), ("run [us]", ".2f"), ("copy and run [us]", ".2f"),
         ("Pinocchio [us]", ".2f"), ("run / Pin.", ".2f"), ("copy and run / Pin.", ".2f"), ("difference", ".0e")],
    )  # fmt: skip
    for c in found:
        table.add(
            c.robot, c.n, c.algorithm, 1e6 * c.run, 1e6 * c.call, 1e6 * c.pinocchio, c.run / c.pinocchio,
            c.call / c.pinocchio, c.difference,
        )  # fmt: skip
    table.notes += [
        "All times are of calls from Python, least processor time of many samples in turns; Python's call overhead "
        "is in all of them. These ratios say nothing about compiled C, where neither the virtual machine nor the "
        "binding takes part.",
        "run: inputs lie in the function's buffers already, as in the FMUs. copy and run: three arrays of the caller "
        f"are copied in first, from {_STATES} random states in turn; Pinocchio is called on the same arrays.",
        "Pinocchio: rnea against inverse_dynamics, aba against forward_dynamics. Difference: largest, relative to "
        "the largest entry.",
    ]
    report.show(table)
    report.facts["comparisons"] = [c._asdict() for c in found]


def draw(found: list[Comparison]) -> Figure:
    """Bars: the three times of every robot and algorithm."""
    figure = new_figure(7.6, 3.2)
    axes = figure.add_subplot()
    kinds = (("run", "generated: run", "#86b6de"), ("call", "generated: copy and run", COLOURS["blue"]),
             ("pinocchio", "Pinocchio", COLOURS["orange"]))  # fmt: skip
    for i, c in enumerate(found):
        for k, (key, label, colour) in enumerate(kinds):
            value = 1e6 * getattr(c, key)
            y = i + 0.25 * (k - 1)
            axes.barh(y, value, height=0.22, color=colour, label=label if i == 0 else None)
            axes.annotate(
                f"{value:.2f}", (value, y), (3, 0), textcoords="offset points", va="center", fontsize=7.5
            )
    names = {"inverse_dynamics": "inverse", "forward_dynamics": "forward"}
    axes.set_yticks(range(len(found)), [f"{c.robot}\n{names[c.algorithm]}" for c in found])
    axes.invert_yaxis()
    axes.margins(x=0.08)
    axes.set_xlabel("time of one call from Python [µs]")
    tidy(axes, "x")
    axes.tick_params(axis="y", length=0)
    axes.legend(loc="upper right", frameon=False, fontsize=8)
    axes.set_title("inverse and forward dynamics, 6 joints", loc="left")
    return figure
