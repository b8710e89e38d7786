"""The file of an arm's own drive."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from vdfmu.base.errors import UsageError
from vdfmu.base.files import read_text
from vdfmu.base.text import kind_text

_LARGEST = 2**20
"""Largest file of a drive [byte]."""


@dataclass(frozen=True)
class DriveFile:
    """The file of a drive. A robot keeps its text, so that the robot does not change with the file."""

    name: str
    """Name of the file, without a folder."""
    text: str
    place: str = field(default="", compare=False)
    """Path of the file in messages."""

    @staticmethod
    def read(name: str, folder: Path) -> DriveFile:
        """Read the file named by a robot or scenario in a folder. UsageError if it cannot be read."""
        if "\n" in name:
            raise UsageError(
                "drive must be the name of a Python file, got several lines of text. Save them as a file, such as "
                "my_drive.py, and name it: code is not run from inside a data file."
            )
        place = folder / name
        try:
            text = read_text(place, _LARGEST)
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or kind_text(error)
            raise UsageError(f"drive must be a Python file, got {name!r}: {reason}.") from None
        return DriveFile(place.name, text.replace("\r\n", "\n"), str(place))
