"""The checks of a run: what its numbers show, and whether its sampled loops are stable, from poses along it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from vdfmu.base.errors import CosimError
from vdfmu.base.progress import doing
from vdfmu.engine.linear.growth import Growth, Poses
from vdfmu.engine.linear.loops import GROWTH
from vdfmu.engine.options import SimulatorOptions
from vdfmu.engine.results.verdict import Check
from vdfmu.engine.run import Interrupted, Results, Simulator
from vdfmu.study.analysis.arm_space import least_dry_friction
from vdfmu.study.report.sheets import energies, number
from vdfmu.study.report.summary_keys import Summary
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.solution import SHORT
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
