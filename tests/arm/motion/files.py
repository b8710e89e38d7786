"""Files of motions that tests write and read."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import vdfmu

Write = Callable[..., Path]


def writer(folder: Path) -> Write:
    """Return what writes a text into a file of a folder."""

    def write(text: str, name: str = "motion.toml") -> Path:
        path = folder / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


def require_read(written: Write, kind: str, table: str, robot: Any) -> None:
    """Read a kind of motion from a table: it lasts, and begins where it starts."""
    motion = vdfmu.load_motion(written(f'kind = "{kind}"\n{table}'), robot)
    assert motion.n == 2 and motion.duration > 0.5
    assert motion.unit().begin() == motion.start.tolist()
