"""Describes the system of a run: its values, the kind of its FMUs, its limits, and the facts for its summary."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from vdfmu.base.errors import LOG, UsageError
from vdfmu.base.platforms import compiler_version
from vdfmu.base.standards import PYTHON_FMI
from vdfmu.compiler.fmu.build import build_notes, choose_backend
from vdfmu.engine.package.system import ends_of
from vdfmu.engine.run import LogMessage
from vdfmu.study.expected import Expected, read_expected
from vdfmu.study.judgement import check_wanted
from vdfmu.study.limits import OF_SCENARIO, Limit, own_limits, read_limits
from vdfmu.study.options import ScenarioRunOptions
from vdfmu.study.run.prepare import connection_table
from vdfmu.study.run.scene import arm_of, scene_of
from vdfmu.study.run.summary import ArmLimits, limits_of, run_facts
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.scenario import Scenario
from vdfmu.system.scenario.check import model_notes, remarks
from vdfmu.system.scenario.values import system_values

_CONNECTIONS = 12
"""Most connections of replaced components that a run prints."""
_LEFT_OUT = "dropped: the replacement has no signal of that name"
_JOINED = "connected automatically: the only output that fits by name, terminal, shape and unit of measurement"


class RunCase(NamedTuple):
    """A prepared scenario with the options of its run: everything that later stages read."""

    scenario: Scenario
    options: ScenarioRunOptions
    system: SystemDescription
    backend: str
    """Kind of the FMUs."""
    limits: Mapping[str, Limit]
    """Limits of the verdict by name."""
    arm_limits: list[ArmLimits]
    expected: Expected | None
    """Recorded results that the run must match."""
    facts: dict[str, Any]
    """Entries of the summary that are set before the run."""
    parameters: Mapping[str, Any] = MappingProxyType({})
    """Values, by ``component.variable``, that are not in the package of the run."""

    @property
    def written(self) -> bool:
        """Whether the run writes files."""
        return self.options["out"] is not False


def describe(scenario: Scenario, options: ScenarioRunOptions) -> RunCase:
    """Return the case of a scenario of :func:`vdfmu.study.run.prepare.prepare`, with notes in the log.

    Raises
    ------
    UsageError, ModelError
        For values, limits or options that do not fit the system.
    """
    if options["judge"] is not None or options["sampled"] is not None:
        check_wanted(options["judge"], options["sampled"], scenario.adaptive)
    until = options["reference_stop"]
    if until is not None and not options["reference"]:
        raise UsageError("reference_stop needs the references. Leave it out, or give --reference.")
    if until is not None and not scenario.step <= until < math.inf:
        raise UsageError(f"reference_stop must be finite and at least one step, {scenario.step:g} s, got {until:g}.")
    expected = None
    if options["expect"] is not None or options["within"] is not None:
        expected = read_expected(options["expect"], options["within"])
    native = options["backend"] is None and options["fmi_version"] != PYTHON_FMI.name
    backend = choose_backend("native" if native else options["backend"])
    system = SystemDescription(scenario, system_values(scenario, options["parameters"]))
    if options["units"] and not LOG.isEnabledFor(logging.INFO):  # else `prepare` has written all of them
        note(options, connection_table(scenario, options["units"], _CONNECTIONS), "connections")
    for text in _notes(scenario, options, backend):
        note(options, text)
    of_file = read_limits(scenario.limits, OF_SCENARIO)
    limits = read_limits(options["limits"] or {}, "--limit", of_file)
    facts = _facts(system, options, backend, limits)
    return RunCase(scenario, options, system, backend, limits, limits_of(system), expected, facts)


def note(options: ScenarioRunOptions, text: str, status: str = "note") -> None:
    """Write a note, or a table of connections, to the log of a run."""
    if (log := options["log"]) is not None:
        log(LogMessage("", 0.0, status, "", text))


def _notes(scenario: Scenario, options: ScenarioRunOptions, backend: str) -> Iterator[str]:
    robot, parameters = scenario.robot, options["parameters"]
    yield from (f"{connection}: {_LEFT_OUT}" for connection in scenario.system.dropped)
    yield from (f"{connection}: {_JOINED}" for connection in scenario.system.joined)
    for text in (*model_notes(scenario, parameters), *build_notes(robot, backend)):
        yield f"{(robot or scenario).name}: {text}"


def _facts(
    system: SystemDescription, options: ScenarioRunOptions, backend: str, limits: Mapping[str, Limit]
) -> dict[str, Any]:
    scenario, parameters = system.scenario, options["parameters"]
    robot, connected = scenario.robot, ends_of(options["connections"] or ())
    return run_facts(scenario) | {
        "backend": backend,
        **({"compiler": compiler_version()} if backend == "native" else {}),
        "fmi": options["fmi_version"],
        "parameters": {key: str(value) for key, value in (parameters or {}).items()},
        "units": {name: str(unit) for name, unit in (options["units"] or {}).items()},
        **({"connections": [" -> ".join(ends) for ends in connected]} if connected else {}),
        "left_out": list(scenario.system.dropped),
        "joined": list(scenario.system.joined),
        **({"own_limits": changed} if (changed := own_limits(limits)) else {}),
        **remarks(scenario, parameters, system.values, options["stop"] is not None),
        **({} if robot is None else {"arm": arm_of(robot, system.values.get("plant", {}))}),
        "scene": scene_of(system),
    }
