"""Which importer runs what: the whole tracking system, its FMUs one by one, and what became of each."""

from __future__ import annotations

import platform
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

from benchmarks import importers
from benchmarks.importers import ImporterError, ask, ask_rows
from benchmarks.report import Report, Table
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.units import shipped_units
from vdfmu.base.errors import VdfmuError
from vdfmu.engine.container import write_container
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

PAGE = Path(__file__).resolve().parents[1] / "docs" / "interop.md"
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
            fmus = build_fmus(
                scenario.arm, self.fmus(kind, fmi), parameters=values, backend=kind, fmi_version=fmi, folded=True
            )
            write_ssp(scenario, fmus, self.package(kind, fmi), version=SSP_OF_FMI[fmi])
        for step in (self.step, EXACT_STEP):
            stop = round(self.stop / step) * step
            solved = reference("sampled-delayed", SystemDescription(scenario, values), step=step, stop=stop)
            np.save(self._reference(step), solved["plant.q"])
        for kind in self.kinds:
            for step in (self.step, EXACT_STEP):
                steps = round(self.stop / step)
                results = simulate(self.package(kind), step=step, stop=steps * step, algorithm="jacobi", record=["*"])
                arrays: dict[str, Any] = {name: results[name] for name in results.names}
                np.savez(self.recorded(kind, step), time=results.time, **arrays)
        return self

    def fmus(self, kind: str, fmi: str = "2.0") -> Path:
        """Folder of the FMUs."""
        return self.folder / f"{kind}-{fmi}"

    def package(self, kind: str, fmi: str = "2.0") -> Path:
        """Return the package of the system: SSP 1.0 with FMI 2.0, SSP 2.0 with FMI 3.0."""
        return self.folder / f"{kind}-{fmi}.ssp"

    def recorded(self, kind: str, step: float) -> Path:
        """All signals of our own ``jacobi`` run; an input has the value of the step that ends at a row."""
        return self.folder / f"jacobi-{kind}-{round(1e9 * step)}.npz"

    def _reference(self, step: float) -> Path:
        return self.folder / f"reference-{round(1e9 * step)}.npy"

    def reference(self, step: float | None = None) -> np.ndarray:
        """Link positions of the sampled-delayed reference, (rows, joints) [rad]."""
        return np.load(self._reference(self.step if step is None else step))

    def jacobi(self, kind: str, step: float | None = None) -> np.ndarray:
        """Link positions of our own run, (rows, joints) [rad]."""
        with np.load(self.recorded(kind, self.step if step is None else step)) as file:
            return np.stack([file[name] for name in self.signals], axis=1)

    def request(self, **more: Any) -> dict[str, Any]:
        """Return a request for the whole run and the link positions, see :func:`benchmarks.importers.ask`."""
        return {"step": self.step, "steps": self.steps, "signals": self.signals} | more

    def judge(self, tool: str, kind: str, rows: np.ndarray) -> Seen:
        """Compare rows with the reference and with our own run: every row, but those that a tool does not have.

        Without a row at the start, and only there, a tool gives nan.
        """
        jacobi = self.jacobi(kind)
        if rows.shape != jacobi.shape:
            return Seen(DEVIATES, words=f"{rows.shape[0]} rows, expected {jacobi.shape[0]}")
        if np.isnan(rows[1:]).any():
            return Seen(DEVIATES, words="values are nan")
        first = 1 if np.isnan(rows[0]).any() else 0
        to_reference, to_jacobi = (float(np.abs(rows - other)[first:].max()) for other in (self.reference(), jacobi))
        return Seen(RUNS if to_jacobi <= self.allowed(tool) else DEVIATES, to_reference, to_jacobi)

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
        q = self.reference()
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
    path = str(tracking.package(case.kind, case.fmi))
    request = tracking.request(run="rows", importer=case.tool, path=path)
    return tracking.judge(case.tool, case.kind, ask_rows(request))


def _alone(tracking: Tracking, case: Case) -> Seen:
    """Let the arm fall for half a second and compare the energy, a scalar, with that of the FMU of FMI 2.0 in fmpy."""
    plant = shipped_units()["plant"].__name__
    request = {"step": tracking.step, "steps": 500}
    signals = ["E_pot", "q"]
    answer = ask(request | {
        "run": "single", "importer": case.tool, "signals": signals,
        "path": str(tracking.fmus(case.kind, case.fmi) / f"{plant}.fmu"),
    })  # fmt: skip
    expected = ask_rows(request | {
        "run": "fmpy-fmu", "signals": ["E_pot"], "path": str(tracking.fmus(case.kind) / f"{plant}.fmu"),
    })[-1, 0]  # fmt: skip
    if abs(answer["E_pot"] - expected) > 1e-9 * abs(expected):
        return Seen(DEVIATES, words=f"E_pot = {answer['E_pot']!r} J, expected {expected!r} J")
    if answer["q"] == answer["E_pot"]:
        return Seen(DEVIATES, words="scalars are right; reading an array returns the value that was read before it")
    return Seen(RUNS, words="scalars are right")


def _in_fmpy(tracking: Tracking, case: Case) -> Seen:
    """Run the container of the system, or every unit by itself with the inputs of our own run."""
    if case.form == "one FMU":
        with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
            path = write_container(
                tracking.package(case.kind, case.fmi), Path(folder) / "system.fmu", step=tracking.step
            )
            return tracking.judge(case.tool, case.kind, ask_rows(tracking.request(run="fmpy-fmu", path=str(path))))
    largest = max(drive(tracking, case.kind, case.fmi).values())
    recorded = tracking.jacobi(case.kind, EXACT_STEP) - tracking.reference(EXACT_STEP)
    return Seen(
        RUNS if largest == 0.0 else DEVIATES,
        reference=float(np.abs(recorded).max()) + largest,
        jacobi=largest,
        words=f"at a step of 2^-10 s, all outputs over {tracking.stop:g} s" if not largest else "",
    )


def drive(
    tracking: Tracking, kind: str, fmi: str = "2.0", step: float = EXACT_STEP, stop: float | None = None
) -> dict[str, float]:
    """Drive each unit by itself with recorded inputs; largest difference of its outputs to the recorded ones."""
    with np.load(tracking.recorded(kind, step)) as file:
        arrays = {name: file[name] for name in file.files}
    connections = load_ssp(tracking.package("native")).connections
    differences: dict[str, float] = {}
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as name:
        folder = Path(name)
        outputs: dict[str, list[str]] = {}
        for unit in UNITS:
            of_unit = [name.removeprefix(f"{unit}.") for name in arrays if name.startswith(f"{unit}.")]
            fed = [c.end[1] for c in connections if c.end[0] == unit]
            outputs[unit] = [name for name in of_unit if name not in fed]
            inputs = {name: arrays[f"{unit}.{name}"] for name in fed}
            np.savez(folder / f"{unit}.npz", time=arrays["time"], **inputs)
        ask({
            "run": "fmpy-fmus", "step": step, "steps": round((tracking.stop if stop is None else stop) / step),
            "fmus": [{
                "path": str(tracking.fmus(kind, fmi) / f"{shipped_units()[unit].__name__}.fmu"),
                "signals": outputs[unit],
                "inputs": str(folder / f"{unit}.npz"), "out": str(folder / f"{unit}.npy"),
            } for unit in UNITS],
        })  # fmt: skip
        for unit, names in outputs.items():
            rows = np.load(folder / f"{unit}.npy")
            expected = np.stack([arrays[f"{unit}.{name}"] for name in names], axis=1)[: len(rows)]
            differences[unit] = float(np.abs(rows - expected).max())
    return differences


def _in_fmpy_ssp(tracking: Tracking, case: Case) -> Seen:
    request = tracking.request(run="fmpy-ssp", path=str(tracking.package(case.kind, case.fmi)))
    return tracking.judge(case.tool, case.kind, ask_rows(request))


def _in_fmucontainer(tracking: Tracking, case: Case) -> Seen:
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
        package = Path(folder) / "system.ssp"
        shutil.copy(tracking.package(case.kind, case.fmi), package)
        made = package.with_suffix(".fmu")
        options = ("-container", f"{package.name}:{tracking.step!r}", "-fmi", case.fmi[0])
        said = _command("fmucontainer", *options, folder=folder)
        if not made.is_file():
            return Seen(REFUSED, words=_words(said.strip().splitlines()[-1].partition("|")[2]))
        rows = ask_rows(tracking.request(run="fmpy-fmu", path=str(made)))
        return tracking.judge(case.tool, case.kind, rows)


def _in_fmutool(tracking: Tracking, case: Case) -> Seen:
    fmus = sorted(tracking.fmus(case.kind, case.fmi).glob("*.fmu"))
    said = "\n".join(_command("fmutool", "-input", str(path), "-check", folder=str(tracking.folder)) for path in fmus)
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
    counts = ask({"run": "pyssp", "path": str(tracking.package(case.kind, case.fmi))})
    return Seen(READS, words=f"{counts['connections']} connections, {counts['sets']} parameter sets, schemas kept")


_EXAMINERS: Mapping[str, Callable[[Tracking, Case], Seen]] = {
    "ecos": _in_importer,
    "libcosim": _in_importer,
    "fmpy.simulate_fmu": _in_fmpy,
    "fmpy.ssp": _in_fmpy_ssp,
    "fmucontainer": _in_fmucontainer,
    "fmutool -check": _in_fmutool,
    "pyssp_standard": _in_pyssp,
}


def write_page(rows: Sequence[Sequence[Any]], versions: str) -> None:
    """Write the rows, and the versions they are of, into the page of the documentation."""

    def cell(value: Any) -> str:
        return "-" if value is None else f"{value:.1e}" if isinstance(value, float) else str(value)

    begin, rule, end = "| tool | form |", "| --- |", "\n\n"
    page = PAGE.read_text(encoding="utf-8")
    head = page.index(begin)
    first = page.index("\n", page.index(rule, head)) + 1
    last = page.index(end, first)
    after = page.index("\n", last + len(end))
    lines = "\n".join(f"| {' | '.join(map(cell, row))} |" for row in rows)
    machine = f"{platform.system()}, {platform.machine()}"
    system = f"These results are from {machine}, with {versions.removeprefix('Versions: ')}"
    PAGE.write_text(f"{page[:first]}{lines}\n\n{system}{page[after:]}", encoding="utf-8")


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
            [("tool", ""), ("form", ""), ("FMUs", ""), ("FMI", ""), ("result", ""),
             ("difference to reference [rad]", ".1e"), ("difference to jacobi [rad]", ".1e"), ("remark", "")],
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
    if not quick and not absent:
        write_page(table.rows, str(table.notes[-1]))
        report.say(f"written to {PAGE.name}")
