"""Jobs with scenarios: a run with its pictures and page, and a folder for users of other tools."""

from __future__ import annotations

import os
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Unpack

from vdfmu.base.cache import one_job
from vdfmu.base.errors import CosimError
from vdfmu.base.files import data_path, regular_target, replacing, require_ours, temporary_folder
from vdfmu.base.option import pick, with_options
from vdfmu.base.progress import counted, doing, with_progress
from vdfmu.base.standards import SSP_1, SSP_FORMATS
from vdfmu.engine.algorithms import DEFAULT, DELAYED
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.results.folder import RUN_OUTPUTS, known_formats, known_pictures, replacing_results, write_summary
from vdfmu.engine.results.results import Results
from vdfmu.engine.run import Interrupted, simulate
from vdfmu.study.options import ScenarioOptions, ScenarioRunOptions
from vdfmu.study.report.content import write_pictures
from vdfmu.study.report.page import write_failed, write_report
from vdfmu.study.report.shown_run import NAME, ShownRun
from vdfmu.study.report.simulation import keep_program
from vdfmu.study.run.case import RunCase, describe
from vdfmu.study.run.conclude import conclude
from vdfmu.study.run.loops import RunLoops
from vdfmu.study.run.measure import Measures
from vdfmu.study.run.pack import write_package
from vdfmu.study.run.prepare import prepare
from vdfmu.study.run.simulate import co_simulate
from vdfmu.system.package.write import build_parts, write_ssp
from vdfmu.system.scenario import Scenario


@with_progress
@one_job()
@with_options
def run(scenario: Scenario | str | os.PathLike[str], **options: Unpack[ScenarioRunOptions]) -> Results:
    """Run a scenario and write its results, ``summary.json`` and figures.

    Parameters
    ----------
    scenario : Scenario, str or path
        A loaded scenario, the name of a shipped one, a file, or "reach", a first motion of any robot.
    **options
        :class:`vdfmu.study.options.ScenarioRunOptions`.

    Returns
    -------
    Results
        Recorded signals; `summary` is the content of ``summary.json``.

    Raises
    ------
    UsageError, ModelError, SspError
        Before the run, for faults of scenario, robot, options or system.
    CosimError, vdfmu.engine.run.Interrupted
        A unit failed, or the user stopped the run. The rows up to then are in the folder's ``partial``.
    """
    case = describe(prepare(scenario, **pick(ScenarioOptions, options)), options)
    known_formats(options["formats"])
    width = known_pictures(options["pictures"], options["width"])
    with _folder_of(case) as folder:
        package = write_package(case, folder)
        program = keep_program(case.system, package) if case.written else None
        loops, measures = RunLoops(case, package), Measures(case)
        try:
            results = co_simulate(case, package, loops.poses, [*measures.taps, *loops.taps])
        except (CosimError, Interrupted) as error:
            if case.written:
                write_failed(case.scenario.name, package, folder, error, program, simulate=bool(options["simulate"]))
            raise
        measures.add(results)
        if case.written:
            write_summary(results.summary, folder)  # references may take long, and may be stopped
        conclude(case, package, results, loops)
        if case.written:
            with doing("figures"):
                write_pictures(results, case.scenario.robot, folder, options["pictures"], width, options["serif"])
            with doing("page"):
                shown = ShownRun(case.scenario.name, results, results.summary, package, loops.poses, program)
                write_report([shown], folder / NAME, simulate=bool(options["simulate"]))
            write_summary(results.summary, folder)
        return results


@contextmanager
def _folder_of(case: RunCase) -> Generator[Path]:
    """Yield the folder that a run writes; at the end its files replace those of an earlier run."""
    out = case.options["out"]
    if not case.written:
        with temporary_folder("vdfmu_run_") as place:
            yield Path(place)
        return
    folder = Path(out or "") if out is not None else Path("results") / case.scenario.name
    with replacing_results(folder, RUN_OUTPUTS, case.options["overwrite"]) as place:
        yield Path(place)


ROWS = 1001
"""Most rows of a table of results: some 2 MB for six joints."""


def write_reference(scenario: Scenario, folder: Path, values: Mapping[str, Mapping[str, Any]]) -> list[Path]:
    """Write both packages of a scenario, results of SSP 1.0 from two masters, README and script; return their paths.

    The folder is made if it is missing. For `values` of units see :func:`vdfmu.system.scenario.values.system_values`.
    """
    packages = {
        version: folder / f"{scenario.name}{'' if version == SSP_1.name else f'_{version}'}.ssp"
        for version in SSP_FORMATS
    }
    tables = {algorithm: folder / f"{scenario.name}_{algorithm}.csv" for algorithm in (DELAYED, DEFAULT)}
    source = data_path("ssp") / "reference"
    texts = {folder / name: (source / name).read_text(encoding="utf-8") for name in ("README.md", "compare.py")}
    for path in (*packages.values(), *tables.values(), *texts):
        regular_target(path)
    readme = folder / "README.md"  # its mark also covers tables and script
    require_ours(*packages.values(), readme, *(() if readme.exists() else (*tables.values(), *texts)))
    for version, package in packages.items():
        with temporary_folder("vdfmu_") as built:
            fmus = build_parts(scenario, built, values, backend="native", fmi_version=SSP_FORMATS[version].fmi.name)
            write_ssp(scenario, fmus, package, values, version=version)
    system = load_ssp(packages[SSP_1.name])
    record = [f"{part.name}.{each.name}" for part in system.components for each in part.connectors.values()
              if each.kind == "output"]  # fmt: skip
    stride = 1
    thinned: dict[Path, Results] = {}
    for algorithm, table in counted("results", tables.items(), len(tables)):
        results = simulate(system, algorithm=algorithm, record=record)
        thinned[table] = results.thinned(ROWS)
        stride = -(-len(results) // len(thinned[table]))
    facts = {
        "name": scenario.name, "stop": scenario.stop, "step": scenario.step, "tolerance": scenario.tolerance,
        "stride": stride,
    }  # fmt: skip
    for path, text in texts.items():
        with replacing(path) as file:
            file.write((text.format(**facts) if path.suffix == ".md" else text).encode())
    for table, results in thinned.items():
        results.write(table)
    return [*packages.values(), *tables.values(), *texts]
