"""The FMUs of a system, unpacked for a run."""

from __future__ import annotations

from pathlib import Path

import fmpy

from vdfmu.base.errors import VdfmuError
from vdfmu.engine.fmu.description import COMPONENTS, is_ours
from vdfmu.engine.package.archive import Archive
from vdfmu.engine.plan.checked import Checked


def unpack_units(checked: Checked, folder: Path) -> tuple[dict[str, Path], bool]:
    """Unpack the FMUs of a system; return the folder of each by source, and whether to isolate them by default.

    That is for FMUs that this project did not build, by a mark that can be forged, and for components of WebAssembly,
    whose time and memory the sandbox leaves to isolation.

    VdfmuError if there is no room, or the folder's name keeps a Python FMU from running.
    """
    unpacked: dict[str, Path] = {}
    path, isolated = checked.system.path, any(d.sandboxed for d in checked.descriptions.values())
    with Archive(path, path.name) as package:
        for source in dict.fromkeys(d.source for d in checked.descriptions.values()):
            unpacked[source] = folder / f"{len(unpacked)}"
            try:
                with package.opened(source, source) as unit:
                    isolated = isolated or not is_ours(unit.names)
                    unit.extract(unpacked[source], _needed)
            except OSError as error:
                raise no_room(str(folder), error) from error
            _refuse_escapes(unpacked[source])
    return unpacked, isolated


def _refuse_escapes(folder: Path) -> None:
    """Raise where a Python FMU would crash the process: its wrapper decodes no URI escape except a space's."""
    uri = folder.as_uri()
    if (folder / "resources" / "slavemodule.txt").is_file() and "%" in uri.replace("%20", " "):
        raise VdfmuError(
            f"{folder}: Python FMUs cannot be run from a folder whose name has other than ASCII letters, digits and "
            "spaces. Choose another folder for temporary files with TMPDIR."
        )


def no_room(folder: str, error: OSError) -> VdfmuError:
    """Return the error of FMUs that cannot be unpacked."""
    return VdfmuError(
        f"{folder}: FMUs cannot be unpacked there: {error}. Free space, or choose another folder with TMPDIR."
    )


def _needed(member: str) -> bool:
    """Whether a member of an FMU is needed to run it."""
    places = "resources/", *(f"binaries/{name}/" for name in (fmpy.platform, fmpy.platform_tuple, COMPONENTS))
    return member == "modelDescription.xml" or member.startswith(places)
