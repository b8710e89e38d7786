"""Which FMUs a format of the system can hold."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from vdfmu.base.errors import StorageError, UsageError
from vdfmu.base.files import read_member
from vdfmu.base.standards import PYTHON_FMI, SSP_1, SSP_FORMATS, SspFormat
from vdfmu.compiler.c.platforms import native_available

_VERSION = re.compile(rb'<fmiModelDescription[^>]*\sfmiVersion="([^"]*)"')


def ssp_format(version: str) -> SspFormat:
    """Return a version of SSP by its name; UsageError for an unknown one."""
    if version not in SSP_FORMATS:
        raise UsageError(f"There is no SSP {version!r} here. There are: {', '.join(map(repr, SSP_FORMATS))}.")
    return SSP_FORMATS[version]


def fmi_of_format(form: str, backend: str | None) -> str:
    """Return the version of FMI that a version of SSP needs.

    Raises
    ------
    UsageError
        For an unknown version, or one that a backend or this installation has no units for.
    """
    version = ssp_format(form).fmi.name
    if version != PYTHON_FMI.name and backend == "python":
        raise UsageError(
            f"--ssp {form}: holds units of FMI {version}, but Python FMUs are of FMI {PYTHON_FMI.name}. "
            f"Leave out --backend python, or take --ssp {SSP_1.name}."
        )
    if version != PYTHON_FMI.name and not native_available():
        raise UsageError(
            f"--ssp {form}: holds native units of FMI {version}, whose compiler is not installed. "
            f"Install it (pip install vdfmu[native]), or take --ssp {SSP_1.name}."
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
    for component, fmu in fmus.items():
        content = read_member(Path(fmu), "modelDescription.xml")
        if content is None:
            raise StorageError(f"{component}: {fmu} is missing or no FMU. Build it with vdfmu.build_fmus.")
        found = _VERSION.search(content)
        got = found[1].decode() if found else "none"
        if got not in versions:
            raise UsageError(
                f"{component}: {what} holds units of FMI {' or '.join(versions)}, got {Path(fmu).name} of FMI {got}. "
                f'Build it with fmi_version="{versions[0]}".'
            )
        there.add(got)
    return sorted(there)
