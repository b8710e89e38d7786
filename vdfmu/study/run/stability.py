"""The checks of a run: what its numbers show, and whether its sampled loops are stable, from poses along it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from vdfmu.base.errors import CosimError
from vdfmu.base.progress import doing
from vdfmu.engine.linear.growth import Poses
from vdfmu.engine.options import SimulatorOptions
from vdfmu.engine.results.verdict import Check
from vdfmu.engine.run import Interrupted, Results, Simulator
from vdfmu.study.analysis.loops import Judged, judged, place_of, words_of
from vdfmu.study.report.sheets import energies, number
from vdfmu.study.report.summary_keys import Summary
from vdfmu.system.reference.solution import SHORT
from vdfmu.system.scenario import Scenario

_NAME = "Sampled loops"


class LoopCheck(NamedTuple):
    """The check of a run's loops."""

    check: Check
    figures: dict[str, Any]
    """Entries of ``key_figures`` of a summary: ``margin``, or where disturbances grow, ``unstable``."""
    state: str
    """``good``; ``doubtful``, if a mode grows for a while though the run survives it; ``failed``."""


def simulated(scenario: Scenario, package: Path, parameters: Any = None, **options: Any) -> Results:
    """Co-simulate a scenario; for `options` see :meth:`vdfmu.Simulator.run`, and `log`."""
    own: SimulatorOptions = {
        **scenario.coupling, "inputs": scenario.inputs, "parameters": parameters, "log": options.pop("log", None),
    }  # fmt: skip
    with Simulator(package, **own) as simulator:
        return simulator.run(start=0.0, stop=scenario.stop, step=scenario.step, **options)


def explain(error: CosimError | Interrupted, poses: Poses) -> list[LoopCheck]:
    """Return the check of the loops of a run that failed, if they are unstable, and say so in the error."""
    if poses.lacking or isinstance(error, Interrupted):
        return []
    found = judged(poses, 0.0, error.time, failed=True)
    if not found.growth.unstable:
        return []
    check = _check(found)
    error.add_note(f"{_NAME}: {check.check.text}")
    return [check]


def loop_checks(poses: Poses, stop: float) -> Iterator[LoopCheck]:
    """Yield the check of the loops of a run to the time `stop` [s], if they were linearised."""
    if not poses.lacking:
        with doing("stability"):
            yield _check(judged(poses, 0.0, stop))


def _check(found: Judged) -> LoopCheck:
    (state, text), (loops, growth, excited) = words_of(found), found
    figures, nearest = dict[str, Any](), None if growth.unstable else loops.nearest()
    if growth.unstable:
        factor = math.exp(growth.rate * loops.system.step)
        figures["unstable"] = {"value": factor, "place": place_of(growth.state, loops), "at_s": growth.begin}
    elif nearest is not None:
        figures["margin"] = {
            "value": nearest.modulus, "place": place_of(nearest.name, loops), "at_s": nearest.time,
        } | ({"without_dry_friction": True} if excited else {})  # fmt: skip
    return LoopCheck(Check(_NAME, state != "failed", text), figures, state)


VISIBLE = 1e-3
"""Share of the largest position error from which a difference to the reference shows in tables of three digits."""
_STATISTICS = 0.05
"""Share by which RMS errors of a chaotic loop may differ: finite samples of it differ by up to 2.4 %."""
_ENERGY = 0.1
"""Share of the exchanged energy that the coupling may add or take: 4 % where friction excites itself, and 31 % in a
limit cycle of too high gains; all other shipped scenarios stay below 0.2 %."""
_ENERGY_FLOOR = 1e-3
"""Residual [J] below which its share says nothing, as for an arm at rest."""


def run_checks(summary: Summary) -> Iterator[Check]:
    """Yield the checks of a complete run."""
    yield from _witness(summary)
    yield from _reference(summary)
    bond: Summary | None = summary.get("power_bond")
    if bond is not None:
        residual, exchanged = energies(bond)
        text = f"{number(residual)} J of {number(exchanged)} J exchanged; limit {100.0 * _ENERGY:g} %"
        passed = residual <= max(_ENERGY * exchanged, _ENERGY_FLOOR)
        yield Check("Energy residual of the coupling", passed, text)


def _witness(summary: Summary) -> Iterator[Check]:
    """Yield whether numbers of the components equal the results of their units' methods in numpy."""
    found: Summary | None = summary.get("witness")
    if found is None or not (found["components"] or found["faults"]):
        return
    text = f"{found['numbers']} numbers of {len(found['components'])} components at {len(found['times_s'])} times"
    if found["left_out"]:
        text += f"; without {', '.join(found['left_out'])}"
    yield Check("Equals the units in plain numpy", not found["faults"], "; ".join(found["faults"]) or text)


def _reference(summary: Summary) -> Iterator[Check]:
    """Yield whether the run equals the sampled reference, which has the master's schedule."""
    found: Summary | None = (summary.get("reference") or {}).get("sampled")
    errors, units = summary.get("max_position_error_deg"), summary.get("position_units")
    if found is None or "max_position_difference_rad" not in found or not errors or not units:
        return
    if "separation" in summary:
        apart = max(found["rms_position_difference"], found["rms_torque_difference"])
        text = f"a chaotic loop: RMS errors differ by {100 * apart:.2g} %; limit {100 * _STATISTICS:g} %"
        yield Check("Statistics of the scipy reference", apart <= _STATISTICS, text)
        return
    si = {"deg": math.pi / 180.0, "mm": 1e-3}
    limit = VISIBLE * max(si[unit] * error for error, unit in zip(errors, units, strict=True))
    apart = found["max_position_difference_rad"]
    what = "what three digits show"
    if limit < SHORT["atol"]:  # an arm that has hardly moved: the reference knows no more
        limit, what = SHORT["atol"], "the absolute tolerance of the reference's solver"
    text = f"positions differ by {number(apart)} rad at most; limit {number(limit)}, {what}"
    if apart > limit and summary.get("tolerance"):
        text += f"; a --tolerance below {summary['tolerance']:g} shows whether the solvers of the units do this"
    yield Check(f"Equals the {found['name']} scipy reference", apart <= limit, text)
