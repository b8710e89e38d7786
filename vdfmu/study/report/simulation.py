"""The simulation of a page: the program of its system, sliders, recorded rows to compare with.

A run keeps the program in the cache under the digest of its package. So a page runs only programs of this user.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from hashlib import file_digest, sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vdfmu.base.cache import cache_folder, load, store
from vdfmu.base.errors import VdfmuError
from vdfmu.compiler import wasm
from vdfmu.compiler.functions.sources import source_digest
from vdfmu.engine.results.results import Results
from vdfmu.study.report.causes import LESS, causes, scaled_as
from vdfmu.study.report.curves import packed
from vdfmu.study.report.tracks import GOOD, POOR, tracks
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.program import SystemProgram, compressed, page_program

ROWS = 100
"""Intervals between the recorded rows to which the page's own run is compared."""
LIMIT = 1e-9
"""Difference [rad, m] below which the page's own run is the recorded one. Its sin, cos and tanh differ by 1e-15."""
_APART = 3.0
"""Factor on the distance of a run from itself with a small change: both reach the largest distance, at other times."""
_UNKNOWN = (
    "Whether single solutions of this loop separate, whose last digits grow, was not found out: the run has no "
    "reference."
)
_SEPARATES = "Single solutions of this loop separate: two runs whose last digits differ are as far apart after a while."
MOST_VALUES = 20_000_000
"""Values of a run that a page keeps, 160 MB."""
NOT_MADE = (
    "This page has no simulation: 'vdfmu report' with the folder of the run makes one that has, and so do 'vdfmu run' "
    "and simulate=True in Python."
)
"""Shown instead of one."""
MOST_MODULES = 660_000
"""Characters of the compressed modules of a page: they keep it below 1 MB."""


class Knob(NamedTuple):
    """Parameters of a unit that a slider of the page scales."""

    words: str
    model: str
    names: tuple[str, ...]
    least: float = 0.1
    most: float = 10.0
    known: bool = False
    """Whether the feedforward has them too and may know the change."""


KNOBS = (
    Knob("Proportional gains", "PDController", ("K_p",)),
    Knob("Derivative gains", "PDController", ("K_v",)),
    Knob("Masses and inertias of links", "Plant", scaled_as("mass"), 0.5, 2.0, True),
    Knob("Mass of the payload", "Plant", scaled_as("payload"), 0.0, 3.0, True),
    Knob("Stiffness of the drives", "Plant", scaled_as("stiffness"), 0.2, 5.0, True),
    Knob("Friction", "Plant", scaled_as("friction"), 0.0, 3.0, True),
    Knob("Duration of the motion", "Trajectory", ("T",), 0.5, 2.0),
    Knob("Speed of the motion", "", ("speed",), 0.5, 2.0),
)
"""Parameters that the sliders may change, where a system has them; an empty model is any."""


def keep_program(system: SystemDescription, package: Path) -> None:
    """Keep the program of a system for the pages of its package, or why there is none."""
    try:
        content = page_program(SystemProgram(system)) | {"knobs": list(knobs(system))}
    except VdfmuError as error:
        content = {"reason": str(error).splitlines()[0].rstrip(".")}
    store(_kept(package), json.dumps(content).encode())


def _kept(package: Path) -> Path:
    digest = sha256(source_digest("system.program", "study.report.simulation").encode() + wasm.base_module())
    with package.open("rb") as file:
        digest.update(file_digest(file, "sha256").digest())
    return cache_folder() / "programs" / digest.hexdigest()


def simulation_of(
    results: Results, summary: Mapping[str, Any], package: Path, binaries: dict[str, str] | None
) -> dict[str, Any]:
    """Return the page's simulation, ready for JSON; ``{"reason": ..}`` if it has none.

    `binaries`: digest to base64 of a compressed module, to which the run's are added. None: the page is to have none.
    """
    kept = load(_kept(package)) if package.is_file() else None
    if "scenario" not in summary:
        reason = "only runs of scenarios by 'vdfmu run' are"
    elif kept is None:
        reason = "it was not made with this cache, and a look at a run does not run its code"
        reason = reason if package.is_file() else "its package, system.ssp, is not beside the results"
    elif "reason" in (program := json.loads(kept)):
        reason = program["reason"]
    elif (program["steps"] + 1) * len(program["names"]) > MOST_VALUES:
        reason = f"it has {program['steps']} steps of {len(program['names'])} signals, too much for a page"
    elif binaries is None:
        return {"reason": NOT_MADE}
    else:
        modules = {"module": program["module"], "base": compressed(wasm.base_module())}
        digests = {key: sha256(module.encode()).hexdigest()[:16] for key, module in modules.items()}
        added = {digests[key]: module for key, module in modules.items()}
        try:
            found = program | digests | _judged(results, summary, package, program)
        except VdfmuError as error:
            reason = str(error).splitlines()[0].rstrip(".")
        else:
            if sum(map(len, (binaries | added).values())) <= MOST_MODULES:
                binaries |= added
                return found
            reason = "with its module the page would be larger than 1 MB; make a page of this run alone"
    return {"reason": f"This run is not simulated here: {reason}."}


def _judged(results: Results, summary: Mapping[str, Any], package: Path, program: Mapping[str, Any]) -> dict[str, Any]:
    """Give the sliders their tracks; return the causes and the recorded rows to compare with."""
    sliders: list[dict[str, Any]] = program["knobs"]
    values = {unit["name"]: {name: row[1] for name, row in unit["parameters"].items()} for unit in program["units"]}
    figures: Mapping[str, Any] = summary.get("key_figures") or {}
    why = ""
    if "unstable" in figures:  # one place of a limit cycle says little about another gain
        why = "no margins along it: the run itself is unstable"
    margin = figures.get("margin", {})
    if not margin.get("value", 1.0):
        why = f"no margins along it: the run has none at {margin['at_s']:.3g} s"
    span = program["start"], program["stop"], program["step"]
    dry = "without_dry_friction" not in margin
    given = [[None]] * len(sliders) if why else tracks(package, summary["algorithm"], sliders, values, span, dry)
    for slider, found in zip(sliders, given, strict=True):
        slider["tracks"] = found
        slider["why"] = why
    fast = program["steps"] * len(program["names"]) * LESS <= MOST_VALUES
    return {
        "causes": list(causes(values, sliders, fast)),
        "margins": {"good": GOOD, "poor": POOR},
        "recorded": _recorded(results, summary, program["names"]),
    }


def values_of(system: SystemDescription) -> dict[str, dict[str, float]]:
    """Return the real parameters of all units by their names."""
    return {
        name: {
            v.name: float(system.values[name].get(v.name, v.start))
            for v in table
            if v.causality == "parameter" and v.type == "Real"
        }
        for name, table in system.tables.items()
    }


def knobs(system: SystemDescription) -> Iterator[dict[str, Any]]:
    """Yield groups of parameters that the page may change, ready for JSON, if one of a group is not zero."""
    models = {name: table.model_name for name, table in system.tables.items()}
    joined = {(start, end) for (start, _), (end, _) in system.resolved.links()}
    groups: dict[str, dict[str, list[float]]] = {}
    for unit, values in values_of(system).items():
        for name, value in values.items():
            groups.setdefault(unit, {}).setdefault(name.partition("[")[0], []).append(value)
    for knob in KNOBS:
        found = {
            unit: names
            for unit, own in groups.items()
            if models[unit] == (knob.model or models[unit])
            and (names := [name for name in knob.names if any(own.get(name, ()))])
        }
        for unit, names in found.items():
            knowing = [
                name
                for name, other in models.items()
                if knob.known and other == "Feedforward" and (len(found) == 1 or (unit, name) in joined)
            ]
            yield {
                "key": f"{unit}.{names[0]}",
                "words": knob.words if len(found) == 1 else f"{knob.words}, {unit}",
                "units": [v.unit or "" for v in system.tables[unit] if v.group == names[0]],
                "values": groups[unit][names[0]],
                "targets": [{"unit": unit, "name": name} for name in names],
                "known": [{"unit": other, "name": name} for other in knowing for name in names],
                "least": knob.least,
                "most": knob.most,
            }


def _recorded(results: Results, summary: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    """Return some recorded rows, in double precision, and the criterion by which the page's own run is judged."""
    known = set(results.names)
    kept = [name for name in names if name in known]
    judged = [name for name in kept if name.startswith("plant.q[")] or kept
    rows = np.unique(np.linspace(0, len(results) - 1, ROWS + 1).round().astype(int))
    values = np.array([results[name][rows] for name in kept]).T
    separation = (summary.get("separation") or {}).get("max_position_difference_rad", 0.0)
    return {
        "rows": rows.tolist(),
        "names": kept,
        "values": packed(values, "<f8"),
        "judged": judged,
        "unit": ", ".join(dict.fromkeys(results.units[name] for name in judged)),
        "limit": max(LIMIT, _APART * separation),
        "note": _SEPARATES if separation else "",
        "doubt": "" if summary.get("reference") else _UNKNOWN,
    }
