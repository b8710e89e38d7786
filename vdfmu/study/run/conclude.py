"""Compares a run with its references, judges its coupling error, and adds key figures and verdict to its summary."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Unpack

from vdfmu.base.option import pick, with_options
from vdfmu.engine.options import SimulatorOptions
from vdfmu.engine.results.results import Results
from vdfmu.study.judgement import judge
from vdfmu.study.options import ScenarioOptions, ScenarioRunOptions
from vdfmu.study.run.case import RunCase, describe
from vdfmu.study.run.key_figures import key_figures
from vdfmu.study.run.loops import RunLoops
from vdfmu.study.run.measure import Measures
from vdfmu.study.run.prepare import prepare
from vdfmu.study.run.references import compare_with_references
from vdfmu.study.run.simulate import simulate
from vdfmu.study.verdict import verdict
from vdfmu.system.scenario import Scenario
from vdfmu.system.scenario.values import robot_with


def conclude(case: RunCase, package: Path, results: Results, loops: RunLoops) -> None:
    """Add the requested references and judgement, then key figures and verdict, to the summary of a run."""
    summary, scenario, values = results.summary, case.scenario, case.system.values
    if case.options["reference"]:
        summary |= compare_with_references(case, package, results)
    if case.expected is not None:
        summary["expected"] = case.expected.compare(results)
    if case.options["judge"] is not None:
        coupling: SimulatorOptions = {**scenario.coupling, "inputs": scenario.inputs}
        judgement = judge(
            package,
            case.options["judge"],
            stop=scenario.stop,
            step=scenario.step,
            sampled=case.options["sampled"],
            **coupling,
        )
        summary["judgement"] = judgement.to_dict()
    entries = loops.entries(results)
    figures: dict[str, Any] = summary.get("key_figures", {})
    if scenario.robot is not None:
        plant = robot_with(scenario.plant_robot, values.get("plant", {}))
        touch = scenario.system.fed.get("plant.F_e", "")
        figures |= key_figures(results, scenario.robot, case.arm_limits, plant, touch, summary["scene"]["objects"])
    summary |= entries | {"key_figures": figures | entries.get("key_figures", {})}
    summary["verdict"] = verdict(summary, case.limits)


@with_options
def judge_results(results: Results, scenario: Scenario, package: Path, **options: Unpack[ScenarioRunOptions]) -> None:
    """Add the verdict of :func:`vdfmu.run` to the summary of a run of a scenario's package.

    The package is run again for the values that are read along a run.
    """
    case = describe(prepare(scenario, **pick(ScenarioOptions, options)), options)
    case = case._replace(parameters=options["parameters"] or {})
    loops, measures = RunLoops(case), Measures(case)
    simulate(case, package, record=(), taps=[*measures.taps, *loops.taps])
    results.summary.update({**case.facts, **results.summary})
    measures.add(results)
    conclude(case, package, results, loops)
