"""The system of a scenario, packed for a benchmark."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from vdfmu.cosim import LogMessage, Results, simulate
from vdfmu.fmu import build_fmus
from vdfmu.model import Scenario
from vdfmu.ssp.write import write_ssp

__all__ = ["packed", "quiet_run"]


@contextmanager
def packed(scenario: Scenario) -> Generator[Path]:
    """Build the four Python FMUs and the package of a scenario in a temporary folder."""
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
        fmus = build_fmus(scenario.robot, Path(folder) / "fmus")
        yield write_ssp(scenario, fmus, Path(folder) / f"{scenario.name}.ssp")


def quiet_run(
    package: Path,
    *,
    step: float,
    stop: float,
    algorithm: str = "gauss-seidel",
    tolerance: float | None = None,
) -> Results:
    """Run a package; messages of the units other than errors are dropped.

    Parameters
    ----------
    tolerance : float, optional
        Of the plant's solver, in place of the package's.
    """

    def log(message: LogMessage) -> None:
        if message.status in ("error", "fatal"):
            logging.getLogger("benchmarks").error("%s", message)

    parameters = None if tolerance is None else {"plant.tolerance": tolerance}
    return simulate(
        package, start=0.0, stop=stop, step=step, algorithm=algorithm, parameters=parameters, log=log
    )
