"""Solves the references of a run and compares the run with them."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.base.errors import UsageError
from vdfmu.base.measure import number
from vdfmu.base.progress import doing, report
from vdfmu.engine.algorithms import ALGORITHMS
from vdfmu.engine.results.results import Results
from vdfmu.study.run.case import RunCase, note
from vdfmu.study.run.simulate import simulate
from vdfmu.study.run.summary import compare, compared, has_signals
from vdfmu.system.reference.reference import BLOCK, reference_blocks

_NUDGE = 1e-9
"""Negligible relative change of the rotor inertias, below every tolerance of a scenario."""
_SLOW, _LONG = 3.0, 10.0
"""Time of a reference, relative to the run's and in s, from which both times are reported."""


class _Progress:
    """Reports the progress of a reference, and once that it takes much longer than `wall_s`, the steps of the run."""

    def __init__(self, case: RunCase, stage: str, wall_s: float) -> None:
        self._case, self._stage, self._wall_s = case, stage, wall_s
        self._began, self._first, self._is_said = math.inf, 0, False

    def __call__(self, done: int, total: int) -> None:
        report(self._stage, done, total)
        if not self._first:  # a first run compiles before its first rows
            self._began, self._first = time.perf_counter(), done
        whole = (time.perf_counter() - self._began) * total / max(done - self._first, 1)
        if whole > max(_SLOW * self._wall_s, _LONG) and not self._is_said:
            self._is_said = True
            times = number(whole / max(self._wall_s, 1e-3), 2)
            note(
                self._case.options,
                f"the {self._stage} takes about {number(whole, 2)} s, {times} times as long as the run: "
                "--reference-stop 10 compares only the first 10 s, --no-reference skips it",
            )


def compare_with_references(case: RunCase, package: Path, results: Results) -> dict[str, Any]:
    """Solve the sampled reference of the algorithm, if it samples, and the continuous one; return the entries.

    ``reference`` has the differences from each. If the first reference differs visibly from the run, the run is
    compared with itself after a negligible change. If these runs differ visibly too, single solutions separate; then
    ``separation`` has their distance, and the references are also compared by their statistics.
    """
    scenario, differences = case.scenario, dict[str, Any]()
    entries: dict[str, Any] = {"reference": differences}
    foreign = [name for name, part in scenario.system.parts.items() if part.fmu is not None]
    if foreign:
        return {"no_reference": f"{', '.join(foreign)}: an FMU has no equations to solve here"}
    visible = math.inf
    if has_signals(results, "trajectory.q_d", "plant.q"):
        visible = case.limits["reference"].value * max(
            float(np.abs(part["trajectory.q_d"] - part["plant.q"]).max()) for part in results.blocks(BLOCK)
        )
    how = ALGORITHMS[scenario.algorithm]
    stop = case.options["reference_stop"]
    rows = len(results) if stop is None else 1 + round(min(stop, scenario.stop) / scenario.step)
    if rows < len(results):
        entries["reference_stop"] = (rows - 1) * scenario.step
        results = results.first(rows)
    # without a feedforward torque in the controller there is no compensation error, so all outputs are compared
    robot = scenario.robot if "controller.tau_m" in scenario.system.fed else None
    wanted = {"sampled": how.reference} if how.reference else {}
    for key, name in (wanted | {"continuous": "continuous"}).items():
        stage = f"{name} reference"
        report(stage, 0, 1)
        solution = reference_blocks(
            name, case.system, step=scenario.step, stop=(rows - 1) * scenario.step,
            substeps=how.substeps if key == "sampled" else 1, groups=compared(results, robot), overlap=1,
            progress=_Progress(case, stage, results.summary.get("wall_s", 0.0)),
        )  # fmt: skip
        try:
            differences[key], statistics = compare(results, solution, robot, how.substeps)
        except UsageError as error:  # there is an algebraic loop, which the run may have solved
            entries["no_reference"] = str(error).rstrip(".")
            continue
        if len(differences) == 1 and differences[key].get("max_position_difference_rad", 0.0) > visible:
            with doing("separation"):
                separation = _separation(case, package, results)
            if separation > visible:
                entries["separation"] = {"change": _NUDGE, "max_position_difference_rad": separation}
        if "separation" in entries:
            differences[key] |= statistics
    return entries


def _separation(case: RunCase, package: Path, results: Results) -> float:
    """Largest difference [rad, m] of link positions from the same run with rotor inertias larger by `_NUDGE`."""
    parameters = {
        f"{plant}.{name}": (1.0 + _NUDGE) * value
        for plant in case.system.resolved.plants
        for name, value in case.system.values[plant].items()
        if name.startswith("I_m[")
    }
    nudged = simulate(case, package, parameters, record=["plant.q[*]"])
    pairs = zip(nudged.first(len(results)).blocks(BLOCK), results.blocks(BLOCK), strict=True)
    return max(float(np.abs(changed["plant.q"] - base["plant.q"]).max()) for changed, base in pairs)
