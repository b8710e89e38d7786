"""A folder for users of other tools: the system in SSP 1.0 and 2.0, its results, a script that compares."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vdfmu.base.files import data_path, regular_target, replacing, require_ours, temporary_folder
from vdfmu.base.progress import counted
from vdfmu.base.standards import SSP_1, SSP_FORMATS
from vdfmu.engine.algorithms import DEFAULT, DELAYED
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.run import Results, simulate
from vdfmu.system.package.write import build_parts, write_ssp
from vdfmu.system.scenario import Scenario

ROWS = 1001
"""Most rows of a table of results: some 2 MB for six joints."""


def write_reference(scenario: Scenario, folder: Path, values: Mapping[str, Mapping[str, Any]]) -> list[Path]:
    """Write both packages of a scenario, the results of SSP 1.0 by two masters, README and script.

    Parameters
    ----------
    scenario : Scenario
    folder : Path
        Made if it is missing.
    values : mapping of unit to mapping of variable to value
        See :func:`vdfmu.system.scenario.values.system_values`.

    Returns
    -------
    list of Path
        The written files.
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
    readme = folder / "README.md"  # it says that tables and script, which cannot say so, are ours
    require_ours(*packages.values(), readme, *(() if readme.exists() else (*tables.values(), *texts)))
    for version, package in packages.items():
        with temporary_folder("vdfmu_") as built:
            fmus = build_parts(scenario, built, values, backend="native", fmi_version=SSP_FORMATS[version].fmi.name)
            write_ssp(scenario, fmus, package, values, version=version)
    system = load_ssp(packages[SSP_1.name])
    record = [
        f"{component.name}.{connector.name}"
        for component in system.components
        for connector in component.connectors.values()
        if connector.kind == "output"
    ]
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
