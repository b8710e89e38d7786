"""Which FMUs a format of the system can hold."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from vdfmu.base.errors import StorageError, UsageError
from vdfmu.base.files import read_member
from vdfmu.compiler.c import native_available

FMI_OF_SSP = {"1.0": "2.0", "2.0": "3.0"}
"""Version of SSP to the version of FMI of the units in it."""
FORMATS = (*FMI_OF_SSP, "osp")
"""Formats of ``vdfmu ssp``: versions of SSP, and OSP."""
_VERSION = re.compile(rb'<fmiModelDescription[^>]*\sfmiVersion="([^"]*)"')


def require_version(version: str) -> str:
    """Return the version of FMI that a version of SSP holds here.

    Raises
    ------
    UsageError
        For an unknown version.
    """
    if version not in FMI_OF_SSP:
        raise UsageError(f"There is no SSP {version!r} here. There are: {', '.join(map(repr, FMI_OF_SSP))}.")
    return FMI_OF_SSP[version]


def fmi_of_format(form: str, backend: str | None) -> str:
    """Return the version of FMI that a format of ``vdfmu ssp`` needs.

    Raises
    ------
    UsageError
        For an unknown format, or one that a backend or this installation has no units for.
    """
    if form not in FORMATS:
        raise UsageError(f"--format {form}: expected one of {', '.join(FORMATS)}.")
    version = FMI_OF_SSP.get(form, "2.0")
    if version != "2.0" and backend == "python":
        raise UsageError(
            f"--format {form}: holds units of FMI {version}, but Python FMUs are of FMI 2.0. "
            "Leave out --backend python, or take --format 1.0."
        )
    if version != "2.0" and not native_available():
        raise UsageError(
            f"--format {form}: holds native units of FMI {version}, whose compiler is not installed. "
            "Install it (pip install vdfmu[native]), or take --format 1.0."
        )
    return version


def require_fmi(fmus: Mapping[str, str | os.PathLike[str]], versions: Sequence[str], what: str) -> list[str]:
    """Check the versions of FMI of the units that go into a package, and return those that there are.

    Raises
    ------
    StorageError
        If an FMU is missing or cannot be read.
    UsageError
        If one is of another version: names of arrays and of their elements differ between the two.
    """
    there: set[str] = set()
    for unit, fmu in fmus.items():
        content = read_member(Path(fmu), "modelDescription.xml")
        if content is None:
            raise StorageError(f"{unit}: {fmu} is missing or no FMU. Build it with vdfmu.build_fmus.")
        found = _VERSION.search(content)
        got = found[1].decode() if found else "none"
        if got not in versions:
            raise UsageError(
                f"{unit}: {what} holds units of FMI {' or '.join(versions)}, got {Path(fmu).name} of FMI {got}. "
                f'Build it with fmi_version="{versions[0]}".'
            )
        there.add(got)
    return sorted(there)
