"""The keys of ``summary.json``, with meanings and types, and its reader."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vdfmu.base.errors import UsageError
from vdfmu.base.files import read_json
from vdfmu.base.measure import JOINT_TYPES
from vdfmu.base.option import renamed
from vdfmu.base.text import elided
from vdfmu.base.toml_file import format_problem
from vdfmu.engine.results.formats import result_files
from vdfmu.engine.results.verdict import STATES, UNJUDGED

Summary = Mapping[str, Any]
"""Content of ``summary.json``."""


@dataclass(frozen=True)
class List:
    """A list, with an entry per joint if `joints`, or with `size` entries."""

    of: Any
    joints: bool = False
    size: int | None = None


@dataclass(frozen=True)
class Record:
    """A table with all keys of `of`; keys of `also`, and others, are optional."""

    of: Mapping[str, Any]
    also: Mapping[str, Any] = field(default_factory=dict[str, Any])


@dataclass(frozen=True)
class Keyed:
    """A table whose keys are names."""

    of: Any


NUMBER, WHOLE, TEXT, FLAG, ANY = "a number", "a whole number", "a text", "true or false", "anything"
_JOINTS, _UNITS, _VECTOR, _LINES = List(NUMBER, True), List(TEXT, True), List(NUMBER), List(TEXT)
_PLACE = List(NUMBER, size=3)
_TURN = List(_PLACE, size=3)
SPRINGS = ("rms_spring_torque_nm", "rms_tau_s_hat_error_nm", "rms_tau_f_hat_error_nm")
TRACKING = ("rms_position_error_deg", "max_position_error_deg", "rms_torque_compensation_error_nm")
TOGETHER = (TRACKING, SPRINGS)
"""Groups of keys, of which a summary has all or none."""
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
    "solved_by_scipy": NUMBER, "max_solver_difference": NUMBER,
}  # fmt: skip


def _arm(joints: bool, **more: Any) -> Record:
    """Return the type of a drawn arm; with `joints` its lists are as long as other lists over joints in the summary."""
    facts = {
        "types": List((*JOINT_TYPES,), joints), "ell": List(NUMBER, joints), "rotation": List(_TURN, joints),
        "offset": List(_PLACE, joints), "tool_offset": _PLACE, "tool_rotation": _TURN, "gravity": _PLACE,
        "shapes": List(Keyed(ANY)),
    }  # fmt: skip
    return Record(facts | more, {"payload": Record({"size": _PLACE, "offset": _PLACE, "rotation": _TURN})})


_OBJECT = Record(
    {"component": TEXT, "kind": ("plane", "screw"), "direction": _PLACE, "distance": NUMBER},
    {"pitch": NUMBER, "turn_seat": NUMBER, "turn": TEXT, "tool": TEXT, "forces": Keyed(TEXT)},
)
_ARMS = List(_arm(False, component=TEXT, signals=Keyed(List(TEXT)), constants=Keyed(NUMBER), mounted=TEXT))
_ESTIMATE = Record({"component": TEXT, "group": TEXT, "words": TEXT, "signals": _LINES, "true": _LINES})
_SCENE = Record({"arms": _ARMS, "objects": List(_OBJECT)}, {"estimates": List(_ESTIMATE)})
_FIGURES = (
    "tool_error", "joint_error", "torque", "margin", "unstable", "mode", "saturated", "path", "contact", "depth",
    "power", "cut", "delay", "growth", "excited", "open", "half_step",
)  # fmt: skip
_FIGURE = Record(
    {"value": NUMBER, "at_s": NUMBER},
    {
        "unit": TEXT,
        "joint": WHOLE,
        "place": TEXT,
        "limit": NUMBER,
        "limits": _VECTOR,
        "size": NUMBER,
        "until_s": NUMBER,
        "step": NUMBER,
        "rest": FLAG,
    },
)
_CHECK = Record(
    {"key": TEXT, "name": TEXT, "state": (*STATES, UNJUDGED), "sentence": TEXT},
    {"more": TEXT, "value": NUMBER, "limit": NUMBER, "by": TEXT},
)
_VERDICT = Record({"state": STATES, "headline": TEXT, "results": TEXT, "checks": List(_CHECK)})
_JUDGEMENT = Record(
    {"verdict": TEXT, "text": TEXT, "wanted": NUMBER, "error": NUMBER, "signal": TEXT, "step": NUMBER,
     "algorithm": TEXT,
     "signals": List(Record({"name": TEXT, "error": NUMBER, "q": NUMBER, "time": NUMBER}, {"read": FLAG}))},
    {"kind": TEXT, "order": WHOLE},
)  # fmt: skip
_EXPECTED = Record(
    {"file": TEXT, "within": NUMBER, "signals": WHOLE, "problems": _LINES, "beyond": WHOLE,
     "differences": List(Record({"signal": TEXT, "share": NUMBER, "at_s": NUMBER, "value": NUMBER, "expected": NUMBER,
                                 "constant": FLAG}))},
    {"until_s": NUMBER},
)  # fmt: skip
_PAPER = {"source": TEXT, **dict.fromkeys(TRACKING, _VECTOR)}
KEYS: Mapping[str, Any] = {
    "scenario": TEXT,  # name of the scenario
    "scenario_file": TEXT,  # file of a scenario that is not a shipped one
    "description": TEXT,  # what the scenario is for
    "robot": TEXT,  # name of the robot
    "robot_file": TEXT,  # robot that replaces the scenario's: its file, or its name if it is shipped
    "friction": TEXT,  # place of the joints' friction
    "joints": WHOLE,  # number of joints
    "joint_names": _UNITS,  # names of the joints in the robot's file
    "vdfmu": TEXT,  # version of vdfmu
    "date": TEXT,  # date of the run, UTC
    "format": WHOLE,  # version of the layout of this file
    "versions": Keyed(TEXT),  # versions of Python and of the packages on which the numbers depend
    "adaptive": NUMBER,  # allowed relative error of a coupled signal in a step, if the steps are adapted
    "start": NUMBER,  # start of the run [s]
    "stop": NUMBER,  # end of the run [s]
    "step": NUMBER,  # communication step [s]
    "steps": WHOLE,  # number of communication steps
    "tolerance": NUMBER,  # relative tolerance of the plant's solver
    "inputs": _LINES,  # files of signals from outside
    "plant_factors": Keyed(ANY),  # ratios of the plant's numbers to the model's, common or per joint
    "parameters": Keyed(ANY),  # parameters and inputs that were set for this run
    "units": Keyed(TEXT),  # units that replace the scenario's, by component
    "connections": _LINES,  # connections that were added for this run, output -> input
    "backend": TEXT,  # kind of the FMUs
    "compiler": TEXT,  # C compiler of native FMUs
    "fmi": TEXT,  # version of FMI of the FMUs
    "left_out": _LINES,  # connections dropped because the replacement of a unit has no such signal
    "joined": _LINES,  # connections added because the replacement of a unit has such a signal
    "arm": _arm(True),  # geometry of the drawn arm
    "scene": _SCENE,  # arms of the system with the signals of their drawing, touched objects, estimated torques
    "package": TEXT,  # the package
    "system": TEXT,  # name of the system
    "algorithm": TEXT,  # master algorithm of the run
    "order": _LINES,  # components in the order of their steps
    "isolated": FLAG,  # whether each component had a separate process
    "stepper": TEXT,  # loop over the steps, fmpy or c, with the reason if it is fmpy
    "core": TEXT,  # how the processes of a distributed run exchanged values
    "ended": {"component": TEXT, "time": NUMBER},  # event that ended the run before its stop time, and its time [s]
    "notes": _LINES,  # notes on the run
    "warnings": _LINES,  # notes of runs of earlier versions
    "wall_s": NUMBER,  # wall time of the steps [s]
    "real_time_factor": NUMBER,  # time of the run over wall time
    "pace": _PACE,  # speed limit of the run, and delays of its rows [s], by machine
    "communication": _STEPS,  # steps of an algorithm that repeats or adapts them, and their lengths [s]
    # events: their number, the first times and the last [s], by component, of a unit by component.event
    "events": Keyed(Record({"count": WHOLE, "last": NUMBER, "times": _VECTOR})),
    "held": _LINES,  # inputs that have, during a step, the value of their source at the beginning of the step
    "names": Keyed(Keyed(WHOLE)),  # names of the values of enumerations and modes, by signal
    "files": _LINES,  # files of the run, replaced by a later run
    "position_units": List(("deg", "mm"), True),  # units of measurement of the position errors
    "torque_units": _UNITS,  # units of measurement of the torques
    "rms_position_error_deg": _JOINTS,  # RMS of the position errors
    "max_position_error_deg": _JOINTS,  # largest position errors
    "rms_torque_compensation_error_nm": _JOINTS,  # RMS of control torque minus feedforward torque, link-side
    "rms_spring_torque_nm": _JOINTS,  # RMS of the spring torques, link-side
    "rms_tau_s_hat_error_nm": _JOINTS,  # RMS of the errors of the estimated spring torques, link-side
    "rms_tau_f_hat_error_nm": _JOINTS,  # RMS of the errors of the estimated friction torques, link-side
    "own_limits": Keyed(Record({"value": NUMBER, "by": TEXT})),  # limits of the verdict that a user set
    "power_bond": _ENERGIES,  # energy that the coupling adds or takes, and exchanged energy, link-side [J]
    "limits": Keyed(_SHARES),  # fractions of the time at limits, by plant
    "paper": _PAPER,  # values of the paper
    "reference": Keyed(_REFERENCE),  # largest differences from each reference
    "reference_stop": NUMBER,  # end of the comparison with the references, if it is before that of the run [s]
    "no_reference": TEXT,  # reason of a missing reference
    "separation": _SEPARATION,  # distance between the run and a second run with a negligible change
    # largest errors of tool [m] and joints, largest torque, smallest modulus margin, lowest mode [Hz], largest share of
    # the time at a limit, error and size of the motion, largest contact force [N] and depth [m], largest power [W] and
    # torque or force at cutting points, each with its time
    "key_figures": dict.fromkeys(_FIGURES, _FIGURE),
    "judgement": _JUDGEMENT,  # coupling error, relative to the signals' ranges
    "expected": _EXPECTED,  # recorded results that the run must equal, and the largest differences from them
    "cut": Record({"end": NUMBER, "stop": NUMBER, "asked": FLAG}),  # end of a longer motion and of the run [s]
    "unfed": _LINES,  # unconnected inputs, though the component acts on a plant
    "implausible": _LINES,  # likely mistakes of units or signs
    "stability": Record({"reason": TEXT, "expected": FLAG}),  # why the stability of the loops was not judged
    "verdict": _VERDICT,  # checks of the run, the worst state, its headline, and the results
    "error": TEXT,  # why the run did not reach its end
}
"""Types of all keys that a run may write: a tuple means one of some texts, a mapping a table of optional keys."""


_TEXTS = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}
"""Texts in JSON for numbers that are not finite."""


def read_summary(file: Path) -> dict[str, Any]:
    """Return a summary with the types of `KEYS`, without null keys. UsageError lists all problems."""
    try:
        content = read_json(file)
    except (OSError, ValueError) as error:
        raise UsageError(
            f"{file.parent}: expected the folder of a run, with summary.json and {' or '.join(result_files())}: "
            f"{getattr(error, 'strerror', None) or elided(str(error))}. 'vdfmu run' writes one."
        ) from None
    if isinstance(content, dict):
        content = renamed(content)
        if problem := format_problem(content.get("format", 1)):
            raise UsageError(f"{file}: {problem}")
    lengths: dict[str, int] = {}
    summary, problems = typed(content, KEYS, lengths)
    if not problems:
        problems = list(_contradictions(summary, lengths))
    if problems:
        raise UsageError("\n".join(f"{file}: {elided(problem)}. Run it again." for problem in problems[:20]))
    return summary


def typed(content: Any, of: Any, lengths: dict[str, int] | None = None) -> tuple[dict[str, Any], list[str]]:
    """Return a table of a type, see `KEYS`, without null keys, and its faults; add the lengths of lists over joints."""
    if not isinstance(content, dict):
        return {}, [f"expected a table, got {_short(content)}"]
    problems: list[str] = []
    return _read(content, of, "", problems, {} if lengths is None else lengths), problems


def _contradictions(summary: Mapping[str, Any], lengths: Mapping[str, int]) -> Iterator[str]:
    """Yield lists of unequal lengths, and missing keys that other keys need."""
    if len(set(lengths.values())) > 1:
        counts = ", ".join(f"{key} has {count}" for key, count in lengths.items())
        yield f"expected lists with an entry for each joint, got different lengths: {counts}"
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
        needs = [] if "max_difference" in entry else ["max_position_difference_rad", "max_torque_difference_nm"]
        if "separation" in summary:
            needs += ["rms_position_difference", "rms_torque_difference"]
        yield from (f"reference.{name}.{need}: is missing" for need in needs if need not in entry)


def _read(value: Any, of: Any, where: str, problems: list[str], lengths: dict[str, int]) -> Any:
    """Return a value; add a problem if it has another type."""

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
