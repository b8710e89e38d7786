"""The loops of a run and its lowest mode: from the cache if an equal run stored them, else linearised."""

from __future__ import annotations

import json
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.base.cache import cache_folder, load, store
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.files import digest_of, temporary_folder
from vdfmu.base.sources import source_digest
from vdfmu.compiler.fmu.build import choose_backend
from vdfmu.engine.algorithms import ALGORITHMS
from vdfmu.engine.linear.growth import Poses
from vdfmu.engine.plan.inputs import read_inputs
from vdfmu.engine.results.recorder import Tap
from vdfmu.engine.results.results import Results
from vdfmu.study.analysis.loops import loops_of, poses_of
from vdfmu.study.analysis.modes import natural_modes
from vdfmu.study.run.case import RunCase
from vdfmu.study.run.pack import write_package
from vdfmu.study.run.simulate import simulate
from vdfmu.study.run.summary import has_signals
from vdfmu.system.scenario.values import robot_with

_POSES = 5
"""Number of poses along a run at which its lowest mode is calculated."""


class RunLoops:
    """The loops of a run, read along it by `taps` unless the cache has those of an equal run of the `package`."""

    def __init__(self, case: RunCase, package: Path | None = None) -> None:
        self._case = case
        self._place = None if package is None else _place_of(case, package)
        self._stored = load(self._place, _loops_from) if self._place else None
        self.poses = None if self._stored is not None else self._poses()
        """Functions that read the loops along the run; None if they are in the cache."""

    def _poses(self) -> Poses:
        return poses_of(self._case.system, again=bool(self._case.options["simulate"]))

    @property
    def taps(self) -> list[Tap]:
        """Functions that read along the run."""
        return [] if self.poses is None else [self.poses]

    def entries(self, results: Results) -> dict[str, Any]:
        """Return, after the run, the summary's entries on loops and lowest mode; they are stored."""
        if self._stored is None:
            self._stored = self._linearised()
            figures: dict[str, Any] = self._stored.setdefault("key_figures", {})
            figures |= self._mode(results)
            if self._place and "stability" not in self._stored:
                store(self._place, json.dumps(self._stored).encode())
        return self._stored

    def _linearised(self) -> dict[str, Any]:
        """Return the entries of this run; for Python FMUs from a run of their native twins."""
        case, poses = self._case, self.poses
        assert poses is not None
        if poses.lacking and case.backend == "python":
            self.poses = poses = self._poses()
            try:
                with temporary_folder("vdfmu_twin_") as folder:
                    package = write_package(case, Path(folder), choose_backend("native"))
                    simulate(case, package, record=(), taps=[poses])
            except UsageError as error:  # without a compiler
                return {"stability": {"reason": f"the native FMUs cannot be built: {error}", "expected": True}}
        return loops_of(poses, case.system, case.scenario.stop)

    def _mode(self, results: Results) -> dict[str, Any]:
        """Return the lowest mode of the links [Hz], motors held, at rest at some poses along the run, or nothing."""
        scenario = self._case.scenario
        if scenario.robot is None or not has_signals(results, "plant.q"):
            return {}
        robot = robot_with(scenario.plant_robot, self._case.system.values.get("plant", {}))
        modes: list[tuple[float, float]] = []
        for row in np.linspace(0, len(results) - 1, _POSES).astype(int):
            with suppress(VdfmuError):  # beyond an end stop, or too heavy for its motors, the arm cannot rest
                q = [results[f"plant.q[{i + 1}]"][row] for i in range(robot.n)]
                frequencies = natural_modes(robot, q, motors="held").frequency
                modes += [(float(frequency), float(results.time[row])) for frequency in frequencies[:1]]
        return {"mode": dict(zip(("value", "at_s"), min(modes), strict=True))} if modes else {}


def _loops_from(stored: bytes) -> dict[str, Any]:
    """Return the entries on the loops of a run from the cache; KeyError for other content."""
    loops = json.loads(stored)
    return {"key_figures": {name: {**figure} for name, figure in loops["key_figures"].items()}}


def _place_of(case: RunCase, package: Path) -> Path | None:
    """Return the cache key of the loops, from everything that determines them and a page; None for unknown masters."""
    scenario, algorithm = case.scenario, ALGORITHMS[case.scenario.algorithm]
    if not algorithm.stepper.startswith("vdfmu."):
        return None
    facts = [source_digest("study.runs"), np.__version__, digest_of(package), algorithm]
    facts += [table.digest for table in read_inputs(scenario.inputs, scenario.input_hold)]
    facts += [scenario.coupling, scenario.stop, scenario.step, bool(case.options["simulate"])]
    return cache_folder() / "loops" / sha256(repr(facts).encode()).hexdigest()
