"""Which FMUs on disk were built here."""

from __future__ import annotations

import hashlib
from pathlib import Path

from vdfmu.compiler.functions.cache import cache_folder, load, store


def keep_record(path: Path, guid: str) -> None:
    """Note in the user's cache that an FMU of these bytes was built here, and its GUID or instantiation token."""
    store(_record(path), guid.encode())


def is_built(path: Path, guid: str) -> bool:
    """Whether an FMU on disk is, to the byte, one that was built here with this GUID or instantiation token.

    The GUID inside would not do: whoever changes a library leaves it as it is.
    """
    try:
        return path.is_file() and load(_record(path)) == guid.encode()
    except OSError:
        return False


def _record(path: Path) -> Path:
    with path.open("rb") as file:
        return cache_folder() / "built" / hashlib.file_digest(file, "sha256").hexdigest()
