"""What an FMU carries beside its script: its unit, its robot, start values, and the version that built it."""

from __future__ import annotations

import dataclasses
import json
import uuid
from collections.abc import Mapping
from functools import cached_property, lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import pythonfmu as pythonfmu_package

from vdfmu import __version__
from vdfmu.data import data_path
from vdfmu.errors import FmuError, UsageError, VdfmuError
from vdfmu.fmu.interface import MODEL_NAMES, Interface, interface
from vdfmu.kernel.structure import source_digest
from vdfmu.model import Robot, robot_from_dict

__all__ = ["CONTENT_FILE", "Content", "installed_digest"]

CONTENT_FILE = "vdfmu.json"
_SOURCES = ("model", "equations", "kernel", "fmu")
_CAST = {"Real": float, "Integer": int, "Boolean": bool}


@lru_cache
def installed_digest() -> str:
    """Digest of all that decides what FMUs compute: vdfmu's sources, the scripts, CasADi's version."""
    digest = sha256(source_digest(*_SOURCES).encode())
    for script in sorted((data_path("fmu_src") / "python").glob("*.py")):
        digest.update(script.read_bytes().replace(b"\r\n", b"\n"))
    return digest.hexdigest()


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
        Version of vdfmu that built the FMU, and :func:`installed_digest` there.
    pythonfmu : str
        Version of pythonfmu, whose binaries the FMU carries.
    """

    unit: str
    robot: Robot
    start_values: Mapping[str, float]
    version: str = __version__
    digest: str = dataclasses.field(default_factory=installed_digest)
    pythonfmu: str = pythonfmu_package.__version__

    @property
    def model_name(self) -> str:
        """Model identifier."""
        return MODEL_NAMES[self.unit]

    @cached_property
    def guid(self) -> str:
        """GUID made from the content: the same content has the same GUID on every machine."""
        return "{" + str(uuid.UUID(bytes=sha256(self.to_json().encode()).digest()[:16])) + "}"

    def table(self) -> Interface:
        """Variable table with the start values of this FMU.

        Raises
        ------
        UsageError
            If a start value has no variable, belongs to an output or is out of its limits; names all of them.
        """
        table = interface(self.unit, self.robot)
        start: dict[str, Any] = {}
        problems: list[str] = []
        for name, value in self.start_values.items():
            variable = table.find(name)
            if variable.causality == "output":
                problems.append(f"{name} is an output, which has no start value.")
            elif problem := variable.problem(value):
                problems.append(f"{name}: {problem}.")
            else:
                start[name] = _CAST[variable.type](value)
        if problems:
            raise UsageError(f"start values of {self.unit}: {' '.join(problems)}")
        variables = [dataclasses.replace(v, start=start[v.name]) if v.name in start else v for v in table]
        return Interface(self.unit, self.robot, variables)

    def to_json(self) -> str:
        """Text of the content file."""
        data = {
            "unit": self.unit,
            "version": self.version,
            "digest": self.digest,
            "pythonfmu": self.pythonfmu,
            "start_values": {name: float(value) for name, value in sorted(self.start_values.items())},
            "robot": self.robot.to_dict(),
        }
        return json.dumps(data, indent=1, ensure_ascii=False) + "\n"

    @staticmethod
    def read(resources: Path, unit: str) -> Content:
        """Content of an unpacked FMU from its folder ``resources``.

        Raises
        ------
        FmuError
            If it cannot be used, belongs to another unit, or another vdfmu than the installed one built it.
        """
        file = f"resources/{CONTENT_FILE}"
        try:
            data = json.loads((resources / CONTENT_FILE).read_text(encoding="utf-8"))
            found, version, digest = str(data["unit"]), str(data["version"]), str(data["digest"])
            if found != unit:
                raise FmuError(f"{file} belongs to unit {found!r}, expected {unit!r}. Build the FMU again.")
            _check_version(f"{MODEL_NAMES[unit]}.fmu", version, digest)
            robot = robot_from_dict(data["robot"], file)
            values, tool = dict(data["start_values"]), str(data["pythonfmu"])
            content = Content(unit, robot, values, version, digest, tool)
            content.table()
        except FmuError:
            raise
        except (OSError, LookupError, AttributeError, TypeError, ValueError, VdfmuError) as error:
            what = str(error) if isinstance(error, VdfmuError) else f"{type(error).__name__}: {error}"
            raise FmuError(f"{file} cannot be used: {what}. Build the FMU again.") from None
        return content


def _check_version(fmu: str, version: str, digest: str) -> None:
    """Raise if the installed vdfmu is not the one that built the FMU."""
    here = installed_digest()
    if version != __version__:
        raise FmuError(
            f"{fmu} was built with vdfmu {version}, but this Python has vdfmu {__version__}. "
            f"Build the FMU again with `vdfmu build`, or install vdfmu {version}."
        )
    if digest != here:
        raise FmuError(
            f"{fmu} was built with vdfmu {version} of other sources or with another CasADi (digest "
            f"{digest[:8]}, here {here[:8]}). Build the FMU again with `vdfmu build`."
        )
