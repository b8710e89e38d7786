"""What it costs to split a system over processes, and from how long a component's step on it pays."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pythonfmu.builder import FmuBuilder

import vdfmu
from benchmarks.report import COLOURS, Report, Table, new_figure, tidy
from benchmarks.system import Clock, least, median, packed, quiet
from vdfmu.base.files import pack_zip
from vdfmu.compiler.c.compile import native_available
from vdfmu.engine.federation import CORES
from vdfmu.engine.package.system import Component, Connection, Connector, System
from vdfmu.system.scenario import load_scenario

TITLE = "Federates"
SPLITS: dict[str, Sequence[str]] = {"2": ["plant"], "4": ["plant", "feedforward", "controller"]}
_FASTEST = ("tcp_ss", "ipc")
"""The default, and the one for a single machine."""
BURNS = (0.0, 1e-4, 3e-4, 1e-3, 3e-3)
"""Processor time [s] that each component takes a step."""


def measured(quick: bool) -> tuple[str, int, int, int]:
    """Return the scenario, the steps of its runs, those of the components that take a while, and the rounds."""
    return ("planar_tracking", 100, 40, 1) if quick else ("tracking", 500, 300, 4)


def run(report: Report, quick: bool = False) -> None:
    """Measure, tabulate and draw."""
    name, steps, others, rounds = measured(quick)
    _arm(report, name, steps, rounds)
    _burners(report, others, rounds)


def _step(system: Path | System, options: dict[str, Any], step: float, steps: int) -> np.ndarray:
    """Return the wall times of the blocks of a run over its steps [s]."""
    clock = Clock()
    call = vdfmu.federate if "split" in options else vdfmu.simulate
    call(system, start=0.0, stop=steps * step, step=step, progress=clock.progress, log=quiet, **options)
    return clock.wall


def _arm(report: Report, name: str, steps: int, rounds: int) -> None:
    """Time a step of the arm in one process and in several."""
    scenario = load_scenario(name)
    forms: dict[tuple[str, str], dict[str, Any]] = {
        ("1", "none"): {"algorithm": "jacobi", "isolate": False},
        ("1, apart", "none"): {"algorithm": "jacobi", "isolate": True},
        **{(n, core): {"split": split, "core": core} for core in CORES for n, split in SPLITS.items()},
    }
    blocks: dict[tuple[str, str], list[np.ndarray]] = {form: [] for form in forms}
    with packed(scenario, "native" if native_available() else "python") as package:
        for _ in range(rounds):
            for form, options in forms.items():
                blocks[form].append(_step(package, options, scenario.step, steps))
    table = Table(
        "federation",
        f"A step of {name} in several processes",
        [
            ("processes", ""),
            ("HELICS core", ""),
            ("least [us]", ".0f"),
            ("median [us]", ".0f"),
            ("exchange [us]", ".0f"),
        ],
    )
    one = least(blocks["1", "none"])
    for (n, core), found in blocks.items():
        exchange = None if core == "none" else 1e6 * (least(found) - one)
        table.add(n, core, 1e6 * least(found), 1e6 * median(found), exchange)
        report.facts[f"{n} {core}"] = {"least_s": least(found), "median_s": median(found)}
    table.notes += [
        "least: of each hundredth of the run the least of all rounds; median: of whole runs. exchange: least, beyond "
        "that of one process.",
    ]
    report.show(table)


def _burners(report: Report, steps: int, rounds: int) -> None:
    """Time two components that take a while, in one process and in two, and find from when on two are faster."""
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
        system = _ring(Path(folder))
        times: dict[str, list[float]] = {"1": []}
        forms: dict[str, dict[str, Any]] = {"1": {"algorithm": "jacobi", "isolate": False}}
        for core in _FASTEST:
            times[core], forms[core] = [], {"split": ["a"], "core": core}
        for burn in BURNS:
            report.say(f"{1e3 * burn:g} ms a component")
            blocks: dict[str, list[np.ndarray]] = {form: [] for form in forms}
            for _ in range(rounds):
                for form, options in forms.items():
                    parameters = {"a.burn": burn, "b.burn": burn}
                    blocks[form].append(_step(system, options | {"parameters": parameters}, 1e-3, steps))
            for form, found in blocks.items():
                times[form].append(least(found))
    table = Table(
        "federation_break_even",
        "A step of two components that take a time each, in one process and in two",
        [
            ("each takes [us]", ".0f"),
            ("one process [us]", ".0f"),
            *[(f"two, {core} [us]", ".0f") for core in _FASTEST],
        ],
    )
    for i, burn in enumerate(BURNS):
        table.add(1e6 * burn, *(1e6 * each[i] for each in times.values()))
    found = {core: break_even(BURNS, times["1"], times[core]) for core in _FASTEST}
    table.notes += [
        "Of each hundredth of the run the least of all rounds. Two processes are faster from "
        + ", ".join(
            f"{'none measured' if t is None else f'{1e6 * t:.0f} us'} ({core})" for core, t in found.items()
        )
        + " on that each component takes.",
    ]
    report.show(table)
    report.facts |= {"burns_s": BURNS, "step_s": times, "break_even_s": found}
    figure = new_figure(5.6, 3.6)
    axes = figure.add_subplot()
    for (form, each), colour in zip(times.items(), (*COLOURS.values(), "#7a4ea3"), strict=False):
        label = "one process" if form == "1" else f"two, {form}"
        axes.plot(1e3 * np.array(BURNS), 1e3 * np.array(each), "o-", color=colour, label=label, markersize=3)
    axes.set_xlabel("each component takes [ms]")
    axes.set_ylabel("a step takes [ms]")
    axes.legend(frameon=False)
    tidy(axes)
    report.save(figure)


def _ring(folder: Path) -> System:
    """Return a system of two burners that read each other."""
    fmu = Path(FmuBuilder.build_FMU(Path(__file__).with_name("burner.py"), dest=folder))
    package, member = folder / "ring.ssp", "resources/burner.fmu"
    pack_zip(package, {member: fmu.read_bytes()})
    ports = {name: Connector(name, kind) for name, kind in (("u", "input"), ("y", "output"))}
    burners = tuple(Component(name, member, "CoSimulation", ports) for name in "ab")
    ring = Connection(("a", "y"), ("b", "u"), ()), Connection(("b", "y"), ("a", "u"), ())
    return System(package, "ring", burners, ring, {})


def break_even(loads: Sequence[float], one: Sequence[float], two: Sequence[float]) -> float | None:
    """Return the load from which on `two` takes less than `one`, between the loads by a line; None if none does.

    Parameters
    ----------
    loads : (m,) [s], ascending
    one, two : (m,) [s]
        Times at these.
    """
    gain = np.array(one) - np.array(two)
    later = np.flatnonzero(gain <= 0.0)
    if not later.size:
        return float(loads[0])
    i = int(later[-1])
    if i + 1 == len(gain):
        return None
    return float(loads[i] + (loads[i + 1] - loads[i]) * gain[i] / (gain[i] - gain[i + 1]))
