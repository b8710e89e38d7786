"""The check of the loops of a run: whether they are stable, from poses along it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from vdfmu.base.errors import CosimError, UsageError
from vdfmu.base.progress import doing
from vdfmu.engine.linear.growth import Growth, Poses
from vdfmu.engine.linear.loops import GROWTH
from vdfmu.engine.options import SimulatorOptions
from vdfmu.engine.results.verdict import DOUBTFUL, FAILED, GOOD, Check
from vdfmu.engine.run import Interrupted, Results, Simulator
from vdfmu.study.analysis.arm_space import least_dry_friction
from vdfmu.study.run.verdict import since
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
    if not poses.systems or isinstance(error, Interrupted):
        return []
    growth = poses.growth(0.0, error.time)
    if growth.rate <= GROWTH:
        return []
    found = _unstable(growth, poses)
    error.add_note(f"{_NAME}: {found.check.text}")
    return [found]


def loop_checks(poses: Poses, system: SystemDescription, package: Path) -> Iterator[LoopCheck]:
    """Yield the check of a run's loops, if there are any."""
    if not any(target.endswith(".tau") for targets in system.connections.values() for target in targets):
        return
    if poses.lacking or not poses.systems:
        why = poses.lacking or "components in a process of their own are not linearised"
        words = f"stability not judged ({why.partition('. ')[0]})"
        yield LoopCheck(Check(_NAME, DOUBTFUL, f"not judged: {why}", words), {})
        return
    scenario, robots = system.scenario, system.resolved.robots
    growth = poses.growth(0.0, scenario.stop)
    split = {p: robot for p in system.resolved.plants if (robot := robots[p]) and robot.friction == "split"}
    if not growth.unstable:
        yield _stable(poses)
    elif split:
        with doing("stability"):
            smooth = Poses("tau")
            still = {f"{p}.{name}": x for p in split for name, x in least_dry_friction(system.values[p]).items()}
            simulated(scenario, package, still, record=(), visitor=smooth)
        alone = smooth.growth(0.0, scenario.stop)
        excited = f"friction 'split' excites itself, most at {_place(growth.state, poses)}; without dry friction"
        if not alone.unstable:
            yield _stable(smooth, f"{excited} ")
        else:
            yield _unstable(alone, smooth, f"{excited} ")
    else:
        yield _unstable(growth, poses)


def _stable(poses: Poses, before: str = "") -> LoopCheck:
    try:
        margin = poses.margin()
    except UsageError as error:  # a loop of several rates
        return LoopCheck(Check(_NAME, GOOD, f"{before}stable, with no margin: {error}"), {})
    if margin is None:
        return LoopCheck(Check(_NAME, GOOD, f"{before}stable; margins are those of sampled signals"), {})
    modulus, time, opened = margin
    where = f"at {_place(opened, poses)}, {time:.3g} s"
    figures = {"margin": {"value": modulus, "place": _place(opened, poses), "at_s": time}}
    if modulus:
        return LoopCheck(Check(_NAME, GOOD, f"{before}stable with a modulus margin of {modulus:.2g} {where}"), figures)
    text = f"stable over the run, but without a margin {where}"
    return LoopCheck(Check(_NAME, DOUBTFUL, f"{before}{text}", text), figures)


def _unstable(growth: Growth, poses: Poses, before: str = "") -> LoopCheck:
    factor, place = math.exp(growth.rate * poses.systems[0][1].step), _place(growth.state, poses)
    figure = {"value": factor, "place": place, "at_s": growth.begin}
    words = f"unstable {since(figure)}, {place}"
    text = f"{words}: disturbances grow by a factor of {factor:.3g} a step; check the gains and the step"
    return LoopCheck(Check(_NAME, FAILED, f"{before}{text}", words), {"unstable": figure})


def _place(name: str, poses: Poses) -> str:
    """Return the joint of a state or input of a plant, or of a value waiting at a controller; other names unchanged."""
    component, _, variable = name.removeprefix("at ").partition(".")
    states = poses.systems[0][1].parts.states
    arms = [arm for arm, _, _ in (opened.partition(".") for opened in poses.opened)]
    arms = [arm for arm in arms if any(state.startswith(f"{arm}.") for state in states)]
    index = re.search(r"\[(\d+)\]$", variable)
    if index is None or (component not in arms and not name.startswith("at ")):
        return name
    return f"joint {index[1]}" + (f" of {component}" if len(arms) > 1 else "")
