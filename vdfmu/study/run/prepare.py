"""Loads a scenario and applies options to it: the first stage of a run."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Unpack

from vdfmu.arm.robot import Robot, load_robot
from vdfmu.base.errors import LOG, UsageError
from vdfmu.base.extras import module_of_extra
from vdfmu.base.option import pick, with_options
from vdfmu.engine.algorithms import ALGORITHMS, choice
from vdfmu.engine.options import CouplingOptions
from vdfmu.engine.package.system import ends_of
from vdfmu.engine.plan.check import check_coupling
from vdfmu.engine.plan.grid import count_steps
from vdfmu.engine.plan.inputs import read_inputs
from vdfmu.study.options import ScenarioOptions
from vdfmu.system.scenario import Scenario, load_scenario
from vdfmu.system.scenario.check import unfed_inputs
from vdfmu.system.scenario.replace import with_parameters, with_units


def scenario_of(
    source: Scenario | str | os.PathLike[str], robot: Robot | str | None = None, names: Iterable[str] = ()
) -> Scenario:
    """Load a scenario by name or file, or make ``reach`` for a robot.

    The robot gets the parameters that these `names` need; see `with_parameters`.
    """
    if source == "reach" and not Path("reach").exists():
        source = module_of_extra("reach", "robots", "The scenario reach").reach_scenario(robot)
    return with_parameters(source if isinstance(source, Scenario) else load_scenario(source, robot), names)


@with_options
def prepare(
    scenario: Scenario | str | os.PathLike[str], names: Iterable[str] = (), **options: Unpack[ScenarioOptions]
) -> Scenario:
    """Load a scenario and apply options to it, with the checks of a scenario file.

    Names in `parameters`, and `names`, will be set later, so the robot gets parameters for them; see `with_parameters`.

    Raises
    ------
    UsageError, ModelError
        For an unknown name, a faulty file or inconsistent options.
    """
    changes = {name: value for name, value in options.items() if value is not None}
    robot = options["robot"]
    if isinstance(robot, (str, os.PathLike)):
        robot = load_robot(robot)
    if robot is not None and isinstance(scenario, Scenario):
        raise UsageError("robot: can only be given with the name or path of a scenario, not with a loaded one.")
    scenario = scenario_of(scenario, robot, [*names, *(options["parameters"] or ())])
    if options["units"] or options["connections"]:
        scenario = with_units(scenario, options["units"] or {}, options["connections"] or ())
    fields = {field.name for field in dataclasses.fields(Scenario)} - {"robot"}
    scenario = dataclasses.replace(scenario, **{name: changes[name] for name in fields & changes.keys()})
    tables = read_inputs(scenario.inputs, scenario.input_hold)
    more = pick(CouplingOptions, {name: changes[name] for name in changes.keys() - fields})
    scenario = dataclasses.replace(scenario, inputs=tables, options={**scenario.options, **more})
    if options["unfed"] not in (None, "ok"):
        raise UsageError(f"unfed: expected ok, got {options['unfed']}.")
    if options["units"]:
        LOG.info("%s", connection_table(scenario, options["units"]))
        _require_fed(scenario, [*names, *(options["parameters"] or ())], options["unfed"])
    if scenario.algorithm not in ALGORITHMS:
        ALGORITHMS.names()  # so that the choice includes those of other packages
        raise UsageError(f"algorithm: expected {choice()}, got {scenario.algorithm!r}.")
    check_coupling(scenario.algorithm, scenario.adaptive)
    count_steps(scenario.step, scenario.stop)
    return scenario


def connection_table(scenario: Scenario, components: Iterable[str], most: int | None = None) -> str:
    """Return the connections of components as a table of at most `most` rows, those made automatically first."""
    rows = [
        link
        for link in ends_of(scenario.system.connections)
        if any(end.partition(".")[0] in components for end in link)
    ]
    rows.sort(key=lambda link: " -> ".join(link) not in scenario.system.joined)
    shown = rows[:most]
    width = max((len(source) for source, _ in shown), default=0)
    lines = [f"connections of {', '.join(components)}:", *(f"  {a:<{width}} -> {b}" for a, b in shown)]
    more = [f"  and {len(rows) - len(shown)} more, see system.ssp or --verbose"] if shown != rows else []
    return "\n".join([*lines, *more])


def _require_fed(scenario: Scenario, names: Iterable[str], allowed: str | None) -> None:
    """Raise UsageError for unconnected inputs, unless they are among the `names` that are set.

    Inputs of a plant, such as a wrench at its tool, may keep their start values, unless a replacement lacks the output
    that fed them.
    """
    lost = {link.partition(" -> ")[2] for link in scenario.system.dropped}
    lines: list[str] = []
    for end in unfed_inputs(scenario, names):
        if allowed is None and (end.partition(".")[0] not in scenario.resolved.plants or end in lost):
            fitting = " or ".join(scenario.system.unfed.get(end, ()))
            such = f", such as {fitting}" if fitting else ""
            ways = f"--connect OUTPUT={end} connects it, --set {end}=VALUE sets it, --unfed ok keeps its start value."
            lines.append(f"{end}: expected a connected output{such}, got none. {ways}")
    if lines:
        raise UsageError("\n".join(lines))
