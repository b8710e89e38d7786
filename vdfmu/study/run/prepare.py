"""Load a scenario and apply options to it: the first stage of a run."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterable
from typing import Unpack

from vdfmu.arm.robot import load_robot
from vdfmu.base.errors import UsageError
from vdfmu.base.option import pick, with_options
from vdfmu.engine.algorithms import ALGORITHMS, choice
from vdfmu.engine.options import CouplingOptions
from vdfmu.engine.plan.grid import count_steps
from vdfmu.engine.plan.inputs import read_inputs
from vdfmu.engine.run import check_coupling
from vdfmu.study.analysis.reach import scenario_of
from vdfmu.study.options import ScenarioOptions
from vdfmu.system.scenario import Scenario
from vdfmu.system.scenario.replace import with_units


@with_options
def prepare(
    scenario: Scenario | str | os.PathLike[str], names: Iterable[str] = (), **options: Unpack[ScenarioOptions]
) -> Scenario:
    """Load a scenario and apply options to it, with the checks of a scenario file.

    Names in `parameters`, and `names`, will be set later: the robot gets parameters for them, see `with_parameters`.

    Raises
    ------
    UsageError, ModelError
        For an unknown name, a bad file or options that do not fit together.
    """
    changes = {name: value for name, value in options.items() if value is not None}
    robot = options["robot"]
    if isinstance(robot, (str, os.PathLike)):
        robot = load_robot(robot)
    if robot is not None and isinstance(scenario, Scenario):
        raise UsageError("robot: give it with the name or path of a scenario, not with a loaded one.")
    scenario = scenario_of(scenario, robot, [*names, *(options["parameters"] or ())])
    if options["units"] or options["connections"]:
        scenario = with_units(scenario, options["units"] or {}, options["connections"] or ())
    fields = {field.name for field in dataclasses.fields(Scenario)} - {"robot"}
    scenario = dataclasses.replace(scenario, **{name: changes[name] for name in fields & changes.keys()})
    tables = read_inputs(scenario.inputs, scenario.input_hold)
    more = pick(CouplingOptions, {name: changes[name] for name in changes.keys() - fields})
    scenario = dataclasses.replace(scenario, inputs=tables, options={**scenario.options, **more})
    if scenario.algorithm not in ALGORITHMS:
        ALGORITHMS.names()  # so that the choice has those of other packages
        raise UsageError(f"algorithm: expected {choice()}, got {scenario.algorithm!r}.")
    check_coupling(scenario.algorithm, scenario.adaptive)
    count_steps(scenario.step, scenario.stop)
    return scenario
