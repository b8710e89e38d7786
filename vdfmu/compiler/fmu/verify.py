"""Whether an FMU is, to the bit, what its sources make: it is built again from what it carries."""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

from vdfmu.base.cache import COMPILER, cache_folder
from vdfmu.base.errors import FmuError, UsageError
from vdfmu.base.files import temporary_folder
from vdfmu.base.version import __version__
from vdfmu.compiler.fmu.content import CONTENT_PLACES, EFMU, Content, installed_digest, tool_of
from vdfmu.compiler.unit.base import BaseUnit


def verify(path: Path, unit: type[BaseUnit] | None = None) -> list[str]:
    """Build an FMU anew, without the cache, and return how it differs; nothing where it is the same to the bit.

    Parameters
    ----------
    path : Path
        An FMU that vdfmu built.
    unit : type of BaseUnit, optional
        The unit of an FMU of a user's own. Its own file would show nothing: that is not run.

    Raises
    ------
    FmuError
        If it is not an FMU of vdfmu, or of another version, which cannot make the same bits.
    UsageError
        If its unit is missing.
    """
    members = _members(path)
    place = next((place for place in CONTENT_PLACES.values() if place in members), "")
    try:
        data = json.loads(members[place])
        name, backend, made = str(data["unit"]), str(data["backend"]), (str(data["digest"]), str(data["tool"]))
        model = ElementTree.fromstring(members["modelDescription.xml"]).find(".//*[@modelIdentifier]")
        model_name = model.attrib["modelIdentifier"] if model is not None else ""
        here = installed_digest(backend), tool_of(backend)
    except (ValueError, LookupError, TypeError, ElementTree.ParseError):
        raise FmuError(
            f"{path}: not an FMU of a unit that vdfmu built: {CONTENT_PLACES['native']} does not say which unit it is "
            "of."
        ) from None
    if made != here:
        raise FmuError(
            f"{path}: made by vdfmu {data.get('version')} (digest {made[0][:8]}) and {made[1]}, here are {__version__} "
            f"({here[0][:8]}) and {here[1]}: only the same make the same bits. Install those."
        )
    if data.get("module") is None and unit is None:
        raise UsageError(
            f"{path}: its unit {name} is a file of a user's own, and that in an FMU shows nothing. Name it: --unit "
            "my_unit.py."
        )
    if any(member.startswith(f"{EFMU}/") for member in members):
        raise FmuError(f"{path}: an eFMU; only plain FMUs are built again. Build it with --target efmi and compare.")
    with temporary_folder("vdfmu_verify_") as folder:
        content = Content.of(data, unit, f"{path}: {place}", model_name)
        return _differences(members, _members(_built(content, data.get("platforms"), Path(folder) / "again")))


def _built(content: Content, platforms: Sequence[str] | None, folder: Path) -> Path:
    """Build the FMU of a content in a folder, with a cache of its own that shares the compiler's library."""
    before = {name: os.environ.get(name) for name in ("VDFMU_CACHE_DIR", "ZIG_GLOBAL_CACHE_DIR")}
    os.environ.setdefault("ZIG_GLOBAL_CACHE_DIR", str(cache_folder() / COMPILER))
    os.environ["VDFMU_CACHE_DIR"] = str(folder / "cache")
    target = folder / f"{content.model_name}.fmu"
    folder.mkdir()
    try:
        if content.backend == "native":
            from vdfmu.compiler.fmu.native import build_native_fmus

            build_native_fmus({target: content}, platforms)
        else:
            from vdfmu.compiler.fmu.python.package import build_python_fmu

            build_python_fmu(content, target)
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
    return target


def _members(path: Path) -> dict[str, bytes]:
    """Return the files of an FMU."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name for name in archive.namelist() if not name.endswith("/")]
            if len(set(names)) < len(names):
                raise FmuError(f"{path}: it has a file twice, of which tools may take either.")
            return {name: archive.read(name) for name in names}
    except FileNotFoundError:
        raise UsageError(f"{path}: there is no such file.") from None
    except (OSError, zipfile.BadZipFile, RuntimeError) as error:
        raise FmuError(f"{path}: cannot be read as an FMU: {error}.") from None


def _differences(found: Mapping[str, bytes], expected: Mapping[str, bytes]) -> list[str]:
    """Return a line for each file that is not the same."""
    said: list[str] = []
    for name in sorted({*found, *expected}):
        if name not in expected:
            said.append(f"{name}: is not in an FMU of these sources")
        elif name not in found:
            said.append(f"{name}: is missing")
        elif found[name] != expected[name]:
            said.append(f"{name}: differs, {len(found[name])} bytes, {len(expected[name])} in the one built again")
    return said
