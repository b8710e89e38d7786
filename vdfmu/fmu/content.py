"""What an FMU carries beside its script: its unit, its robot, start values, and the version that built it."""

from __future__ import annotations

import dataclasses
import json
import uuid
from collections.abc import Mapping
from functools import cached_property
from hashlib import sha256
from pathlib import Path

from vdfmu import __version__
from vdfmu.errors import FmuError
from vdfmu.fmu.interface import MODEL_NAMES, Interface, interface
from vdfmu.kernel.structure import source_digest
from vdfmu.model import Robot, robot_from_dict

__all__ = ["CONTENT_FILE", "Content"]

CONTENT_FILE = "vdfmu.json"
_SOURCES = ("model", "equations", "kernel", "fmu")


@dataclasses.dataclass(frozen=True, eq=False)
class Content:
    """Content of one FMU.

    Attributes
    ----------
    unit : "trajectory", "feedforward", "controller" or "plant"
    robot : Robot
    start_values : mapping of str to float
        Start values that differ from those of the variable table.
    version, digest : str
        Version of vdfmu that built the FMU, and the digest of its sources.
    """

    unit: str
    robot: Robot
    start_values: Mapping[str, float]
    version: str = __version__
    digest: str = dataclasses.field(default_factory=lambda: source_digest(*_SOURCES))

    @property
    def model_name(self) -> str:
        """Model identifier."""
        return MODEL_NAMES[self.unit]

    @cached_property
    def guid(self) -> str:
        """GUID made from the content: the same content has the same GUID on every machine."""
        return "{" + str(uuid.UUID(bytes=sha256(self.to_json().encode()).digest()[:16])) + "}"

    def table(self) -> Interface:
        """Variable table with the start values of this FMU."""
        table = interface(self.unit, self.robot)
        start = {table.find(name): value for name, value in self.start_values.items()}
        cast = {"Real": float, "Integer": int, "Boolean": bool}
        table.variables = tuple(
            dataclasses.replace(v, start=cast[v.type](start[v])) if v in start else v for v in table.variables
        )
        return table

    def to_json(self) -> str:
        """Text of the content file."""
        data = {
            "unit": self.unit,
            "version": self.version,
            "digest": self.digest,
            "start_values": dict(sorted(self.start_values.items())),
            "robot": self.robot.to_dict(),
        }
        return json.dumps(data, indent=1, ensure_ascii=False) + "\n"

    @staticmethod
    def read(resources: Path) -> Content:
        """Content of an unpacked FMU from its folder ``resources``."""
        path = resources / CONTENT_FILE
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
            robot = robot_from_dict(data["robot"], CONTENT_FILE)
            return Content(data["unit"], robot, data["start_values"], data["version"], data["digest"])
        except (OSError, KeyError, ValueError) as error:
            raise FmuError(f"resources/{CONTENT_FILE} cannot be read ({error}). Build the FMU again.") from None

    def check_unit(self, unit: str) -> None:
        """Raise if this is the content of another unit."""
        if unit != self.unit:
            raise FmuError(f"resources/{CONTENT_FILE} belongs to unit {self.unit!r}, expected {unit!r}.")

    def check_version(self) -> None:
        """Raise if the installed vdfmu is not the one that built the FMU."""
        digest = source_digest(*_SOURCES)
        if (self.version, self.digest) != (__version__, digest):
            raise FmuError(
                f"{self.model_name}.fmu was built with vdfmu {self.version} (sources {self.digest[:8]}), but this Python has "
                f"vdfmu {__version__} (sources {digest[:8]}). Build the FMU again with `vdfmu build`, or install "
                f"vdfmu {self.version}."
            )
