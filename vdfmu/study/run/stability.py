"""The check of a run's loops: whether its disturbances grow, and how near they come to it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from vdfmu.base.errors import CosimError
from vdfmu.base.progress import doing
from vdfmu.engine.linear.growth import Poses
from vdfmu.engine.options import SimulatorOptions
from vdfmu.engine.results.results import Results
from vdfmu.engine.results.verdict import DOUBTFUL, GOOD, Check
from vdfmu.engine.run import Interrupted, Simulator
from vdfmu.study.analysis.loops import Judged, judged, place_of, told
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.scenario import Scenario

_NAME = "Sampled loops"


class LoopCheck(NamedTuple):
    """The check of a run's loops."""

    check: Check
    figures: dict[str, Any]
    """Entries of ``key_figures`` of a summary: ``margin``, or where disturbances grow, ``unstable``."""


def simulated(scenario: Scenario, package: Path, parameters: Any = None, **options: Any) -> Results:
    """Co-simulate a scenario; for `options` see :meth:`vdfmu.Simulator.run`, and `log`."""
    own: SimulatorOptions = {
        **scenario.coupling, "inputs": scenario.inputs, "parameters": parameters, "log": options.pop("log", None),
    }  # fmt: skip
    with Simulator(package, **own) as simulator:
        return simulator.run(start=0.0, stop=scenario.stop, step=scenario.step, **options)


def explain(error: CosimError | Interrupted, poses: Poses) -> list[LoopCheck]:
    """Return the check of the loops of a run that failed, if they are unstable, and say so in the error."""
    if poses.lacking or not poses.seconds or isinstance(error, Interrupted):
        return []
    found = judged(poses, 0.0, error.time, failed=True)
    if not found.growth.unstable:
        return []
    check = _check(found)
    error.add_note(f"{_NAME}: {check.check.text}")
    return [check]


def loop_checks(poses: Poses, system: SystemDescription) -> Iterator[LoopCheck]:
    """Yield the check of a run's loops, if there are any."""
    if not any(target.endswith(".tau") for targets in system.connections.values() for target in targets):
        return
    if poses.lacking or not poses.seconds:
        why = poses.lacking or "components in a process of their own are not linearised"
        words = f"stability not judged ({why.partition('. ')[0]})"
        yield LoopCheck(Check(_NAME, DOUBTFUL, f"not judged: {why}", words), {})
        return
    with doing("stability"):
        yield _check(judged(poses, 0.0, system.scenario.stop))


def _check(found: Judged) -> LoopCheck:
    (state, text), (loops, growth, excited) = found.words, found
    figures, nearest = dict[str, Any](), None if growth.unstable else loops.nearest()
    if growth.unstable:
        factor = math.exp(growth.rate * loops.system.step)
        figures["unstable"] = {"value": factor, "place": place_of(growth.state, loops), "at_s": growth.begin}
    elif nearest is not None:
        figures["margin"] = {
            "value": nearest.modulus, "place": place_of(nearest.name, loops), "at_s": nearest.time,
        } | ({"without_dry_friction": True} if excited else {})  # fmt: skip
    words = "" if state == GOOD else (told(loops) if state == DOUBTFUL else "") or text.partition(": ")[0]
    return LoopCheck(Check(_NAME, state, text, words), figures)
