"""Builds the FMUs of a run and writes its package."""

from __future__ import annotations

from pathlib import Path

from vdfmu.base.files import temporary_folder
from vdfmu.base.progress import doing
from vdfmu.study.run.case import RunCase
from vdfmu.system.package.write import cached_fmus, write_ssp


def write_package(case: RunCase, folder: Path, backend: str | None = None) -> Path:
    """Write ``system.ssp`` to a folder and return its path. `backend` replaces the case's."""
    with doing("build"), temporary_folder("vdfmu_fmus_") as place:
        fmus = cached_fmus(case.scenario, place, backend or case.backend, case.options["fmi_version"])
        return write_ssp(case.scenario, fmus, folder / "system.ssp", case.system.values, mixed=True)
