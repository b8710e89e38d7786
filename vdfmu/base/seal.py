"""Seals of what this user made: a look at a folder runs nothing in it without one.

The key is in the user's cache. Another user, another machine or an emptied cache has another.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import secrets
from pathlib import Path
from typing import Any

from vdfmu.base.cache import cache_folder, load, store

_NEW = secrets.token_bytes(32)
"""Key that this process stores if there is none, and uses if it cannot."""


def seal(*content: Any) -> str:
    """Return a text that nobody without the key can make of some JSON and the files whose paths are in it."""
    return _sealed(_keys()[0], content)


def is_own(found: object, *content: Any) -> bool:
    """Whether a text is this user's seal, see `seal`. Code of other content runs only if the user says so."""
    return any(hmac.compare_digest(_sealed(key, content).encode(), str(found).encode()) for key in _keys())


def _sealed(key: bytes, content: Any) -> str:
    return hmac.new(key, json.dumps(content, sort_keys=True, default=_digest).encode(), "sha256").hexdigest()


def _digest(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _keys() -> list[bytes]:
    """Return the keys. There are several if processes with an empty cache began at once."""
    folder = cache_folder() / "seals"
    stored = [key for path in sorted(folder.glob("*")) if (key := load(path))]
    if not stored:
        store(folder / secrets.token_hex(8), _NEW)
    return [*stored, _NEW]
