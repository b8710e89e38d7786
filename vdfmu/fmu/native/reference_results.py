"""Reference results inside an FMU, `extra/org.fmi-standard.fmi-ls-ref/`, as the layered standard FMI-LS-REF has them.

They are made without the generated C and without the unit's own solver: the plant by scipy's LSODA at a tolerance
of 1e-12, the other units by the equations in numpy. The inputs are constant between the rows of a table, so that
co-simulation and model exchange have the same solution.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from hashlib import sha256
from typing import Any
from xml.etree.ElementTree import Element, SubElement, register_namespace

import numpy as np
import numpy.typing as npt

from vdfmu.equations.estimator import torque_estimates
from vdfmu.equations.feedforward import Gains, feedforward_inverse, feedforward_vdc
from vdfmu.equations.pd import pd_control
from vdfmu.equations.plant import equilibrium_torque, plant_outputs, split_state
from vdfmu.equations.trajectory import Desired, desired_motion
from vdfmu.fmu.content import Content
from vdfmu.fmu.description import document
from vdfmu.fmu.interface import Interface, start_values
from vdfmu.fmu.layout import Layout
from vdfmu.kernel import Kernel
from vdfmu.kernel.cache import cache_folder, load, store
from vdfmu.kernel.structure import set_parameters
from vdfmu.model import Robot
from vdfmu.model.parameters import SPRING_KEYS

__all__ = ["FOLDER", "reference_files", "reference_results", "stop_time"]

Floats = npt.NDArray[np.float64]
Values = dict[str, Floats]
"""Group to values."""

FOLDER = "extra/org.fmi-standard.fmi-ls-ref"
INTERVALS = 20
"""Intervals of the experiment: the inputs are constant in each, and the results have a row for its end."""
_STOP = {"trajectory": 10.0, "plant": 0.2}
_NAMESPACE = "http://fmi-standard.org/fmi-ls-manifest"
_DESIRED = Desired._fields
_TOLERANCE = 1e-12
_DIGITS = "%.12g"
"""What rounding makes of the last digits differs from one machine to the next."""
_MOST_CALLS = 1_000_000
"""Calls of the right-hand side, ten times what the shipped robots take: with odd values it may find no end."""


def reference_files(content: Content, layout: Layout) -> dict[str, bytes]:
    """Path in the FMU to content: manifest, inputs, results, and a page about them."""
    table, name = layout.table, content.model_name
    stored = _stored(content, table)
    times = [stop_time(table.unit) * k / INTERVALS for k in range(INTERVALS + 1)]
    arrays = content.fmi_version == "3.0"
    files = {f"{FOLDER}/{name}_out.csv": _csv(layout, times, stored["results"], arrays)}
    inputs = stored["inputs"]
    if inputs:
        # every change is a row for the value before it and one for the value after it
        double = [t for t in times for _ in (0, 1)][1:-1]
        held = {group: [row for row in rows for _ in (0, 1)] for group, rows in inputs.items()}
        files[f"{FOLDER}/{name}_in.csv"] = _csv(layout, double, held, arrays)
    files[f"{FOLDER}/fmi-ls-manifest.xml"] = document(_manifest(name, table.unit))
    files["documentation/fmi-ls-ref.txt"] = _page(name, table.unit).encode()
    return files


def stop_time(unit: str) -> float:
    """End of the experiment [s]; it starts at 0."""
    return _STOP.get(unit, 1.0)


def _stimuli(table: Interface) -> dict[str, list[list[float]]]:
    """Return group to the values of the inputs in each interval: smooth motions, sampled."""
    n = table.robot.n
    values = _values(table)
    phase = 0.4 * np.arange(n)
    stop = stop_time(table.unit)
    rows: list[Values] = []
    for t in stop * np.arange(INTERVALS) / INTERVALS:
        if table.unit == "plant":
            rows.append(_plant_inputs(table, values, t))
            continue
        size = 0.05 * (1.0 + np.arange(n) / n)
        desired = desired_motion(t, np.zeros(n), size, 2.0 * stop)
        row = dict(zip(_DESIRED, desired, strict=True))
        row["q"] = row["q_d"] - 1e-4 * np.cos(t + phase)
        row["q_dot"] = row["q_d_dot"] + 1e-3 * np.sin(t + phase)
        row["kappa_dot"] = row["q_d_dot"] + 1e-3 * np.cos(t + phase)
        row["F_e_d"] = _wrench(t)
        row["kappa_dot_d"] = row["q_d_dot"] + 2e-3 * np.sin(2.0 * t + phase)
        row["kappa"] = row["q"] + 1e-3 * np.sin(2.0 * t + phase)
        row["tau"] = 0.1 * np.sin(3.0 * t + phase)
        row["tau_m"] = 0.05 * np.sin(3.0 * t + phase)
        rows.append(row)
    groups = [g for g, where in table.groups.items() if table.variables[where.start].causality == "input"]
    # what the table says to the last digit
    return {group: [[float(_DIGITS % v) for v in row[group]] for row in rows] for group in groups}


def _wrench(t: float) -> Floats:
    return 0.1 * np.sin(2.0 * t + np.arange(6.0))


def _plant_inputs(table: Interface, values: Values, t: float) -> Values:
    """Torques that hold the arm at its start and push it somewhat harder than friction, and a small wrench."""
    robot = _robot(table)
    hold = equilibrium_torque(robot, values["q_0"])
    ramp = np.sin(np.pi * t / stop_time("plant")) ** 2
    push = 1.5 * robot.f_s * ramp * (-1.0) ** np.arange(robot.n)
    return {"tau": (hold + push) / robot.ell, "F_e": _wrench(t)}


def _stored(content: Content, table: Interface) -> dict[str, Any]:
    """Return inputs and results by group, from the cache: they are the same for both versions of FMI."""
    what = {
        "digest": content.digest,
        "unit": table.unit,
        "robot": content.robot.to_dict(),
        "start": start_values(table).tolist(),
    }
    key = sha256(json.dumps(what, sort_keys=True).encode()).hexdigest()
    cached = load(cache_folder() / "reference" / key)
    if cached is not None:
        return json.loads(cached)
    with np.errstate(all="ignore"):
        made = reference_results(table)
    store(cache_folder() / "reference" / key, json.dumps(made).encode())
    return made


def reference_results(table: Interface) -> dict[str, dict[str, list[list[float]]]]:
    """Return ``inputs`` in each interval and ``results`` at the start and at the end of each, by group."""
    inputs = _stimuli(table)
    return {"inputs": inputs, "results": _results(table, inputs)}


def _results(
    table: Interface, inputs: Mapping[str, Sequence[Sequence[float]]]
) -> dict[str, list[list[float]]]:
    """Return the outputs at the end of each interval; before them, those of the initialization."""
    values = _values(table)
    held = [{group: np.array(rows[k]) for group, rows in inputs.items()} for k in range(INTERVALS)]
    if table.unit == "plant":
        rows = list(_plant(table, values, held))
    elif table.unit == "trajectory":
        stop = stop_time(table.unit)
        rows = [_trajectory(values, stop * k / INTERVALS) for k in range(INTERVALS + 1)]
    else:
        calculate = {"feedforward": _feedforward, "controller": _controller, "estimator": _estimator}[
            table.unit
        ]
        rows = [calculate(table, values | row) for row in (held[0], *held)]
    groups = [g for g, where in table.groups.items() if table.variables[where.start].causality == "output"]
    return {group: [np.ravel(row[group]).tolist() for row in rows] for group in groups}


def _trajectory(values: Values, t: float) -> Values:
    T, t_start = float(values["T"][0]), float(values["t_start"][0])
    return desired_motion(t, values["q_start"], values["q_end"], T, t_start)._asdict()


def _feedforward(table: Interface, values: Values) -> Values:
    robot = _robot(table)
    desired = Desired(*(values[group] for group in _DESIRED))
    if values["mode"][0] == 0.0:
        return feedforward_inverse(robot, desired, values["F_e_d"])._asdict()
    gains = Gains(*(values[group] for group in Gains._fields))
    measured = (values[group] for group in ("q", "q_dot", "kappa_dot", "F_e_d"))
    return feedforward_vdc(robot, gains, desired, *measured)._asdict()


def _controller(table: Interface, values: Values) -> Values:
    choice = int(values["velocity"][0])
    velocity_d, velocity = (("kappa_dot_d", "kappa_dot"), ("q_d_dot", "q_dot"), ("q_d_dot", "kappa_dot"))[
        choice
    ]
    names = ("K_p", "K_v", "ell", "tau_max", "q_d", "q", "tau_m")
    given: dict[str, Any] = {name: values[name] for name in names}
    return pd_control(**given, velocity_d=values[velocity_d], velocity=values[velocity])._asdict()


def _estimator(table: Interface, values: Values) -> Values:
    drive = table.robot.with_parameters(**{key: values[key] for key in SPRING_KEYS})
    return torque_estimates(
        drive, *(values[group] for group in ("q", "kappa", "tau", "tau_hat_max"))
    )._asdict()


def _plant(table: Interface, values: Values, held: Sequence[Values]) -> Iterable[Values]:
    from scipy.integrate import solve_ivp  # half a second, and only where nothing is cached

    robot = _robot(table)
    function = Kernel(robot).function("plant_derivative")
    function.args["p"][:] = values["p"]
    x_buffer, x_dot = function.args["x"], function.results["x_dot"]

    calls = 0

    def derivative(_: float, x: Floats) -> Floats:
        nonlocal calls
        calls += 1
        x_buffer[:] = x
        function.run()
        if calls > _MOST_CALLS or not np.isfinite(x_dot).all():
            raise _RunawayError
        return x_dot.copy()

    if values["equilibrium"][0]:
        rotor, springs = values["q_dot_0"], equilibrium_torque(robot, values["q_0"], held[0]["F_e"])
    else:
        rotor, springs = values["kappa_dot_0"], values["tau_s_0"]
    x = np.concatenate([values["q_0"], values["q_dot_0"], rotor, springs])
    hold = stop_time("plant") / INTERVALS
    yield _plant_row(robot, x)
    for row in held:
        for group, value in row.items():
            function.args[group][:] = value
        # an arm that runs away has no result to compare with: from there on the table has no rows
        if np.isfinite(x).all():
            try:
                x = solve_ivp(derivative, (0.0, hold), x, "LSODA", rtol=_TOLERANCE, atol=_TOLERANCE).y[:, -1]
            except _RunawayError:
                x = np.full_like(x, np.nan)
        yield _plant_row(robot, x)


class _RunawayError(ArithmeticError):
    """The motion has no end that can be found."""


def _plant_row(robot: Robot, x: Floats) -> Values:
    return {
        name: np.atleast_1d(np.asarray(value, dtype=float))
        for name, value in (split_state(x)._asdict() | plant_outputs(robot, x)._asdict()).items()
    }


def _robot(table: Interface) -> Robot:
    """Robot with the start values of the unit as its parameters."""
    return set_parameters(table.robot, start_values(table)[table.slice("p")])


def _values(table: Interface) -> Values:
    """Start values by group, and those of the robot's parameters together."""
    start = start_values(table)
    found = {group: start[where] for group, where in table.groups.items()}
    return found | ({"p": start[table.slice("p")]} if table.has_robot else {})


# ------------------------------------------------------------------ files


def _csv(
    layout: Layout, times: Sequence[float], rows: Mapping[str, Sequence[Sequence[float]]], arrays: bool
) -> bytes:
    """Table of variables over time. In FMI 3.0 a cell holds an array, its elements separated by spaces.

    Readers split the head at commas, so variables with a comma in their name are left out.
    """
    columns: list[tuple[str, str, slice]] = []
    for array in layout.arrays:
        group = layout.variables[array.first].group
        if group not in rows:
            continue
        first = array.first - layout.table.groups[group].start
        if arrays:
            columns.append((array.name, group, slice(first, first + array.size)))
        else:
            names = [v.name for v in layout.variables[array.positions]]
            columns += [(name, group, slice(first + i, first + i + 1)) for i, name in enumerate(names)]
    columns = [column for column in columns if "," not in column[0]]
    lines = [",".join(["time", *[name for name, _, _ in columns]])]
    for k, t in enumerate(times):
        cells = [_DIGITS % t]
        cells += [" ".join(_DIGITS % v for v in rows[group][k][where]) for _, group, where in columns]
        if all(np.isfinite(rows[group][k]).all() for _, group, _ in columns):
            lines.append(",".join(cells))
    return ("\n".join(lines) + "\n").encode()


def _manifest(name: str, unit: str) -> Element:
    register_namespace("fmi-ls", _NAMESPACE)
    root = Element(
        "fmiReferences",
        {
            f"{{{_NAMESPACE}}}fmi-ls-name": "org.fmi-standard.fmi-ls-ref",
            f"{{{_NAMESPACE}}}fmi-ls-version": "1.0.0-alpha.1",
            f"{{{_NAMESPACE}}}fmi-ls-description": "Layered Standard providing information on related files "
            "included in an FMU.",
        },
    )

    def add(source: str, kind: str, role: str, description: str) -> None:
        attributes = {"type": kind, "source": source, "role": role, "description": description}
        SubElement(root, "Related", attributes)

    what = f"an experiment of {stop_time(unit):g} s"
    if unit != "trajectory":
        add(f"{name}_in.csv", "text/csv", "testcase", f"Inputs of {what}")
    add(f"{name}_out.csv", "text/csv", "result", f"Outputs of {what}")
    add("../../documentation/fmi-ls-ref.txt", "text/plain", "document", "What the experiment is")
    return root


def _page(name: str, unit: str) -> str:
    hold = f"{stop_time(unit) / INTERVALS:g} s"
    lines = [
        f"Reference results of {name}",
        "",
        f"Start at 0 s, stop at {stop_time(unit):g} s, all parameters at their start values.",
    ]
    if unit != "trajectory":
        lines += [
            f"Inputs: {name}_in.csv. They are constant for {hold} at a time; a change is two rows of the same",
            "time. Co-simulation steps must end where the inputs change.",
        ]
    lines += [
        f"Outputs: {name}_out.csv, at the end of each {hold}, before the inputs change; the first row is that of",
        "the initialization. Variables with a comma in their name are left out in FMI 2.0.",
    ]
    if unit == "plant":
        lines += [
            f"Made by scipy's LSODA at a relative and absolute tolerance of {_TOLERANCE:g}, not by the FMU's solver.",
            "Expect differences of about the parameter `tolerance`, times the size of the variable.",
        ]
    else:
        lines += ["Made by the equations in numpy, not by the FMU. Expect differences of rounding."]
    return "\n".join(lines) + "\n"
