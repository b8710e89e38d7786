"""Zip files whose bytes depend on their members alone, and what an FMU on disk is."""

from __future__ import annotations

import os
import re
import tempfile
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path

__all__ = ["guid_of", "pack_zip", "read_member"]

_EPOCH = (1980, 1, 1, 0, 0, 0)
_GUID = re.compile(rb'<fmiModelDescription[^>]* (?:guid|instantiationToken)="([^"]*)"')


def pack_zip(path: Path, members: Mapping[str, bytes]) -> None:
    """Write a zip file whose bytes depend on its members alone: sorted names, one time stamp, one mode."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as stream, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
            for name in sorted(members):
                entry = zipfile.ZipInfo(name, _EPOCH)
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.create_system = 3
                entry.external_attr = 0o644 << 16
                archive.writestr(entry, members[name])
        os.chmod(temporary, 0o644)  # a temporary file is its owner's alone
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def guid_of(path: Path) -> str | None:
    """GUID or instantiation token of an FMU on disk; None if there is none that can be read to its end."""
    try:
        with zipfile.ZipFile(path) as archive:
            if archive.testzip() is not None:  # a damaged member
                return None
            found = _GUID.search(archive.read("modelDescription.xml"))
    except (OSError, KeyError, ValueError, zipfile.BadZipFile, zlib.error):
        return None
    return found[1].decode() if found else None


def read_member(path: Path, name: str) -> bytes | None:
    """Content of one member; None if there is none that can be read."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.read(name)
    except (OSError, KeyError, ValueError, zipfile.BadZipFile, zlib.error):
        return None
