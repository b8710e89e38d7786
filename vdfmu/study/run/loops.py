"""The loops of a run: from the cache if an equal run left them there, else linearised along the run."""

from __future__ import annotations

import json
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.base.cache import cache_folder, load, store
from vdfmu.base.errors import UsageError
from vdfmu.base.files import digest_of, temporary_folder
from vdfmu.compiler.fmu.build import choose_backend
from vdfmu.compiler.functions.sources import source_digest
from vdfmu.engine.algorithms import ALGORITHMS
from vdfmu.engine.masters.observer import Tap
from vdfmu.engine.plan.inputs import read_inputs
from vdfmu.study.analysis.loops import loops_of, poses_of
from vdfmu.study.run.case import RunCase
from vdfmu.study.run.pack import write_package
from vdfmu.study.run.simulate import simulate


class RunLoops:
    """The loops of a run. `taps` read along it, unless the cache has the loops of an equal run of the `package`."""

    def __init__(self, case: RunCase, package: Path | None = None) -> None:
        self._case = case
        self.poses = poses_of(case.system, again=bool(case.options["simulate"]))
        self._place = None if package is None else _place_of(case, package)
        self._stored = load(self._place, _loops_from) if self._place else None

    @property
    def taps(self) -> list[Tap]:
        """What reads along the run."""
        return [] if self._stored is not None else [self.poses]

    def entries(self) -> dict[str, Any]:
        """Return the entries of the summary about the loops, after the run; they are stored."""
        if self._stored is None:
            self._stored = self._linearised()
            if self._place and "stability" not in self._stored:
                store(self._place, json.dumps(self._stored).encode())
        return self._stored

    def _linearised(self) -> dict[str, Any]:
        """Return the entries of this run; those of Python FMUs from a run of their native twins."""
        case = self._case
        if self.poses.lacking and case.backend == "python":
            self.poses = poses_of(case.system, again=bool(case.options["simulate"]))
            try:
                with temporary_folder("vdfmu_twin_") as folder:
                    package = write_package(case, Path(folder), choose_backend("native"))
                    simulate(case, package, record=(), taps=[self.poses])
            except UsageError as error:  # without a compiler
                return {"stability": {"reason": f"the native FMUs cannot be built: {error}", "expected": True}}
        return loops_of(self.poses, case.system, case.scenario.stop)


def _loops_from(stored: bytes) -> dict[str, Any]:
    """Return the entries about the loops of a run from the cache; KeyError for other content."""
    loops = json.loads(stored)
    return {"key_figures": {name: {**figure} for name, figure in loops["key_figures"].items()}}


def _place_of(case: RunCase, package: Path) -> Path | None:
    """Return the place of the loops in the cache, by all that decides them and a page; None for unknown masters."""
    scenario, algorithm = case.scenario, ALGORITHMS[case.scenario.algorithm]
    if not algorithm.stepper.startswith("vdfmu."):
        return None
    facts = [source_digest("study.runs"), np.__version__, digest_of(package), algorithm]
    facts += [table.digest for table in read_inputs(scenario.inputs, scenario.input_hold)]
    facts += [scenario.coupling, scenario.stop, scenario.step, bool(case.options["simulate"])]
    return cache_folder() / "loops" / sha256(repr(facts).encode()).hexdigest()
