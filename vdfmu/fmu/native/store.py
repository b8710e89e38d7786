"""A cache of files by the digest of what they are made from."""

from __future__ import annotations

import os
import tempfile
from hashlib import sha256
from pathlib import Path

from vdfmu.kernel.functions import cache_folder

__all__ = ["load", "store"]

_LINE = 65
"""Length of the digest and its end of line, which come before the content."""


def load(kind: str, key: str) -> bytes | None:
    """Content of a file of the cache; None if there is none, or not the one that was written."""
    try:
        data = _path(kind, key).read_bytes()
    except OSError:
        return None
    digest, content = data[:_LINE], data[_LINE:]
    return content if digest == _digest(content) else None


def store(kind: str, key: str, content: bytes) -> None:
    """Write a file under a temporary name and rename it: nobody reads half a file. A full disk only costs time."""
    temporary = None
    path = _path(kind, key)
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


def _path(kind: str, key: str) -> Path:
    return cache_folder() / kind / key
