"""Runs a package in one other importer, in a process of its own: ``python -m benchmarks.importer_worker``.

Arguments: importer, package, step [s], number of steps, number of the plant's positions to tell. Prints one line of
JSON behind a mark: wall and processor time of each of a hundred blocks of the steps, and the positions at their end.
"""

from __future__ import annotations

import itertools
import json
import sys
import time
from collections.abc import Callable
from typing import Any

MARK = "@result "


def run_ecos(package: str, step: float, n: int, joints: int) -> dict[str, Any]:
    """Run in ecos."""
    from ecospy import EcosSimulation

    with EcosSimulation(ssp_path=package, step_size=step) as simulation:
        simulation.init()
        found = _timed(n, lambda first, last: simulation.step(last - first))
        found["q"] = [simulation.get_real(f"plant::q[{i + 1}]") for i in range(joints)]
        simulation.terminate()
    return found


def run_libcosim(package: str, step: float, n: int, joints: int) -> dict[str, Any]:
    """Run in libcosim, without an observer; then once more with one, to see the values."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver

    log_output_level(CosimLogLevel.ERROR)
    nanoseconds = round(step * 1e9)
    execution = CosimExecution.from_ssp_file(ssp_path=package, step_size=nanoseconds)
    found = _timed(n, lambda first, last: execution.simulate_until(last * nanoseconds))
    if joints:
        observed = CosimExecution.from_ssp_file(ssp_path=package, step_size=nanoseconds)
        observer = CosimObserver.create_last_value()
        observed.add_observer(observer)
        observed.simulate_until(n * nanoseconds)
        index = observed.slave_index_from_instance_name("plant")
        references = {v.name.decode(): v.reference for v in observed.slave_variables(index)}
        wanted = [references[f"q[{i + 1}]"] for i in range(joints)]
        found["q"] = list(observer.last_real_values(index, wanted))
    return found


def _timed(n: int, run: Callable[[int, int], Any]) -> dict[str, Any]:
    edges = [n * k // 100 for k in range(101)]
    marks = [(time.perf_counter(), time.process_time())]
    for first, last in itertools.pairwise(edges):
        run(first, last)
        marks.append((time.perf_counter(), time.process_time()))
    wall, processor = ([b - a for a, b in itertools.pairwise(values)] for values in zip(*marks, strict=True))
    return {"wall": wall, "processor": processor}


RUNNERS = {"ecos": run_ecos, "libcosim": run_libcosim}


def main() -> None:
    """Run what the command line names."""
    importer, package, step, n, joints = sys.argv[1:]
    found = RUNNERS[importer](package, float(step), int(n), int(joints))
    print(f"\n{MARK}{json.dumps(found)}", flush=True)


if __name__ == "__main__":
    main()
