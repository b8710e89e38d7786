"""The simulation of a page: the program of its system, sliders, causes of errors, recorded rows, the table of limits.

With this table ``web/verdict.js`` makes the checks of :mod:`vdfmu.study.verdict` that need neither references nor
linearisations.

A run caches the program under the digest of its package, so a page contains only programs of this user. The part that
does not depend on the values of parameters is cached too: runs with other gains have the same module.
"""

from __future__ import annotations

import json
import math
import shlex
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from hashlib import sha256
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.robot.parameters import PARAMETERS, section
from vdfmu.base.arrays import distinct
from vdfmu.base.cache import cache_folder, load, load_or_make, store
from vdfmu.base.errors import VdfmuError
from vdfmu.base.files import digest_of
from vdfmu.base.page import compressed
from vdfmu.base.sources import source_digest
from vdfmu.compiler.unit.interface import Interface
from vdfmu.engine.algorithms import ALGORITHMS
from vdfmu.engine.results.verdict import CUT, LONGEST
from vdfmu.study.limits import LIMITS, Limit, read_limits
from vdfmu.study.report.scripts import base_module, packed
from vdfmu.study.report.shown_run import ShownRun
from vdfmu.study.report.tracks import Names, tracks
from vdfmu.study.run.key_figures import comparable, least_sizes
from vdfmu.study.run.measure import POWER
from vdfmu.study.run.summary import LIMITED, limits_of
from vdfmu.study.verdict import ENERGY_FLOOR, loop_checks, remark_checks
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.scenario.check import motions

ROWS = 100
"""Number of intervals between the recorded rows that the page compares with its own run."""
LIMIT = 1e-9
"""Difference [rad, m] below which the page's own run equals the recorded one; with native FMUs they are
bit-identical."""
_APART = 3.0
"""Factor on the distance caused by a small change, because runs reach their largest distance at different times."""
_UNKNOWN = "Without a reference it is unknown whether single solutions of this loop separate, so that last digits grow."
_SEPARATES = "Single solutions of this loop separate: two runs whose last digits differ diverge after a while."
MOST_VALUES = 20_000_000
"""Largest number of values of a run in a page, 160 MB."""
NOT_MADE = (
    "This page was made without a simulation. 'vdfmu report' with the folder of the run adds it, as do 'vdfmu run' and "
    "simulate=True in Python."
)
MOST_MODULES = 660_000
"""Largest size of a page's compressed modules [characters], which keeps the page below 1 MB."""
LESS = 4
"""Factor by which causes that cannot be removed are reduced. An error proportional to its cause falls to a quarter;
much stiffer drives would take the solver minutes."""


class Slider(NamedTuple):
    """Parameters of a unit that a slider of the page scales."""

    words: str
    model: str
    names: tuple[str, ...]
    least: float = 0.1
    most: float = 10.0
    in_feedforward: bool = False
    """Whether the feedforward also has them and may include the change."""
    gain: bool = False
    """Whether they are gains of a controller, which have a track that shows their margins."""


def _scaled_as(group: str) -> tuple[str, ...]:
    """Return the parameters of a robot that are scaled together."""
    return tuple(name for name, row in PARAMETERS.items() if row.scaled_as == group)


SLIDERS = (
    Slider("Proportional gains", "PDController", ("K_p",), gain=True),
    Slider("Derivative gains", "PDController", ("K_v",), gain=True),
    Slider("Masses and inertias", "Plant", _scaled_as("mass"), 0.5, 2.0, True),
    Slider("Mass of the payload", "Plant", _scaled_as("payload"), 0.0, 3.0, True),
    Slider("Stiffness of the drives", "Plant", _scaled_as("stiffness"), 0.2, 5.0, True),
    Slider("Friction", "Plant", _scaled_as("friction"), 0.0, 3.0, True),
    Slider("Duration of the motion", "Trajectory", ("T",), 0.5, 2.0),
    Slider("Speed of the motion", "", ("speed",), 0.5, 2.0),
)
"""Parameters that the sliders may change, if a system has them; an empty model means any."""
CAUSES: Sequence[tuple[str, tuple[str, ...], Mapping[str, float]]] = (
    ("No friction, and none expected", _scaled_as("friction"), {"value": 0.0}),
    (f"Drives {LESS} times as stiff, and known to be", _scaled_as("stiffness"), {"factor": LESS}),
    ("No kinematic error of the drives", ("theta_err_amplitude",), {"value": 0.0}),
    ("No delay of signals", ("T_d",), {"value": 0.0}),
    ("No jitter and no lost samples", ("T_j", "loss"), {"value": 0.0}),
    ("Encoders of 48 bits", ("bits",), {"value": 48.0}),
    ("No noise", ("sigma",), {"value": 0.0}),
)
"""Causes of errors that the page can remove: the name of the run without the cause; the parameters, of which at least
one is not 0 in some component if the cause is present; and their new ``value`` or a ``factor``."""


def keep_program(system: SystemDescription, package: Path) -> dict[str, Any]:
    """Return the program of a system, or why there is none, and keep it for later pages of its package."""
    place = _kept(package)
    kept = load(place, _read)
    if not system.scenario.inputs and kept is not None and "module" in kept:  # inputs are not in the package
        return kept
    try:
        content = _program_of(system, package) | {"sliders": list(sliders(system))} | facts_of(system)
    except VdfmuError as error:
        content = {"reason": _reason(error)}
    store(place, json.dumps(content).encode())
    return content


def _program_of(system: SystemDescription, package: Path) -> dict[str, Any]:
    """Return the program of a system with its values: that of an equal system with other values, if it is kept."""

    def made() -> bytes:
        from vdfmu.system.program import SystemProgram, page_program  # takes long to import

        return json.dumps(page_program(SystemProgram(system), POWER)).encode()

    program = load_or_make(cache_folder() / "programs" / _structure(system, package), made, json.loads)
    tables = [(table, system.values[name]) for name, table in system.tables.items() if isinstance(table, Interface)]
    starts = [*chain(*(table.memory_of(values).tolist() for table, values in tables))]
    program["memory"][: len(starts)] = starts
    for unit in program["units"]:
        for row in unit["parameters"].values():
            row[1] = program["memory"][row[0]]
    return program


def _structure(system: SystemDescription, package: Path) -> str:
    """Return a digest of all that decides a program except real parameters."""
    with zipfile.ZipFile(package) as archive:
        names = [name for name in archive.namelist() if name.endswith((".ssd", ".ssm", ".fmu"))]
        facts = [(name, sha256(archive.read(name)).hexdigest()) for name in names]
    choices = [
        (name, v.name, system.values[name].get(v.name, v.start))
        for name, table in system.tables.items()
        for v in table
        if v.type != "Real"
    ]
    return sha256(repr((_code(), facts, choices, bool(system.scenario.inputs))).encode()).hexdigest()


def _read(content: bytes) -> dict[str, Any]:
    """Read a program; ValueError for anything else."""
    program = json.loads(content)
    keys = {"module", "steps", "names", "units", "sliders", "arms"}
    if isinstance(program.get("reason"), str) or keys <= program.keys():
        return program
    raise ValueError("no program")


def _code() -> str:
    return source_digest("system.program", "study.report.simulation") + sha256(base_module()).hexdigest()


def _kept(package: Path) -> Path:
    return cache_folder() / "programs" / sha256((_code() + digest_of(package)).encode()).hexdigest()


def _reason(error: VdfmuError) -> str:
    return str(error).splitlines()[0].rstrip(".")


def simulation_of(run: ShownRun, binaries: dict[str, str] | None, command: str = "") -> dict[str, Any]:
    """Return the page's simulation of a scenario's run, ready for JSON; ``{"reason": ..}`` without a simulation.

    The modules of the run are added to `binaries`, digest to base64 of a compressed module. If `binaries` is None, the
    page simulates nothing. `command` repeats the run, and states its end if the user chose it.
    """
    program = run.program
    if program is None and run.package.is_file():
        program = load(_kept(run.package), _read)
    if program is None:
        reason = "this cache has no simulation of it, and a look at a run does not run its code. 'vdfmu run' makes one"
        reason = reason if run.package.is_file() else "its package, system.ssp, is not in the folder of the results"
    elif "reason" in program:
        reason = program["reason"]
    elif (program["steps"] + 1) * len(program["names"]) > MOST_VALUES:
        reason = f"it has {program['steps']} steps of {len(program['names'])} signals, too much for a page"
    elif binaries is None:
        return {"reason": NOT_MADE}
    else:
        modules = {"module": program["module"], "base": compressed(base_module())}
        digests = {key: sha256(module.encode()).hexdigest()[:16] for key, module in modules.items()}
        added = {digests[key]: module for key, module in modules.items()}
        try:
            content = {**program, **digests, **_judged(run, program), **rules_of(run.summary, command)}
        except VdfmuError as error:
            reason = _reason(error)
        else:
            if sum(map(len, (binaries | added).values())) <= MOST_MODULES:
                binaries |= added
                return content
            reason = "with its module the page would be larger than 1 MB; make a page of this run alone"
    return {"reason": f"This run is not simulated here: {reason}."}


def _judged(run: ShownRun, program: Mapping[str, Any]) -> dict[str, Any]:
    """Add the track to each slider; return the causes, and the recorded rows for comparison."""
    sliders: list[dict[str, Any]] = program["sliders"]
    values = {unit["name"]: {name: row[1] for name, row in unit["parameters"].items()} for unit in program["units"]}
    figures: Mapping[str, Any] = run.summary.get("key_figures") or {}
    margin = figures.get("margin", {})
    why = ""
    if "unstable" in figures:  # a place on a limit cycle says little about another gain
        why = "the run itself is unstable"
    elif not margin.get("value", 1.0):
        why = f"the run has none at {margin['at_s']:.3g} s"
    elif "error" in run.summary:
        why = "the run did not reach its end"
    if why:
        along = [None] * len(sliders)
    else:
        span = program["start"], program["stop"], program["step"]
        dry = "excited" not in figures
        along = tracks(run.package, run.summary["algorithm"], sliders, values, span, dry, run.poses)
    for slider, track in zip(sliders, along, strict=True):
        slider["track"] = track
    fast = program["steps"] * len(program["names"]) * LESS <= MOST_VALUES
    return {
        "causes": list(causes(values, sliders, fast)),
        "margin": margin.get("value"),
        "why": why,
        "late": 1.0 / substeps if (substeps := ALGORITHMS[run.summary["algorithm"]].substeps) else 0.0,
        "recorded": _recorded(run, program["names"]),
    }


def causes(parameters: Names, sliders: Sequence[Mapping[str, Any]], fast: bool) -> Iterator[dict[str, Any]]:
    """Yield the causes present in a run, ready for JSON. If `fast`, the page can sample it `LESS` times as often."""
    if fast:
        yield {"words": f"Sampled {LESS} times as often", "split": LESS, "changes": []}
    for words, names, change in CAUSES:
        changes = [
            {"unit": unit, "name": name, **change}
            for unit, values in parameters.items()
            for name in names
            if any(value for each, value in values.items() if each.partition("[")[0] == name)
        ]
        if changes:
            yield {"words": words, "changes": changes}
    for slider in sliders:
        arm = parameters[slider["targets"][0]["unit"]]
        changes = [
            {"unit": target["unit"], "name": name, "value": arm[name]}
            for target in slider["known"]
            for name, value in parameters[target["unit"]].items()
            if name.partition("[")[0] == target["name"] and arm.get(name, value) != value
        ]
        if changes:
            yield {"words": f"{slider['words']} known to the feedforward", "changes": changes}


def values_of(system: SystemDescription) -> dict[str, dict[str, float]]:
    """Return the real parameters of all units by name."""
    return {
        name: {
            v.name: float(system.values[name].get(v.name, v.start))
            for v in table
            if v.causality == "parameter" and v.type == "Real"
        }
        for name, table in system.tables.items()
    }


def sliders(system: SystemDescription) -> Iterator[dict[str, Any]]:
    """Yield groups of parameters that the page may change, ready for JSON, if a member differs from zero."""
    models = {name: table.model_name for name, table in system.tables.items()}
    joined = {(start, end) for (start, _), (end, _) in system.resolved.links()}
    groups: dict[str, dict[str, list[float]]] = {}
    for unit, values in values_of(system).items():
        for name, value in values.items():
            groups.setdefault(unit, {}).setdefault(name.partition("[")[0], []).append(value)
    for slider in SLIDERS:
        targets = {
            unit: names
            for unit, group in groups.items()
            if models[unit] == (slider.model or models[unit])
            and (names := [name for name in slider.names if any(group.get(name, ()))])
        }
        for unit, names in targets.items():
            knowing = [
                name
                for name, model in models.items()
                if slider.in_feedforward and model == "Feedforward" and (len(targets) == 1 or (unit, name) in joined)
            ]
            yield {
                "key": f"{unit}.{names[0]}",
                "words": slider.words if len(targets) == 1 else f"{slider.words}, {unit}",
                "units": [v.unit or "" for v in system.tables[unit] if v.group == names[0]],
                "values": groups[unit][names[0]],
                "targets": [{"unit": unit, "name": name} for name in names],
                "known": [{"unit": other, "name": name} for other in knowing for name in names],
                "least": slider.least,
                "most": slider.most,
                "gain": slider.gain,
            }


def _recorded(run: ShownRun, names: Sequence[str]) -> dict[str, Any]:
    """Return some recorded rows in double precision, and the largest allowed difference of the page's own run."""
    results, summary = run.results, run.summary
    recorded = set(results.names)
    kept = [name for name in names if name in recorded]
    judged = [name for name in kept if name.startswith("plant.q[")] or kept
    rows = distinct(np.linspace(0, len(results) - 1, ROWS + 1).round().astype(int))
    separation = (summary.get("separation") or {}).get("max_position_difference_rad", 0.0)
    return {
        "rows": rows.tolist(),
        "names": kept,
        "values": packed(np.array([results[name][rows] for name in kept]).T, "<f8"),
        "judged": judged,
        "unit": ", ".join(dict.fromkeys(results.units[name] for name in judged)),
        "ended": "error" not in summary,
        "limit": max(LIMIT, _APART * separation),
        "note": _SEPARATES if separation else "",
        "doubt": "" if summary.get("reference") else _UNKNOWN,
    }


def facts_of(system: SystemDescription) -> dict[str, Any]:
    """Return the facts of a system that are needed for its verdict, ready for JSON.

    ``arms``: the limits of motors and stops; ``motions``: start and length [s] of each;
    ``touch``: signals of the wrench at the tool; ``robot``: what errors are compared with, None without a robot.
    """
    scenario = system.scenario
    robot, touch = scenario.robot, scenario.system.fed.get("plant.F_e", "")
    return {
        "arms": [
            {
                "plant": arm.plant,
                "asked": arm.asked,
                "tau_max": arm.tau_max.tolist(),
                "robot": arm.robot
                and {row.name: np.nan_to_num(getattr(arm.robot, row.name)).tolist() for row in section("limits")},
            }
            for arm in limits_of(system)
        ],
        "motions": [
            {"unit": unit, "begin": begin, "length": length} for unit, begin, length in motions(scenario, system.values)
        ],
        "touch": touch,
        "robot": robot
        and {
            "types": list(robot.joint_types),
            "ell": robot.ell.tolist(),
            "least": least_sizes(robot).tolist(),
            "comparable": comparable(robot, scenario.plant_robot),
        },
        "split": any(each is not None and each.friction == "split" for each in system.resolved.robots.values()),
    }


def row_of(row: Limit) -> dict[str, Any]:
    """Return a limit for JSON; ``usual``: the limit of the table, if a user set another."""
    usual = LIMITS[row.key]
    facts = row._asdict() | ({"usual": usual.value} if row.by != usual.by else {})
    return facts if math.isfinite(row.failed) else {key: value for key, value in facts.items() if key != "failed"}


def rules_of(summary: Mapping[str, Any], command: str) -> dict[str, Any]:
    """Return the limits of a run, ready for JSON, and the checks that do not depend on its sliders.

    `command` repeats the run; it shows whether the user chose the run's end.
    """
    limits = LIMITS
    for key, entry in (summary.get("own_limits") or {}).items():
        limits = read_limits({key: entry["value"]}, entry["by"], limits)
    kept = [*remark_checks(summary), *(loop_checks(summary) if "stability" in summary else ())]
    figures: Mapping[str, Any] = summary.get("key_figures") or {}
    return {
        "rows": {key: row_of(row) for key, row in limits.items()},
        "kept": [check.to_dict() for check in kept],
        "figures": {key: figures[key] for key in ("excited", "open") if key in figures},
        "asked": "--stop" in shlex.split(command),
        "command": command,
        "weights": [LIMITS[key].value for key in ("joint", "tool")],
        "limited": LIMITED,
        "floor": ENERGY_FLOOR,
        "longest": LONGEST,
        "cut": CUT.pattern,
    }
