"""Which importer runs what: the whole tracking system, its FMUs one by one, and what became of each."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import importer_worker, importers
from benchmarks.importers import ImporterError, ask
from benchmarks.report import Report, Table
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.units import shipped_units
from vdfmu.base.errors import VdfmuError
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.run.once import simulate
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.package.write import write_ssp
from vdfmu.system.reference.reference import reference
from vdfmu.system.scenario import Scenario, load_scenario
from vdfmu.system.scenario.values import system_values

TITLE = "The system in other importers"

PACKAGES = importers.PACKAGES | {
    "fmpy.simulate_fmu": ("fmpy",),
    "fmpy.ssp": ("fmpy",),
    "fmucontainer": ("fmu-manipulation-toolbox",),
    "fmutool -check": ("fmu-manipulation-toolbox",),
    "pyssp_standard": ("pyssp-standard",),
}
"""Tool to the Python packages that install it."""

SSP_OF_FMI = {"2.0": "1.0", "3.0": "2.0"}
UNITS = tuple(load_scenario("tracking").system.parts)
EXACT_STEP = 2.0**-10
"""A step [s] whose multiples and their differences have no rounding, about 1 ms."""

RUNS, DEVIATES, READS, REFUSED, CRASHES = "runs", "deviates", "reads", "refused", "crashes"


@dataclass(frozen=True)
class Case:
    """A tool, the form in which it gets the system, and the FMUs: ``python`` or ``native`` and their FMI version."""

    tool: str
    form: str
    kind: str
    fmi: str


_PYTHON, _NATIVE, _NATIVE_3 = ("python", "2.0"), ("native", "2.0"), ("native", "3.0")
_SSP = (("SSP 1.0", _PYTHON), ("SSP 1.0", _NATIVE), ("SSP 2.0", _NATIVE_3))
_SINGLE = tuple(("single units", units) for units in (_PYTHON, _NATIVE, _NATIVE_3))
_CASES = {
    "ecos": (*_SSP, ("plant alone", _NATIVE_3)),
    "libcosim": (*_SSP, ("plant alone", _NATIVE_3)),
    "fmpy.simulate_fmu": (("one FMU", _PYTHON), ("one FMU", _NATIVE), ("one FMU", _NATIVE_3), *_SINGLE),
    "fmpy.ssp": _SSP,
    "fmucontainer": _SSP,
    "fmutool -check": _SINGLE,
    "pyssp_standard": _SSP,
}
CASES = [Case(tool, form, *units) for tool, forms in _CASES.items() for form, units in forms]


@dataclass
class Seen:
    """What became of a case.

    Attributes
    ----------
    verdict : str
        ``runs``: as our ``jacobi``. ``deviates``: runs to another result. ``reads``: runs nothing, has no objections.
        ``refused``: with an error of its own. ``crashes``: the process died.
    reference, jacobi : float [rad] or None
        Largest difference of the link positions over all rows and joints to the reference and to our own run.
    words : str
        The error, or what there is to say.
    """

    verdict: str
    reference: float | None = None
    jacobi: float | None = None
    words: str = ""


class Tracking:
    """FMUs and packages of the tracking scenario, its reference and our own ``jacobi`` runs, in a folder.

    Parameters
    ----------
    folder : path
        Of :meth:`prepare`.
    stop : float, optional
        End of the runs [s]; default that of the scenario.
    kinds : sequence of str, optional
        Kinds of FMUs; default both.
    """

    def __init__(self, folder: Path, stop: float | None = None, kinds: Sequence[str] = ("python", "native")) -> None:
        self.folder = folder
        self.kinds = kinds
        self.scenario: Scenario = load_scenario("tracking")
        self.step = self.scenario.step
        self.stop = self.scenario.stop if stop is None else stop
        self.steps = round(self.stop / self.step)
        self.signals = [f"plant.q[{i + 1}]" for i in range(self.scenario.arm.n)]

    def prepare(self) -> Tracking:
        """Build, solve and run all that the cases are held against."""
        scenario, values = self.scenario, system_values(self.scenario)
        for kind, fmi in (each for each in (_PYTHON, _NATIVE, _NATIVE_3) if each[0] in self.kinds):
            folder = self.package(kind, fmi).with_suffix("")
            fmus = build_fmus(scenario.arm, folder, parameters=values, backend=kind, fmi_version=fmi, folded=True)
            write_ssp(scenario, fmus, self.package(kind, fmi), version=SSP_OF_FMI[fmi])
        for step in (self.step, EXACT_STEP):
            stop = round(self.stop / step) * step
            solved = reference("sampled-delayed", SystemDescription(scenario, values), step=step, stop=stop)
            np.savez(self._file("reference", step), **dict(zip(self.signals, solved["plant.q"].T, strict=True)))
            for kind in self.kinds:
                results = simulate(self.package(kind), step=step, stop=stop, algorithm="jacobi", record=["*"])
                arrays: dict[str, Any] = {name: results[name] for name in results.names}
                np.savez(self._file(kind, step), time=results.time, **arrays)
        return self

    def package(self, kind: str, fmi: str = "2.0") -> Path:
        """Return the package of the system: SSP 1.0 with FMI 2.0, SSP 2.0 with FMI 3.0."""
        return self.folder / f"{kind}-{fmi}.ssp"

    def fmu(self, unit: str, kind: str, fmi: str = "2.0") -> str:
        """Return the FMU of a unit."""
        return str(self.package(kind, fmi).with_suffix("") / f"{shipped_units()[unit].__name__}.fmu")

    def _file(self, run: str, step: float) -> Path:
        return self.folder / f"{run}-{round(1e9 * step)}.npz"

    def recorded(self, run: str, step: float | None = None) -> dict[str, NDArray[np.float64]]:
        """Return the signals of our own run of a kind of FMUs: an input has the value of the step that ends at a row.

        Of the ``reference`` they are the link positions.
        """
        with np.load(self._file(run, step or self.step)) as file:
            return dict(file)

    def positions(self, run: str = "reference", step: float | None = None) -> NDArray[np.float64]:
        """Link positions of a run or of the sampled-delayed reference, (rows, joints) [rad]."""
        recorded = self.recorded(run, step)
        return np.stack([recorded[name] for name in self.signals], axis=1)

    def judge(self, tool: str, kind: str, rows: Any) -> Seen:
        """Compare rows with the reference and with our own run: every row, but those that a tool does not have.

        Without a row at the start, and only there, a tool gives nan.
        """
        jacobi, rows = self.positions(kind), np.asarray(rows)
        if rows.shape != jacobi.shape:
            return Seen(DEVIATES, words=f"{rows.shape[0]} rows, expected {jacobi.shape[0]}")
        if np.isnan(rows[1:]).any():
            return Seen(DEVIATES, words="values are nan")
        first = 1 if np.isnan(rows[0]).any() else 0
        to_reference, to_jacobi = (float(np.abs(rows - other)[first:].max()) for other in (self.positions(), jacobi))
        return Seen(RUNS if to_jacobi <= self.allowed(tool) else DEVIATES, to_reference, to_jacobi)

    def run(self, tool: str, kind: str, run: Callable[..., Any], path: Path, **more: Any) -> Seen:
        """Judge the rows that a function of :mod:`benchmarks.importer_worker` returns of the whole run."""
        rows = ask(run, path=str(path), step=self.step, steps=self.steps, signals=self.signals, **more)
        return self.judge(tool, kind, rows)

    def allowed(self, tool: str) -> float:
        """Largest difference to our own run that the rounding of a tool's time explains [rad].

        The FMUs are the same and so are the calls, but not the time that comes with them. Ours is ``k * step``,
        rounded once. ecos adds up steps. libcosim counts nanoseconds and fmpy takes differences of times: both are
        right to the last digits of the time. A desired motion that is late by dt is off by ``speed * dt``, and the
        arm follows; twice that for what the loop makes of it on the way, and some roundings of the positions.
        """
        time = self.step * np.arange(self.steps + 1)
        late = 2.0 * float(np.spacing(self.stop))
        if tool == "ecos":
            late = float(np.abs(np.cumsum(np.full(self.steps, self.step)) - time[1:]).max())
        q = self.positions()
        speed = float(np.abs(np.diff(q, axis=0)).max()) / self.step
        return 2.0 * speed * late + 8.0 * float(np.spacing(np.abs(q).max()))


def missing(tool: str) -> str:
    """Say what is not installed of a tool; empty if nothing."""
    return importers.missing(tool, PACKAGES)


def examine(tracking: Tracking, case: Case) -> Seen:
    """Run a case."""
    try:
        return _EXAMINERS[case.tool](tracking, case)
    except ImporterError as error:
        return Seen(CRASHES if error.crashed else REFUSED, words=_words(str(error)))
    except VdfmuError as error:
        return Seen(REFUSED, words=_words(f"vdfmu: {error}"))


def _words(text: str) -> str:
    """Return the first line, without the folders of a path, which are other ones in each run."""
    return re.sub(r"(?<![\w.])/(?:[^\s/']+/)+", "", text.strip().splitlines()[0])


def _in_importer(tracking: Tracking, case: Case) -> Seen:
    """Run a package in ecos or libcosim."""
    if case.form == "plant alone":
        return _alone(tracking, case)
    path = tracking.package(case.kind, case.fmi)
    return tracking.run(case.tool, case.kind, importer_worker.rows, path, importer=case.tool)


def _alone(tracking: Tracking, case: Case) -> Seen:
    """Let the arm fall for half a second and compare the energy, a scalar, with that of the FMU of FMI 2.0 in fmpy."""
    step, steps, path = tracking.step, 500, tracking.fmu("plant", case.kind, case.fmi)
    E_pot, q = ask(
        importer_worker.single, importer=case.tool, path=path, step=step, steps=steps, signals=["E_pot", "q"]
    )
    path = tracking.fmu("plant", case.kind)
    [*_, [expected]] = ask(importer_worker.fmpy_fmu, path=path, step=step, steps=steps, signals=["E_pot"])
    if abs(E_pot - expected) > 1e-9 * abs(expected):
        return Seen(DEVIATES, words=f"E_pot = {E_pot!r} J, expected {expected!r} J")
    if q == E_pot:
        return Seen(DEVIATES, words="scalars are right; reading an array returns the value that was read before it")
    return Seen(RUNS, words="scalars are right")


def _in_fmpy(tracking: Tracking, case: Case) -> Seen:
    """Run the container of the system, or every unit by itself with the inputs of our own run."""
    if case.form == "one FMU":
        from vdfmu.extras.container import write_container  # the other tools need no extra

        with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
            package = tracking.package(case.kind, case.fmi)
            path = write_container(package, Path(folder) / "system.fmu", step=tracking.step)
            return tracking.run(case.tool, case.kind, importer_worker.fmpy_fmu, path)
    largest = max(drive(tracking, case.kind, case.fmi).values())
    off = tracking.positions(case.kind, EXACT_STEP) - tracking.positions(step=EXACT_STEP)
    return Seen(
        RUNS if largest == 0.0 else DEVIATES,
        reference=float(np.abs(off).max()) + largest,
        jacobi=largest,
        words=f"at a step of 2^-10 s, all outputs over {tracking.stop:g} s" if not largest else "",
    )


def drive(
    tracking: Tracking, kind: str, fmi: str = "2.0", step: float = EXACT_STEP, stop: float | None = None
) -> dict[str, float]:
    """Drive each unit by itself with recorded inputs; largest difference of its outputs to the recorded ones."""
    recorded = tracking.recorded(kind, step)
    connections = load_ssp(tracking.package("native")).connections
    differences: dict[str, float] = {}
    for unit in UNITS:
        signals = {name.removeprefix(f"{unit}."): x for name, x in recorded.items() if name.startswith(f"{unit}.")}
        inputs = {c.end[1]: signals.pop(c.end[1]) for c in connections if c.end[0] == unit}
        rows = ask(
            importer_worker.fmpy_fmu, path=tracking.fmu(unit, kind, fmi), step=step, signals=[*signals],
            steps=round((tracking.stop if stop is None else stop) / step),
            recorded={"time": recorded["time"], **inputs},
        )  # fmt: skip
        expected = np.stack([*signals.values()], axis=1)[: len(rows)]
        differences[unit] = float(np.abs(rows - expected).max())
    return differences


def _in_fmpy_ssp(tracking: Tracking, case: Case) -> Seen:
    return tracking.run(case.tool, case.kind, importer_worker.fmpy_ssp, tracking.package(case.kind, case.fmi))


def _in_fmucontainer(tracking: Tracking, case: Case) -> Seen:
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
        package = Path(folder) / "system.ssp"
        shutil.copy(tracking.package(case.kind, case.fmi), package)
        made = package.with_suffix(".fmu")
        options = ("-container", f"{package.name}:{tracking.step!r}", "-fmi", case.fmi[0])
        said = _command("fmucontainer", *options, folder=folder)
        if not made.is_file():
            return Seen(REFUSED, words=_words(said.strip().splitlines()[-1].partition("|")[2]))
        return tracking.run(case.tool, case.kind, importer_worker.fmpy_fmu, made)


def _in_fmutool(tracking: Tracking, case: Case) -> Seen:
    fmus = [tracking.fmu(unit, case.kind, case.fmi) for unit in UNITS]
    said = "\n".join(_command("fmutool", "-input", path, "-check", folder=str(tracking.folder)) for path in fmus)
    verdicts = [line.strip() for line in said.splitlines() if "compliant" in line or "semantic error" in line]
    kinds = dict.fromkeys(line.partition("|")[2].strip() for line in verdicts)
    good = all("seems to be compliant" in kind or kind.startswith("No semantic error") for kind in kinds)
    return Seen(READS if good and len(verdicts) == 2 * len(fmus) else DEVIATES, words=" ".join(kinds))


def _command(name: str, *arguments: str, folder: str) -> str:
    program = Path(sys.executable).parent / name
    done = subprocess.run(
        [program, *arguments], cwd=folder, text=True, check=False, timeout=300,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    return done.stdout


def _in_pyssp(tracking: Tracking, case: Case) -> Seen:
    connections, sets = ask(importer_worker.pyssp, path=str(tracking.package(case.kind, case.fmi)))
    return Seen(READS, words=f"{connections} connections, {sets} parameter sets, schemas kept")


_EXAMINERS: Mapping[str, Callable[[Tracking, Case], Seen]] = {
    "ecos": _in_importer,
    "libcosim": _in_importer,
    "fmpy.simulate_fmu": _in_fmpy,
    "fmpy.ssp": _in_fmpy_ssp,
    "fmucontainer": _in_fmucontainer,
    "fmutool -check": _in_fmutool,
    "pyssp_standard": _in_pyssp,
}


def run(report: Report, quick: bool = False) -> None:
    """Examine all cases whose tool is installed, and tabulate."""
    absent = {tool: text for tool in PACKAGES if (text := missing(tool))}
    for text in absent.values():
        report.say(f"{text}; its rows are left out")
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
        tracking = Tracking(Path(folder), 1.0 if quick else None).prepare()
        table = Table(
            "interop",
            f"The tracking system, {tracking.stop:g} s at {1e3 * tracking.step:g} ms",
            [("tool", ""), ("form", ""), ("FMUs", ""), ("FMI", ""), ("seen", ""), ("to reference [rad]", ".1e"),
             ("to jacobi [rad]", ".1e"), ("words", "")],
        )  # fmt: skip
        for case in CASES:
            if case.tool not in absent:
                seen = examine(tracking, case)
                row = (case.tool, case.form, case.kind, case.fmi, seen.verdict, seen.reference, seen.jacobi)
                table.add(*row, seen.words.replace("|", "/"))
        allowed = {tool: tracking.allowed(tool) for tool in ("ecos", "libcosim")}
    table.notes += [
        "To reference, to jacobi: largest difference of the link positions over all rows and joints, to scipy's "
        "sampled-delayed reference and to this master's jacobi run; for single units of all outputs.",
        f"Rounding of time explains {allowed['ecos']:.1e} rad in ecos, {allowed['libcosim']:.1e} rad in the others.",
        "Versions: " + ", ".join(
            f"{package} {version(package)}"
            for package in dict.fromkeys(p for tool, ps in PACKAGES.items() if tool not in absent for p in ps)
        ) + ".",
    ]  # fmt: skip
    report.show(table)
