"""The same system of native FMUs under this master, in a container and in two importers written in C++."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.importer_worker import MARK
from benchmarks.report import COLOURS, Report, Table, new_figure, tidy
from benchmarks.system import Clock, container_run, least, median, quiet_run, write_emptied
from vdfmu.arm.fmus import build_fmus
from vdfmu.compiler.c.compile import native_available
from vdfmu.engine.container import write_container
from vdfmu.system.package.write import write_ssp
from vdfmu.system.scenario import Scenario, load_scenario
from vdfmu.system.scenario.values import system_values

TITLE = "Native FMUs in other importers"
PACKAGES = {"ecos": ("ecospy", "tbb"), "libcosim": ("libcosimpy",)}
"""Importer to the Python packages that install it."""

MASTER, CONTAINER = "master, jacobi", "container FMU"
FORMS = ("native", "empty")


@dataclass
class Importers:
    """Times of one step [s].

    Attributes
    ----------
    wall, processor : dict of (importer, "native" or "empty") to list of (100,) arrays
        Blocks of each round, see :class:`benchmarks.system.Clock`; all importers take turns.
    differences : dict of importer to float [rad]
        Largest difference of the plant's final positions to those of the master.
    """

    step: float
    stop: float
    wall: dict[tuple[str, str], list[np.ndarray]] = field(default_factory=dict)
    processor: dict[tuple[str, str], list[np.ndarray]] = field(default_factory=dict)
    differences: dict[str, float] = field(default_factory=dict)

    def least(self, importer: str, form: str = "native") -> float:
        """Time of a step, of each block the least over the rounds [s]."""
        return least(self.wall[importer, form])

    def ratio(self, a: str, b: str) -> float:
        """Time of `a` over that of `b`, with native FMUs."""
        return self.least(a) / self.least(b)

    @property
    def importers(self) -> list[str]:
        """Names, in the order of the run."""
        return [importer for importer, form in self.wall if form == "native"]

    @property
    def others(self) -> list[str]:
        """Names of the importers that are not of this project."""
        return [importer for importer in self.importers if importer in PACKAGES]


def run(report: Report, quick: bool = False) -> None:
    """Measure, tabulate and draw."""
    if not native_available():
        report.facts["skipped"] = "the compiler of native FMUs is not installed (pip install .[native])"
        report.say(f"skipped: {report.facts['skipped']}")
        return
    absent = [importer for importer in PACKAGES if missing(importer)]
    for importer in absent:
        report.say(f"{missing(importer)}; its row is left out")
    report.facts["absent"] = absent
    others = [importer for importer in PACKAGES if importer not in absent]
    scenario = load_scenario("tracking")
    found = study(
        scenario, others, stop=2.0 if quick else scenario.stop, rounds=3 if quick else 7, say=report.say
    )
    tabulate(found, report)
    report.save(draw(found))


def missing(importer: str, packages: Mapping[str, Sequence[str]] = PACKAGES) -> str:
    """Say what is not installed of an importer, of those that need `packages`; empty if nothing."""
    for package in packages[importer]:
        try:
            version(package)
        except PackageNotFoundError:
            return f"{importer} needs {package}, which is not installed (pip install .[bench])"
    return ""


def study(
    scenario: Scenario, others: Sequence[str], *, stop: float, rounds: int, say: Callable[[str], None]
) -> Importers:
    """Run the package in all importers, in turns.

    The values of the scenario are the FMUs' start values, since not every importer applies all parameter sets
    of a package.
    """
    step, n = scenario.step, round(stop / scenario.step)
    found = Importers(step, stop)
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as name:
        folder = Path(name)
        values = system_values(scenario)
        fmus = build_fmus(scenario.arm, folder / "fmus", start_values=values, backend="native")
        package = write_ssp(scenario, fmus, folder / "native.ssp")
        packages = {"native": package, "empty": write_emptied(package, folder / "empty.ssp")}
        containers = {
            form: write_container(path, folder / f"{form}_container.fmu", step=step)
            for form, path in packages.items()
        }
        q: dict[str, np.ndarray] = {}
        say(
            f"{rounds} rounds of {stop:g} s at {step * 1e3:g} ms in each importer, with native and with empty FMUs"
        )
        for k in range(rounds):
            for form, path in packages.items():
                clock = Clock()
                results = quiet_run(path, step=step, stop=stop, algorithm="jacobi", progress=clock.progress)
                _note(found, MASTER, form, clock.wall, clock.processor)
                clock = Clock()
                folded = container_run(containers[form], stop=stop, step=step, progress=clock.progress)
                _note(found, CONTAINER, form, clock.wall, clock.processor)
                if form == "native":
                    q |= {MASTER: results["plant.q"][-1], CONTAINER: folded["plant.q"][-1]}
                for importer in others:
                    joints = scenario.arm.n if k == 0 and form == "native" else 0
                    seen = run_elsewhere(importer, path, step, n, joints)
                    _note(found, importer, form, np.divide(seen["wall"], n), np.divide(seen["processor"], n))
                    if joints:
                        q[importer] = np.array(seen["q"])
    found.differences = {
        importer: float(np.max(np.abs(values - q[MASTER]))) for importer, values in q.items()
    }
    return found


def _note(found: Importers, importer: str, form: str, wall: np.ndarray, processor: np.ndarray) -> None:
    found.wall.setdefault((importer, form), []).append(wall)
    found.processor.setdefault((importer, form), []).append(processor)


def run_elsewhere(importer: str, package: Path, step: float, n: int, joints: int) -> Mapping[str, Any]:
    """Time a package in another importer, and tell the plant's positions at the end if there are `joints`."""
    request = {"importer": importer, "path": str(package), "step": step, "steps": n}
    found = ask(request | {"run": "timed"})
    if joints:
        signals = [f"plant.q[{i + 1}]" for i in range(joints)]
        found["q"] = ask_rows(request | {"run": "rows", "signals": signals})[-1].tolist()
    return found


def ask(request: Mapping[str, Any], timeout: float = 600.0) -> dict[str, Any]:
    """Let a process of its own run what is asked for.

    Parameters
    ----------
    request : mapping
        ``run``: a key of :data:`benchmarks.importer_worker.RUNNERS`; ``path``, ``step`` [s] and ``steps`` of the run;
        ``importer``, ``signals``, ``out``, ``inputs``, ``parameter_set`` where the run takes them.
    timeout : float [s]

    Returns
    -------
    dict
        Its answer.

    Raises
    ------
    ImporterError
        With the importer's own words, or what is known of its end if it had none.
    """
    try:
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.importer_worker", json.dumps(dict(request))], timeout=timeout,
            capture_output=True, text=True, check=False, cwd=Path(__file__).parents[1],
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise ImporterError(f"no end after {timeout:g} s", crashed=True) from None
    answers = [line for line in done.stdout.splitlines() if line.startswith(MARK)]
    said = (done.stderr or done.stdout).strip()[-2000:]
    how = signal.strsignal(-done.returncode) if done.returncode < 0 else f"exit code {done.returncode}"
    if not answers:
        raise ImporterError(f"the process ended: {how}", crashed=True, said=said)
    found = json.loads(answers[-1].removeprefix(MARK))
    if "error" in found:
        raise ImporterError(found["error"])
    if done.returncode != 0:
        raise ImporterError(f"the process ended after the run: {how}", crashed=True, said=said)
    return found


def ask_rows(request: Mapping[str, Any], timeout: float = 600.0) -> np.ndarray:
    """Return the rows of a run with signals, (rows, signals); see :func:`ask`."""
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
        out = Path(folder) / "rows.npy"
        ask({**request, "out": str(out)}, timeout)
        return np.load(out)


class ImporterError(RuntimeError):
    """An importer refused or crashed; `crashed` tells which, `said` what it wrote last."""

    def __init__(self, message: str, *, crashed: bool = False, said: str = "") -> None:
        super().__init__(message)
        self.crashed = crashed
        self.said = said


# ------------------------------------------------------------------ reporting


def _name(importer: str) -> str:
    return f"{importer} {version(PACKAGES[importer][0])}" if importer in PACKAGES else f"vdfmu {importer}"


def tabulate(found: Importers, report: Report) -> None:
    """Show and keep the table and facts."""
    us = 1e6
    table = Table(
        "importers",
        f"The same native FMUs at {found.step * 1e3:g} ms, time of one step [us]",
        [("importer", ""), ("least", ".2f"), ("median", ".2f"), ("processor", ".2f"), ("empty FMUs", ".2f"),
         ("over this master", ".2f"), ("difference [rad]", ".1e")],
    )  # fmt: skip
    for importer in found.importers:
        table.add(
            _name(importer), us * found.least(importer), us * median(found.wall[importer, "native"]),
            us * least(found.processor[importer, "native"]), us * found.least(importer, "empty"),
            found.ratio(importer, MASTER), found.differences[importer],
        )  # fmt: skip
    table.notes += [
        f"Times of the steps alone over {found.stop:g} s, of {len(found.wall[MASTER, 'native'])} rounds in which all "
        "take turns. Least: the sum over a hundred blocks of the run, of each its shortest wall time in any round; "
        "median: of the whole runs; processor: as least, of the processor time of all threads. Ratios: of the least.",
        "All step Jacobi-wise. This master and the container record every output and input in each step; the others "
        "record nothing while they are timed.",
        "Empty FMUs: the same interface with functions that return at once, what remains is the importer's own time.",
        "Difference: of the plant's final positions to those of this master.",
    ]
    report.show(table)
    report.facts |= {
        "us_per_step": {i: us * found.least(i) for i in found.importers},
        "empty_us_per_step": {i: us * found.least(i, "empty") for i in found.importers},
        "over_master": {i: found.ratio(i, MASTER) for i in found.importers},
        "differences_rad": found.differences,
    }


def draw(found: Importers) -> Figure:
    """Bars: a step with native and with empty FMUs in each importer."""
    importers = sorted(found.importers, key=found.least)
    figure = new_figure(7.6, 1.2 + 0.5 * len(importers))
    axes = figure.add_subplot()
    colours = {"native": COLOURS["blue"], "empty": COLOURS["light"]}
    labels = {"native": "native FMUs", "empty": "empty FMUs: the importer's own time"}
    for i, importer in enumerate(importers):
        for k, form in enumerate(FORMS):
            value, y = 1e6 * found.least(importer, form), i + 0.36 * (k - 0.5)
            axes.barh(y, value, height=0.33, color=colours[form], label=labels[form] if i == 0 else None)
            axes.annotate(
                f"{value:.1f}", (value, y), (3, 0), textcoords="offset points", va="center", fontsize=8
            )
    axes.set_yticks(range(len(importers)), [_name(importer) for importer in importers])
    axes.invert_yaxis()
    axes.margins(x=0.08)
    axes.set_xlabel("time of one step [µs]")
    axes.set_title(f"the same system of four FMUs at {1e-3 / found.step:g} kHz", loc="left")
    tidy(axes, "x")
    axes.tick_params(axis="y", length=0)
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=8)
    return figure
