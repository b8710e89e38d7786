"""The verdict on a run: unstable loops, joints at limits, an arm off its path, then other checks, and their words."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from vdfmu.arm.robot import Robot
from vdfmu.arm.robot.plausible import tool_notes
from vdfmu.base.errors import CosimError
from vdfmu.base.measure import number, quantity
from vdfmu.base.progress import doing
from vdfmu.engine.linear.growth import Poses
from vdfmu.engine.results.verdict import DOUBTFUL, FAILED, GOOD, Check, verdict_of
from vdfmu.engine.run import Interrupted
from vdfmu.study import referee
from vdfmu.study.analysis.loops import Judged, growth_words, judged, place_of, since
from vdfmu.study.run.key_figures import STANDING, off_from
from vdfmu.study.run.summary_keys import Summary, energies
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.reference import RESOLUTION

VISIBLE = 1e-3
"""Smallest share of the largest position error that shows in tables of three digits."""
_STATISTICS = 0.05
"""Share by which RMS errors of a chaotic loop may differ: finite samples of it differ by up to 2.4 %."""
_ENERGY = 0.1
"""Share of the exchanged energy that the coupling may add or take: 4 % where friction excites itself, and 31 % in a
limit cycle of too high gains; all other shipped scenarios stay below 0.2 %."""
_ENERGY_FLOOR = 1e-3
"""Residual [J] below which its share says nothing, as for an arm at rest."""


_LOOPS = "Sampled loops"


class LoopCheck(NamedTuple):
    """The check of a run's loops."""

    check: Check
    figures: dict[str, Any]
    """Entries of ``key_figures`` of a summary: ``margin``; if disturbances grow, ``unstable``."""

    @classmethod
    def read(cls, stored: bytes | None) -> list[LoopCheck] | None:
        """Return checks from the cache, None if they are not there."""
        return None if stored is None else [cls(Check(*check), figures) for check, figures in json.loads(stored)]


def explain(error: CosimError | Interrupted, poses: Poses) -> list[LoopCheck]:
    """Return the check of the loops of a failed run, if they are unstable, and note it in the error."""
    if poses.lacking or not poses.seconds or isinstance(error, Interrupted):
        return []
    loops = judged(poses, 0.0, error.time, failed=True)
    if not loops.growth.unstable:
        return []
    check = _loop_check(loops)
    error.add_note(f"{_LOOPS}: {check.check.text}")
    return [check]


def loop_checks(poses: Poses, system: SystemDescription) -> Iterator[LoopCheck]:
    """Yield the check of a run's loops, if it has loops."""
    if not any(target.endswith(".tau") for targets in system.connections.values() for target in targets):
        return
    if poses.lacking or not poses.seconds:
        why = poses.lacking or "components in separate processes are not linearised"
        words = f"stability not judged ({why.partition('. ')[0]})"
        yield LoopCheck(Check(_LOOPS, DOUBTFUL, f"not judged: {why}", words), {})
        return
    with doing("stability"):
        yield _loop_check(judged(poses, 0.0, system.scenario.stop))


def _loop_check(result: Judged) -> LoopCheck:
    (state, text), (loops, growth, excited) = result.words, result
    figures, nearest = dict[str, Any](), None if growth.unstable else loops.nearest()
    if growth.unstable:
        factor = math.exp(growth.rate * loops.system.step)
        figures["unstable"] = {"value": factor, "place": place_of(growth.state, loops), "at_s": growth.begin}
    elif nearest is not None:
        place = place_of(nearest.name, loops)
        figures["margin"] = {"value": nearest.modulus, "place": place, "at_s": nearest.time}
        figures["margin"] |= {"without_dry_friction": True} if excited else {}
    words = "" if state == GOOD else (growth_words(loops) if state == DOUBTFUL else "") or text.partition(": ")[0]
    return LoopCheck(Check(_LOOPS, state, text, words), figures)


def verdict(summary: Summary, loops: Sequence[Check], robot: Robot | None = None) -> dict[str, Any]:
    """Return the entry ``verdict`` of the summary of a complete run of a robot, whose loops have these checks."""
    figures: Summary = summary["key_figures"]
    limits = list(_limits(figures))
    first = [*loops, *limits]
    loop = figures.get("unstable") or figures.get("margin")
    if limits and loop and figures["saturated"]["at_s"] < loop["at_s"]:
        first.reverse()  # a joint at its limit has no feedback, so its loop is no fault of the gains
    path = list(_path(figures))
    notes = [] if robot is None else tool_notes(robot)
    tool = [Check("Place of the tool", DOUBTFUL, note, note.partition(",")[0]) for note in notes]
    stable = bool(first) and all(check.state == GOOD for check in first)
    numbers = _numbers(figures, all(check.state == GOOD for check in path), stable)
    return verdict_of([*first, *path, *tool, *run_checks(summary)], "; ".join(numbers))


def run_checks(summary: Summary) -> Iterator[Check]:
    """Yield the checks of the numbers of a complete run against other calculations, and of its energy."""
    if (judgement := summary.get("judgement")) is not None:
        state = {referee.RIGHT: GOOD, referee.WRONG: FAILED}.get(judgement["verdict"], DOUBTFUL)
        words = judgement["text"].partition(". ")[0]
        yield Check("Error by communication", state, judgement["text"], f"{words[:1].lower()}{words[1:]}")
    yield from _witness(summary)
    yield from _reference(summary)
    bond: Summary | None = summary.get("power_bond")
    if bond is not None:
        residual, exchanged = energies(bond)
        text = f"{number(residual)} J of {number(exchanged)} J exchanged; limit {100.0 * _ENERGY:g} %"
        passed = residual <= max(_ENERGY * exchanged, _ENERGY_FLOOR)
        yield Check("Energy residual of the coupling", _state(passed), text)


def _limits(figures: Summary) -> Iterator[Check]:
    """Yield the check of the joint that spent most time at a limit of its motor, or at its end stop."""
    figure: Summary | None = figures.get("saturated")
    if figure is not None:
        text = f"at the {figure['place']} for {100.0 * figure['value']:.3g} % of the time, {since(figure['at_s'])}"
        yield Check("Limits of the joints", DOUBTFUL, f"{text}; without feedback there", f"saturated, {text}")


def _path(figures: Summary) -> Iterator[Check]:
    """Yield whether the arm followed its motion; in contact, whether it moved at all."""
    figure: Summary | None = figures.get("path")
    if figure is None:
        return
    most, share = STANDING if "contact" in figures else off_from(figure["place"]), figure["value"] / figure["size"]
    error, size = (quantity(figure[key], figure["unit"]) for key in ("value", "size"))
    text = f"{figure['place']} off by {error} at most, in a motion of {size}"
    state = FAILED if share >= STANDING else DOUBTFUL if share >= most else GOOD
    words = f"off its path, {text}, {_at(figure)}"
    yield Check("Follows its motion", state, f"{text}; limit {100.0 * most:g} %", words)


def _numbers(figures: Summary, follows: bool, stable: bool) -> Iterator[str]:
    """Yield the words of a good run; the check of an arm off its path has the tool's error already."""
    if stable:
        yield "stable"
    if "contact" in figures:
        contact = figures["contact"]
        yield f"in contact as meant {since(contact['at_s'])}, {quantity(contact['value'], contact['unit'])} at most"
    if follows and "tool_error" in figures:
        yield f"tool error {quantity(figures['tool_error']['value'], 'm')} at most, {_at(figures['tool_error'])}"
    if "joint_error" in figures:
        worst = figures["joint_error"]
        yield f"joint {worst['joint']} worst, {quantity(worst['value'], worst['unit'])}"
    if stable and "margin" in figures:
        yield f"modulus margin {figures['margin']['value']:.2g}"


def _at(figure: Summary) -> str:
    return f"at {figure['at_s']:.3g} s"


def _witness(summary: Summary) -> Iterator[Check]:
    """Yield whether numbers of the components equal the results of their units' methods in numpy."""
    witness: Summary | None = summary.get("witness")
    if witness is None or not (witness["components"] or witness["faults"]):
        return
    faults, left_out = witness["faults"], witness["left_out"]
    text = f"{witness['numbers']} numbers of {len(witness['components'])} components at {len(witness['times_s'])} times"
    text += f"; without {', '.join(left_out)}" if left_out else ""
    yield Check("Equals the units in plain numpy", _state(not faults), "; ".join(faults) or text)


def _reference(summary: Summary) -> Iterator[Check]:
    """Yield whether the run equals the sampled reference, with the schedule of the master."""
    compared: Summary | None = (summary.get("reference") or {}).get("sampled")
    errors, units = summary.get("max_position_error_deg"), summary.get("position_units")
    if compared is None or "max_position_difference_rad" not in compared or not errors or not units:
        return
    if "separation" in summary:
        apart = max(compared["rms_position_difference"], compared["rms_torque_difference"])
        text = f"a chaotic loop: RMS errors differ by {100 * apart:.2g} %; limit {100 * _STATISTICS:g} %"
        yield Check("Statistics of the scipy reference", _state(apart <= _STATISTICS), text)
        return
    si = {"deg": math.pi / 180.0, "mm": 1e-3}
    largest = max(si[u] * error for error, u in zip(errors, units, strict=True))
    limit, of = VISIBLE * largest, f"{100.0 * VISIBLE:g} % of the largest error"
    if limit < RESOLUTION:  # an arm that has hardly moved: the reference knows no more
        limit, of = RESOLUTION, "the absolute tolerance of the reference's solver"
    apart = compared["max_position_difference_rad"]
    text = f"positions differ by {number(apart)} rad at most; limit {number(limit)}, {of}"
    if apart > limit and summary.get("tolerance"):
        text += f"; a --tolerance below {summary['tolerance']:g} shows whether the solvers of the units do this"
    yield Check(f"Equals the {compared['name']} scipy reference", _state(apart <= limit), text)


def _state(passed: bool) -> str:
    return GOOD if passed else FAILED
