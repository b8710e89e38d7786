"""What limits a scenario: the error of its tool, again and again with one cause changed, as its page finds it."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, Unpack

import numpy as np

from vdfmu.base.errors import CosimError, UsageError
from vdfmu.base.once import one_job
from vdfmu.base.option import pick, with_options
from vdfmu.base.progress import counted, with_progress
from vdfmu.engine.options import SimulatorOptions
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.plan.check import check_system
from vdfmu.engine.run import Simulator
from vdfmu.study.analysis.system import packaged
from vdfmu.study.options import ErrorBudgetOptions, ScenarioOptions
from vdfmu.study.report.causes import Names, causes
from vdfmu.study.report.simulation import knobs, values_of
from vdfmu.study.run.key_figures import same_frames, tool_errors
from vdfmu.study.run.scenario_run import prepare
from vdfmu.system.scenario import Scenario
from vdfmu.system.scenario.values import robot_with

_SIGNALS = ("trajectory.q_d", "plant.q")


class ErrorLeft(NamedTuple):
    """Error of the tool of a run with one cause of it changed."""

    cause: str
    """The change in words."""
    largest: float
    rms: float
    """Of the distance of the tool from where it should be [m]; NaN for a run that failed."""
    failed: str = ""
    """Why it failed."""


@with_progress
@one_job()
@with_options
def error_budget(scenario: Scenario | str | os.PathLike[str], **options: Unpack[ErrorBudgetOptions]) -> list[ErrorLeft]:
    """Run a scenario as it is, then with one cause of its error changed at a time.

    The smaller the error then, the more it is due to this cause: sampling, friction, the springs of the drives, delay,
    noise, encoders, and what the feedforward does not know, as far as the scenario has them.

    Parameters
    ----------
    scenario : Scenario, str or path
        Loaded, or the name of a shipped one, or a file; its arm follows a motion.
    **options
        :class:`vdfmu.study.options.ErrorBudgetOptions`.

    Returns
    -------
    list of ErrorLeft
        The first is the scenario as it is.

    Raises
    ------
    UsageError, ModelError, SspError, CosimError
        See :func:`vdfmu.run`; UsageError also for a scenario without the signals of an arm that follows a motion.

    Examples
    --------
    >>> for row in vdfmu.error_budget("tracking"):
    ...     print(f"{row.cause}: {1e6 * row.largest:.2f} um")
    """
    loaded = prepare(scenario, **pick(ScenarioOptions, options))
    with packaged(loaded, options["settings"], options["backend"]) as (package, _):
        return list(_rows(loaded, package))


def _rows(scenario: Scenario, package: Any) -> Iterator[ErrorLeft]:
    checked = check_system(load_ssp(package), inputs=scenario.inputs, algorithm=scenario.master)
    groups = {f"{name}.{v.group}" for name, table in scenario.resolved.tables.items() for v in table}
    if scenario.robot is None or not groups.issuperset(_SIGNALS):
        raise UsageError(f"{scenario.name}: expected an arm that follows a motion, with {' and '.join(_SIGNALS)}.")
    if not same_frames(scenario.arm, robot_with(scenario.plant_robot, values_of(checked).get("plant", {}))):
        raise UsageError(
            f"{scenario.name}: expected a plant with the geometry of {scenario.arm.name}, by which the tool's place "
            "is known. Leave offset and tool_offset as they are."
        )
    values = values_of(checked)
    changed: list[dict[str, Any]] = [{"words": "As it is", "changes": []}]
    changed += causes(values, list(knobs(checked)), checked.how.substeps > 0)
    options: SimulatorOptions = {**scenario.coupling, "inputs": scenario.inputs, "isolate": False}
    with Simulator(package, **options) as simulator:
        for k, cause in enumerate(counted("causes", changed, len(changed))):
            try:
                results = simulator.run(
                    start=0.0, stop=scenario.stop, step=scenario.step / cause.get("split", 1),
                    parameters=_parameters(values, cause["changes"]), record=[f"{name}[*]" for name in _SIGNALS],
                )  # fmt: skip
            except CosimError as error:
                if not k:
                    raise
                yield ErrorLeft(cause["words"], math.nan, math.nan, str(error))
                continue
            errors = tool_errors(scenario.arm, results)
            yield ErrorLeft(cause["words"], float(errors.max()), float(np.sqrt(np.mean(errors**2))))


def _parameters(values: Names, changes: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return changed parameters by ``component.variable``; a name without an index means all elements."""
    return {
        f"{one['unit']}.{name}": one["value"] if "value" in one else one["factor"] * value
        for one in changes
        for name, value in values[one["unit"]].items()
        if one["name"] in (name, name.partition("[")[0])
    }
