"""Numbers of a run that need no reference: accuracy, errors of tracking and estimation, time at limits."""

from __future__ import annotations

from vdfmu.engine.algorithms import ALGORITHMS
from vdfmu.engine.masters.observer import Tap
from vdfmu.engine.results.results import Results
from vdfmu.study.run import summary as numbers
from vdfmu.study.run.accuracy import PowerBond, accuracy_notes
from vdfmu.study.run.case import RunCase, note


class Measures:
    """The numbers of a run. Its `taps` read along the run, `add` adds all of them to the summary after it."""

    def __init__(self, case: RunCase) -> None:
        self._case = case
        self._bond = PowerBond(case.scenario.robot) if case.scenario.robot else None

    @property
    def taps(self) -> list[Tap]:
        """What reads along the run."""
        return [] if self._bond is None else [self._bond]

    def add(self, results: Results) -> None:
        """Add the numbers to the summary of the results."""
        case, summary = self._case, results.summary
        scenario = case.scenario
        for text in (*numbers.start_notes(results, scenario), *accuracy_notes(results, case.system)):
            summary["notes"].append(text)
            note(case.options, text)
        summary["real_time_factor"] = scenario.stop / summary["wall_s"]
        if scenario.robot is not None:
            tau_m = scenario.system.fed.get("controller.tau_m", "")
            summary |= numbers.tracking_errors(results, scenario.robot, case.arm_limits, tau_m)
        summary |= numbers.time_at_limits(results, case.arm_limits)
        if numbers.has_signals(results, "plant.tau_s", "estimator.tau_s_hat", "estimator.tau_f_hat"):
            summary |= numbers.estimation_errors(results, ALGORITHMS[scenario.algorithm].substeps)
        summary |= {"paper": dict(scenario.paper)} | (self._bond.summary() if self._bond else {})
