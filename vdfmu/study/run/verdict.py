"""The verdict on a run: all that is checked, in one order, and the words of each result.

What a run is known by comes first: loops that are unstable, joints at their limits, an arm off its path.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from vdfmu.base.measure import number, quantity
from vdfmu.engine.results.verdict import DOUBTFUL, FAILED, GOOD, Check, verdict_of
from vdfmu.study.analysis.loops import since
from vdfmu.study.run.key_figures import STANDING, off_from
from vdfmu.study.run.summary_keys import Summary, energies
from vdfmu.system.reference.reference import RESOLUTION

VISIBLE = 1e-3
"""Share of the largest position error from which a difference to the reference shows in tables of three digits."""
_STATISTICS = 0.05
"""Share by which RMS errors of a chaotic loop may differ: finite samples of it differ by up to 2.4 %."""
_ENERGY = 0.1
"""Share of the exchanged energy that the coupling may add or take: 4 % where friction excites itself, and 31 % in a
limit cycle of too high gains; all other shipped scenarios stay below 0.2 %."""
_ENERGY_FLOOR = 1e-3
"""Residual [J] below which its share says nothing, as for an arm at rest."""


def verdict(summary: Summary, loops: Sequence[Check]) -> dict[str, Any]:
    """Return the entry ``verdict`` of the summary of a complete run, whose loops have these checks."""
    figures: Summary = summary["key_figures"]
    limits = list(_limits(figures))
    first = [*loops, *limits]
    loop = figures.get("unstable") or figures.get("margin")
    if limits and loop and figures["saturated"]["at_s"] < loop["at_s"]:
        first.reverse()  # a joint at its limit has no feedback, so its loop is no fault of the gains
    path = list(_path(figures))
    stable = bool(first) and all(check.state == GOOD for check in first)
    numbers = _numbers(figures, all(check.state == GOOD for check in path), stable)
    return verdict_of([*first, *path, *run_checks(summary)], "; ".join(numbers))


def run_checks(summary: Summary) -> Iterator[Check]:
    """Yield the checks of the numbers of a complete run against other calculations, and of its energy."""
    yield from _witness(summary)
    yield from _reference(summary)
    yield from _energy(summary)


def _limits(figures: Summary) -> Iterator[Check]:
    """Yield the check of the joint that was at a limit of its motor, or at its end stop, for most of the time."""
    figure: Summary | None = figures.get("saturated")
    if figure is not None:
        text = f"at the {figure['place']} for {100.0 * figure['value']:.3g} % of the time, {since(figure['at_s'])}"
        yield Check("Limits of the joints", DOUBTFUL, f"{text}; there the joint has no feedback", f"saturated, {text}")


def _path(figures: Summary) -> Iterator[Check]:
    """Yield whether the arm followed its motion; in contact, whether it did at all."""
    figure: Summary | None = figures.get("path")
    if figure is None:
        return
    most, share = STANDING if "contact" in figures else off_from(figure["place"]), figure["value"] / figure["size"]
    error, size = (quantity(figure[key], figure["unit"]) for key in ("value", "size"))
    text = f"{figure['place']} off by {error} at most, in a motion of {size}"
    state = FAILED if share >= STANDING else DOUBTFUL if share >= most else GOOD
    name = "Follows its motion"
    yield Check(name, state, f"{text}; limit {100.0 * most:g} %", f"off its path, {text}, {_at(figure)}")


def _numbers(figures: Summary, follows: bool, stable: bool) -> Iterator[str]:
    """Yield the words of a good run; without the tool's error if it is told already, since the arm does not follow."""
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
    found: Summary | None = summary.get("witness")
    if found is None or not (found["components"] or found["faults"]):
        return
    text = f"{found['numbers']} numbers of {len(found['components'])} components at {len(found['times_s'])} times"
    if found["left_out"]:
        text += f"; without {', '.join(found['left_out'])}"
    yield Check("Equals the units in plain numpy", _state(not found["faults"]), "; ".join(found["faults"]) or text)


def _reference(summary: Summary) -> Iterator[Check]:
    """Yield whether the run equals the sampled reference, which has the master's schedule."""
    found: Summary | None = (summary.get("reference") or {}).get("sampled")
    errors, units = summary.get("max_position_error_deg"), summary.get("position_units")
    if found is None or "max_position_difference_rad" not in found or not errors or not units:
        return
    if "separation" in summary:
        apart = max(found["rms_position_difference"], found["rms_torque_difference"])
        text = f"a chaotic loop: RMS errors differ by {100 * apart:.2g} %; limit {100 * _STATISTICS:g} %"
        yield Check("Statistics of the scipy reference", _state(apart <= _STATISTICS), text)
        return
    si = {"deg": math.pi / 180.0, "mm": 1e-3}
    limit = VISIBLE * max(si[unit] * error for error, unit in zip(errors, units, strict=True))
    apart = found["max_position_difference_rad"]
    what = "what three digits show"
    if limit < RESOLUTION:  # an arm that has hardly moved: the reference knows no more
        limit, what = RESOLUTION, "the absolute tolerance of the reference's solver"
    text = f"positions differ by {number(apart)} rad at most; limit {number(limit)}, {what}"
    if apart > limit and summary.get("tolerance"):
        text += f"; a --tolerance below {summary['tolerance']:g} shows whether the solvers of the units do this"
    yield Check(f"Equals the {found['name']} scipy reference", _state(apart <= limit), text)


def _energy(summary: Summary) -> Iterator[Check]:
    """Yield whether the coupling added or took little energy."""
    bond: Summary | None = summary.get("power_bond")
    if bond is not None:
        residual, exchanged = energies(bond)
        text = f"{number(residual)} J of {number(exchanged)} J exchanged; limit {100.0 * _ENERGY:g} %"
        passed = residual <= max(_ENERGY * exchanged, _ENERGY_FLOOR)
        yield Check("Energy residual of the coupling", _state(passed), text)


def _state(passed: bool) -> str:
    return GOOD if passed else FAILED
