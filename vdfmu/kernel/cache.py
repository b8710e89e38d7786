"""The user's cache: files behind the digest of their content."""

from __future__ import annotations

import os
import sys
import tempfile
from hashlib import sha256
from pathlib import Path

__all__ = ["cache_folder", "load", "store"]

_LINE = 65
"""Length of the digest and its end of line, which come before the content."""


def cache_folder() -> Path:
    """Folder of traced functions: ``VDFMU_CACHE_DIR``, else ``vdfmu`` in the user's cache folder."""
    chosen = os.environ.get("VDFMU_CACHE_DIR")
    if chosen:
        return Path(chosen)
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "vdfmu"


def load(path: Path) -> bytes | None:
    """Content of a file of the cache; None if there is none, or not the one that was written."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    digest, content = data[:_LINE], data[_LINE:]
    return content if digest == _digest(content) else None


def store(path: Path, content: bytes) -> None:
    """Write a file under a temporary name and rename it: nobody reads half a file. A full disk only costs time."""
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
        with os.fdopen(handle, "wb") as stream:
            stream.write(_digest(content) + content)
        os.replace(temporary, path)
    except OSError:
        pass
    else:
        temporary = None
    finally:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)


def _digest(content: bytes) -> bytes:
    return sha256(content).hexdigest().encode() + b"\n"
