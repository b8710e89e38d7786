"""Where the data files that travel with the package lie."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from vdfmu.base.errors import VdfmuError

PACKAGE = Path(__file__).resolve().parents[1]


def data_path(kind: Literal["models", "ssp", "fmu_src", "examples"]) -> Path:
    """Return the folder of one kind of data file; VdfmuError if there is none.

    A wheel carries the folders in ``vdfmu/_data``. A source tree, which an editable install uses, has them at its root.
    """
    places = (PACKAGE / "_data" / kind, PACKAGE.parent / kind)
    for place in places:
        if place.is_dir():
            return place
    looked = " or ".join(str(place) for place in places)
    raise VdfmuError(f"data folder {kind!r} not found: expected {looked}. Reinstall vdfmu.")


def source_bytes(file: Path) -> bytes:
    """Return the content of a file of source, with the ends of lines of Unix on every system."""
    return file.read_bytes().replace(b"\r\n", b"\n")
