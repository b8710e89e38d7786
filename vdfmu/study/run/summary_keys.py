"""The keys of ``summary.json``, the meaning and content of each, whoever writes it, and its reader."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from vdfmu.base.errors import UsageError
from vdfmu.base.text import elided
from vdfmu.base.version import format_problem
from vdfmu.engine.results.formats import result_files
from vdfmu.engine.results.verdict import STATES

Summary = Mapping[str, Any]
"""Content of ``summary.json``."""


@dataclass(frozen=True)
class List:
    """A list, with an entry a joint if `joints`, or with `size` entries."""

    of: Any
    joints: bool = False
    size: int | None = None


@dataclass(frozen=True)
class Record:
    """A table that has the keys of `of`, may have those of `also`, and others."""

    of: Mapping[str, Any]
    also: Mapping[str, Any] = field(default_factory=dict[str, Any])


@dataclass(frozen=True)
class Keyed:
    """A table whose keys are names."""

    of: Any


class Key(NamedTuple):
    """A key: the type of its value, a tuple for one of some texts, a mapping for a table of any keys; its meaning."""

    of: Any
    text: str


NUMBER, WHOLE, TEXT, FLAG, ANY = "a number", "a whole number", "a text", "true or false", "anything"
_JOINTS, _UNITS, _VECTOR, _LINES = List(NUMBER, True), List(TEXT, True), List(NUMBER), List(TEXT)
_PLACE = List(NUMBER, size=3)
_TURN = List(_PLACE, size=3)
SPRINGS = ("rms_spring_torque_nm", "rms_tau_s_hat_error_nm", "rms_tau_f_hat_error_nm")
TRACKING = ("rms_position_error_deg", "max_position_error_deg", "rms_torque_compensation_error_nm")
TOGETHER = (TRACKING, SPRINGS)
"""Keys of which a summary has all or none."""
_ENERGIES = Record(dict.fromkeys(("residual_energy_j", "residual_energy_abs_j", "exchanged_energy_j"), _VECTOR))
_STEPS = Record(
    {"steps": WHOLE, "rejected": WHOLE, "unit_steps": WHOLE, "shortest_step": NUMBER, "longest_step": NUMBER},
    {"jumps": WHOLE, "convergence": NUMBER},
)
_PACE = Record({
    "speed": NUMBER, "rows": WHOLE, "overruns": WHOLE, "late_p50_s": NUMBER, "late_p99_9_s": NUMBER,
    "late_worst_s": NUMBER, "worst_row": WHOLE, "machine": TEXT,
})  # fmt: skip
_SHARES = Record(dict.fromkeys(("torque", "speed", "stop"), _VECTOR))
_SEPARATION = Record({"change": NUMBER, "max_position_difference_rad": NUMBER})
_REFERENCE = {
    "name": TEXT, "max_difference": Keyed(NUMBER), "max_position_difference_rad": NUMBER, "at_s": NUMBER,
    "max_torque_difference_nm": NUMBER, "rms_position_difference": NUMBER, "rms_torque_difference": NUMBER,
}  # fmt: skip


def _arm(joints: bool, **more: Any) -> Record:
    """Return the facts of which an arm is drawn; `joints`: of the arm of which the summary's other lists are."""
    facts = {
        "types": List(("revolute", "prismatic"), joints), "ell": List(NUMBER, joints), "rotation": List(_TURN, joints),
        "offset": List(_PLACE, joints), "tool_offset": _PLACE, "tool_rotation": _TURN, "gravity": _PLACE,
        "shapes": List(Keyed(ANY)),
    }  # fmt: skip
    return Record(facts | more, {"payload": Record({"size": _PLACE, "offset": _PLACE, "rotation": _TURN})})


_OBJECT = Record(
    {"component": TEXT, "kind": ("plane", "screw"), "direction": _PLACE, "distance": NUMBER},
    {"pitch": NUMBER, "turn_seat": NUMBER, "turn": TEXT, "tool": TEXT, "forces": Keyed(TEXT)},
)
_ARMS = List(_arm(False, component=TEXT, signals=Keyed(List(TEXT)), constants=Keyed(NUMBER), mounted=TEXT))
_SCENE = Record({"arms": _ARMS, "objects": List(_OBJECT)})
_WITNESS = {"components": _LINES, "left_out": _LINES, "times_s": _VECTOR, "numbers": WHOLE, "faults": _LINES}
_FIGURES = ("tool_error", "joint_error", "torque", "margin", "unstable", "mode", "saturated", "path", "contact")
_FIGURE = Record(
    {"value": NUMBER, "at_s": NUMBER}, {"unit": TEXT, "joint": WHOLE, "place": TEXT, "limit": NUMBER, "size": NUMBER}
)
_CHECK = Record({"name": TEXT, "state": STATES, "text": TEXT})
_VERDICT = Record({"state": STATES, "words": TEXT, "checks": List(_CHECK)})
_PAPER = {"source": TEXT, **dict.fromkeys(TRACKING, _VECTOR)}
KEYS: Mapping[str, Key] = {
    "scenario": Key(TEXT, "Name of the scenario."),
    "scenario_file": Key(TEXT, "File of the scenario, where it is not a shipped one."),
    "robot": Key(TEXT, "Name of the robot."),
    "robot_file": Key(TEXT, "File or name of a robot instead of the scenario's that is not a shipped one."),
    "friction": Key(TEXT, "Where the joints have their friction."),
    "joints": Key(WHOLE, "Number of joints."),
    "joint_names": Key(_UNITS, "Names of the joints, where the robot's file has some."),
    "vdfmu": Key(TEXT, "Version of vdfmu."),
    "date": Key(TEXT, "When the run was made, UTC."),
    "format": Key(WHOLE, "Version of the layout of this file."),
    "versions": Key(Keyed(TEXT), "Versions of Python and of the packages on which the numbers depend."),
    "master": Key(TEXT, "Master algorithm of the scenario."),
    "adaptive": Key(NUMBER, "Largest relative error of a coupled signal in a step, if the steps are adapted."),
    "start": Key(NUMBER, "Begin of the run [s]."),
    "stop": Key(NUMBER, "End of the run [s]."),
    "step": Key(NUMBER, "Communication step [s]."),
    "steps": Key(WHOLE, "Number of communication steps."),
    "tolerance": Key(NUMBER, "Relative tolerance of the plant's solver."),
    "inputs": Key(_LINES, "Files of signals from outside."),
    "plant_factors": Key(Keyed(ANY), "Numbers of the plant over those that others know, one or one a joint."),
    "settings": Key(Keyed(ANY), "Parameters and inputs that were set for this run."),
    "units": Key(Keyed(TEXT), "Units instead of the scenario's, by component."),
    "backend": Key(TEXT, "Kind of the FMUs."),
    "compiler": Key(TEXT, "C compiler of native FMUs."),
    "fmi": Key(TEXT, "Version of FMI of the FMUs."),
    "left_out": Key(_LINES, "Connections that a unit instead of the system's does not have."),
    "joined": Key(_LINES, "Connections that a unit instead of the system's has in addition."),
    "arm": Key(_arm(True), "Geometry of the arm, of which it is drawn."),
    "scene": Key(_SCENE, "Every arm of the system, with the signals that its drawing shows, and what the arms touch."),
    "package": Key(TEXT, "The package that was run."),
    "system": Key(TEXT, "Name of the system."),
    "algorithm": Key(TEXT, "Master algorithm of the run."),
    "order": Key(_LINES, "Components in the order of their steps."),
    "isolated": Key(FLAG, "Whether each component had a process of its own."),
    "stepper": Key(TEXT, "Language of the loop over the steps, with the reason if it is Python."),
    "federates": Key(Keyed(ANY), "Components of each process of a distributed run, and how long it waited."),
    "core": Key(TEXT, "How the processes of a distributed run exchanged values."),
    "ended": Key(
        {"component": TEXT, "time": NUMBER}, "Event that ended the run before its stop time, and its time [s]."
    ),
    "notes": Key(_LINES, "Notes on the run."),
    "warnings": Key(_LINES, "Notes of runs of earlier versions."),
    "wall_s": Key(NUMBER, "Wall time of the steps [s]."),
    "real_time_factor": Key(NUMBER, "Time of the run over wall time."),
    "pace": Key(_PACE, "Speed to which the run was held back, and how late its rows were [s], by machine."),
    "communication": Key(_STEPS, "Steps of an algorithm that repeats or adapts them, and their lengths [s]."),
    "held": Key(_LINES, "Inputs that take in each step what their source had at its beginning."),
    "files": Key(_LINES, "Files of the run, which a later one replaces."),
    "witness": Key(_WITNESS, "Comparison of the run with the units' methods in numpy."),
    "position_units": Key(List(("deg", "mm"), True), "Units of measurement of the position errors."),
    "torque_units": Key(_UNITS, "Units of measurement of the torques."),
    "rms_position_error_deg": Key(_JOINTS, "RMS of the position errors."),
    "max_position_error_deg": Key(_JOINTS, "Largest position errors."),
    "rms_torque_compensation_error_nm": Key(_JOINTS, "RMS of control torque minus feedforward torque, link-side."),
    "rms_spring_torque_nm": Key(_JOINTS, "RMS of the spring torques, link-side."),
    "rms_tau_s_hat_error_nm": Key(_JOINTS, "RMS of the errors of the estimated spring torques, link-side."),
    "rms_tau_f_hat_error_nm": Key(_JOINTS, "RMS of the errors of the estimated friction torques, link-side."),
    "power_bond": Key(_ENERGIES, "Energy that the coupling adds or takes, and that is exchanged, link-side [J]."),
    "limits": Key(Keyed(_SHARES), "Shares of the time at limits, by plant."),
    "paper": Key(_PAPER, "Values of the paper."),
    "reference": Key(Keyed(_REFERENCE), "Largest differences to each reference."),
    "no_reference": Key(TEXT, "Why there is no reference."),
    "separation": Key(_SEPARATION, "How far the run is from itself with a change that should not show."),
    "key_figures": Key(
        dict.fromkeys(_FIGURES, _FIGURE),
        "Largest errors of tool [m] and joints, largest torque, smallest modulus margin, lowest mode [Hz], largest "
        "share of the time at a limit, error and size of the motion, largest contact force [N], and when.",
    ),
    "verdict": Key(_VERDICT, "Checks of the run, the state of the worst, and the line that says it."),
    "error": Key(TEXT, "Why the run did not reach its end."),
}
"""Every key that a run may write. Tables without names for their keys may have any."""


_TEXTS = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}
"""Texts in JSON for numbers that are not finite."""


def read_summary(file: Path) -> dict[str, Any]:
    """Return a summary whose keys have the types of `KEYS`, without keys that are null.

    UsageError with every problem if it cannot be read, or is another table.
    """
    try:
        found = json.loads(file.read_bytes())
    except RecursionError:
        raise UsageError(f"{file}: expected a table of facts, got lists within lists.") from None
    except (OSError, ValueError) as error:
        raise UsageError(
            f"{file.parent}: expected the folder of a run, with summary.json and {' or '.join(result_files())}: "
            f"{getattr(error, 'strerror', None) or elided(str(error))}. 'vdfmu run' writes one."
        ) from None
    if isinstance(found, dict) and (problem := format_problem(found.get("format", 1))):
        raise UsageError(f"{file}: {problem}")
    lengths: dict[str, int] = {}
    summary, problems = typed(found, {name: key.of for name, key in KEYS.items()}, lengths)
    if not problems:
        problems = list(_contradictions(summary, lengths))
    if problems:
        raise UsageError("\n".join(f"{file}: {elided(problem)}. Run it again." for problem in problems[:20]))
    return summary


def typed(found: Any, of: Any, lengths: dict[str, int] | None = None) -> tuple[dict[str, Any], list[str]]:
    """Return a table of a type, see `Key`, without null keys, and its faults; note `lengths` of lists over joints."""
    if not isinstance(found, dict):
        return {}, [f"expected a table of facts, got {_short(found)}"]
    problems: list[str] = []
    return _read(found, of, "", problems, {} if lengths is None else lengths), problems


def _contradictions(summary: Mapping[str, Any], lengths: Mapping[str, int]) -> Iterator[str]:
    """Yield lists that are of unequal lengths, and keys that are missing although others need them."""
    if len(set(lengths.values())) > 1:
        counts = ", ".join(f"{key} has {count}" for key, count in lengths.items())
        yield f"expected an entry for each joint, got other numbers: {counts}"
    for keys in TOGETHER:
        if any(key in summary for key in keys):
            yield from (f"{key}: is missing" for key in keys if key not in summary)
    for k, arm in enumerate(summary.get("scene", {}).get("arms", []), 1):
        of_joints = {key: len(arm[key]) for key in ("types", "ell", "rotation", "offset")}
        of_signals = {key: len(each) for key, each in arm["signals"].items() if "." in key}
        sizes = of_joints | of_signals
        if len(set(sizes.values())) > 1:
            yield f"scene.arms[{k}]: expected an entry for each joint, got {sizes}"
        for key, size in {"base": 12, "F_e": 6, "F_S": 6}.items():
            if len(arm["signals"].get(key, [None] * size)) != size:
                yield f"scene.arms[{k}].signals.{key}: expected {size} signals"
    for name, shares in summary.get("limits", {}).items():
        sizes = {len(each) for each in shares.values() if isinstance(each, list)}
        if len(sizes) > 1 or 0 in sizes:
            yield f"limits.{name}: expected {', '.join(shares)} with a share for each joint"
    for name, entry in summary.get("reference", {}).items():
        needs = [f"max_{what}" for what in ("position_difference_rad", "torque_difference_nm")]
        needs = [] if "max_difference" in entry else needs
        if "separation" in summary:
            needs += ["rms_position_difference", "rms_torque_difference"]
        yield from (f"reference.{name}.{need}: is missing" for need in needs if need not in entry)


def _read(value: Any, of: Any, where: str, problems: list[str], lengths: dict[str, int]) -> Any:
    """Return a value of a type, or note that it is of another."""

    def inner(key: Any, entry: Any, kind: Any) -> Any:
        place = f"{where}[{key + 1}]" if isinstance(key, int) else f"{where}.{key}".lstrip(".")
        return _read(entry, kind, place, problems, lengths)

    if isinstance(of, Mapping | Keyed | Record) and isinstance(value, dict):
        entries = {key: entry for key, entry in value.items() if entry is not None}
        if isinstance(of, Record):
            missing = [key for key in of.of if key not in entries]
            problems += [f"{f'{where}.{key}'.lstrip('.')}: is missing" for key in missing]
            of = {**of.of, **of.also}
        kinds = dict.fromkeys(entries, of.of) if isinstance(of, Keyed) else of
        return {key: inner(key, entry, kinds.get(key, ANY)) for key, entry in entries.items()}
    if isinstance(of, List) and isinstance(value, list):
        if of.joints:
            lengths[where] = len(value)
        if of.size not in (None, len(value)):
            problems.append(f"{where}: expected {of.size} entries, got {len(value)}")
        return [inner(i, entry, of.of) for i, entry in enumerate(value)]
    if of is NUMBER and isinstance(value, str) and value in _TEXTS:
        return _TEXTS[value]
    good = {
        NUMBER: isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300,
        WHOLE: isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**53,
        TEXT: isinstance(value, str), FLAG: isinstance(value, bool), ANY: True,
    }  # fmt: skip
    if not (value in of if isinstance(of, tuple) else isinstance(of, str) and good[of]):
        kind = "a list" if isinstance(of, List) else of if isinstance(of, str) else "a table"
        kind = " or ".join(of) if isinstance(of, tuple) else kind
        problems.append(f"{where}: expected {kind}, got {_short(value)}")
    return value


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:60]}..."


def energies(bond: Mapping[str, Any]) -> tuple[float, float]:
    """Return the energy that the coupling adds or takes, sum of absolute values, and that it exchanges, in all [J]."""
    return sum(bond["residual_energy_abs_j"]), sum(bond["exchanged_energy_j"])
