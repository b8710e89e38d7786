"""Whether the sampled loops of a run are stable, from its linearisation at poses along it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from vdfmu.base.errors import CosimError
from vdfmu.base.progress import doing
from vdfmu.engine.inspect.loops import GROWTH, Growth, Poses
from vdfmu.engine.options import SimulatorOptions
from vdfmu.engine.results.verdict import Check
from vdfmu.engine.run import Interrupted, Results, Simulator
from vdfmu.study.analysis.linear import least_dry_friction
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
    """Yield the check of a run's loops, if they were linearised."""
    if poses.lacking or not poses.systems:
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
    margin = poses.margin()
    if margin is None:
        return LoopCheck(Check(_NAME, True, f"{before}stable; margins are those of sampled signals"), {})
    modulus, time, opened = margin
    where = f"at {_place(opened, poses)}, {time:.3g} s"
    text = f"stable with a modulus margin of {modulus:.2g} {where}"
    if not modulus:
        text = f"stable over the run, but without a margin {where}"
    figure = {"value": modulus, "place": _place(opened, poses), "at_s": time}
    return LoopCheck(Check(_NAME, True, f"{before}{text}"), {"margin": figure})


def _unstable(growth: Growth, poses: Poses, before: str = "") -> LoopCheck:
    factor, place = math.exp(growth.rate * poses.systems[0][1].step), _place(growth.state, poses)
    text = (
        f"unstable since {growth.begin:.3g} s, {place}: disturbances grow by a factor of {factor:.3g} a step; "
        "its gains are too high, or too low, for this step"
    )
    figure = {"value": factor, "place": place, "at_s": growth.begin}
    return LoopCheck(Check(_NAME, False, f"{before}{text}"), {"unstable": figure})


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
