"""Content of an FMU in addition to its script: the unit and its author, the robot, start values, version of vdfmu."""

from __future__ import annotations

import dataclasses
import json
import uuid
from collections.abc import Mapping
from functools import cached_property, lru_cache
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import Any

from vdfmu.base.cache import built_as
from vdfmu.base.errors import FmuError, VdfmuError
from vdfmu.base.files import data_path, read_json, read_text, source_bytes
from vdfmu.base.sources import source_digest
from vdfmu.base.standards import FMI_2, FMI_VERSIONS, FmiVersion
from vdfmu.base.text import kind_text
from vdfmu.base.version import __version__
from vdfmu.compiler.unit.base import ABOUT, BaseUnit, is_shipped, unit_name
from vdfmu.compiler.unit.declaration import Machine
from vdfmu.compiler.unit.interface import Interface, interface_of
from vdfmu.compiler.unit.load import load_units

CONTENT_FILE = "vdfmu.json"
CONTENT_PLACES = {"native": f"extra/vdfmu/{CONTENT_FILE}", "python": f"resources/{CONTENT_FILE}"}
"""Path of the content in an FMU, by backend."""
EFMU = "eFMU"
"""Folder of an eFMU in its FMU."""
_ROBOT_FILES = {"native": "extra/vdfmu/robot", "python": "resources/robot"}
"""Folder for files named by a robot, by backend."""
UNIT_FILE = "unit.py"
"""Source, in a Python FMU, of a unit that does not belong to the package."""
_DATA = {"python": ("*.py",), "native": ("c/*.[ch]", "functions/*.[ch]", "icons/*")}
"""Data files of the FMUs of a backend, in addition to the modules."""


@lru_cache
def installed_digest(backend: str, module: str | None, reader: str | None) -> str:
    """Return the digest of all installed code that affects an FMU's results, including CasADi's version.

    `module` is the module of a unit of this package, `reader` the ``module:function`` that reads its robot.
    """
    modules = [each.partition(":")[0].partition(".")[2] for each in (module, reader) if each]
    digest = sha256(source_digest("compiler", *modules).encode())
    for pattern in _DATA[backend]:
        for file in sorted(data_path("fmu_src").glob(pattern)):
            digest.update(f"{file.name}\n".encode())
            digest.update(source_bytes(file))
    return digest.hexdigest()


def _tool_of(backend: str) -> str:
    """Name and version of the tool that makes the library of an FMU."""
    if backend == "python":
        from importlib.metadata import version  # takes long to import

        return f"pythonfmu {version('pythonfmu')}"
    from vdfmu.base.platforms import compiler_version

    return compiler_version()


@dataclasses.dataclass(frozen=True, eq=False)
class Content:
    """Content of one FMU."""

    unit: type[BaseUnit]
    robot: Machine | None
    start_values: Mapping[str, float]
    """Start values that replace declared ones."""
    backend: str = "python"
    """``python`` or ``native``."""
    fmi_version: str = FMI_2.name
    version: str = __version__
    """Version of vdfmu that built the FMU."""
    digest: str = ""
    """:func:`installed_digest` where the FMU was built; default: of this installation."""
    tool: str = ""
    """Name and version of the tool that made the FMU's libraries; default: of this installation."""
    made_by: Mapping[str, str] = None  # pyright: ignore[reportAssignmentType]
    """Author, licence, copyright and version of the unit; default: see :func:`about`."""
    sources: bool = True
    """Whether a native FMU contains its C sources."""

    def __post_init__(self) -> None:
        defaults: dict[str, Any] = {
            "digest": self.digest or installed_digest(self.backend, self._module, self._reader),
            "tool": self.tool or _tool_of(self.backend),
        }
        if self.made_by is None:  # pyright: ignore[reportUnnecessaryComparison]
            defaults["made_by"] = about(self.unit)
        for name, value in defaults.items():
            object.__setattr__(self, name, value)

    @property
    def _module(self) -> str | None:
        return self.unit.__module__ if is_shipped(self.unit) else None

    @property
    def _reader(self) -> str | None:
        return None if self.robot is None else self.robot.reader

    @property
    def _robot(self) -> dict[str, Any] | None:
        return None if self.robot is None else self.robot.to_dict(looks=False)

    @property
    def _digests(self) -> dict[str, str]:
        """Path to digest of the robot's files. They are members of the FMU, so that its data contain no code."""
        return {path: sha256(content).hexdigest() for path, content in self.robot_files.items()}

    @property
    def robot_files(self) -> dict[str, bytes]:
        """Path to content of the members with the files of the robot."""
        files = {} if self.robot is None else self.robot.files
        return {f"{_ROBOT_FILES[self.backend]}/{name}": text.encode() for name, text in files.items()}

    @property
    def generation_tool(self) -> str:
        """Names and versions of the tools that made the FMU. Because of the first a later build may replace it."""
        return f"vdfmu {self.version}, {self.tool}"

    @property
    def fmi(self) -> FmiVersion:
        """Version of FMI."""
        return FMI_VERSIONS[self.fmi_version]

    @property
    def model_name(self) -> str:
        """Model identifier of the FMU."""
        return self.unit.__name__

    @cached_property
    def guid(self) -> str:
        """GUID made from the content: the same content has the same GUID on every machine."""
        return "{" + str(uuid.UUID(bytes=sha256(self.to_json().encode()).digest()[:16])) + "}"

    @property
    def model_key(self) -> str:
        """Identifier of the unit's source and robot, independent of the FMI version and start values."""
        parts = [self.digest, unit_name(self.unit), self._robot, self._digests, self.interface.functions.digest]
        return json.dumps(parts, sort_keys=True)

    @cached_property
    def interface(self) -> Interface:
        """Variables with this FMU's start values; errors as in :class:`~vdfmu.compiler.unit.interface.Interface`."""
        if self.start_values:
            return Interface(self.unit, self.robot, self.start_values)
        return interface_of(self.unit, self.robot)

    def to_json(self, **further: Any) -> str:
        """Text of the content file, with `further` entries added."""
        data = {
            **further,
            **({} if self.sources else {"sources": False}),
            "unit": unit_name(self.unit),
            "module": self._module,
            "reader": self._reader,
            "backend": self.backend,
            "fmi_version": self.fmi_version,
            "version": self.version,
            "digest": self.digest,
            "functions": self.interface.functions.digest,
            "tool": self.tool,
            "made_by": dict(self.made_by),
            "start_values": {name: float(self.interface.find(name).start) for name in sorted(self.start_values)},
            "robot": self._robot,
            **({"robot_files": self._digests} if self.robot_files else {}),
        }
        return json.dumps(data, indent=1, ensure_ascii=False) + "\n"

    @staticmethod
    def read(resources: Path, model_name: str) -> Content:
        """Return a Python FMU's content from its folder ``resources``; FmuError if damaged or from another vdfmu."""
        source, file = resources / UNIT_FILE, CONTENT_PLACES["python"]
        try:
            data = read_json(resources / CONTENT_FILE)
            name, version, digest = (str(data[key]) for key in ("unit", "version", "digest"))
            if version != __version__:
                raise FmuError(
                    f"{model_name}.fmu was built with vdfmu {version}, but this Python has vdfmu {__version__}. "
                    f"Build the FMU again with `vdfmu build`, or install vdfmu {version}."
                )
            if digest != (here := installed_digest("python", data["module"], data["reader"])):
                raise FmuError(
                    f"{model_name}.fmu was built with vdfmu {version} from other sources or another CasADi (digest "
                    f"{digest[:8]}, here {here[:8]}). Build the FMU again with `vdfmu build`."
                )
            unit = load_units(source).get(name) if source.is_file() else _named(f"{data['module']}:{model_name}")
            if unit is None or unit_name(unit) != name or unit.__name__ != model_name:
                raise FmuError(f"{file} belongs to unit {name!r}, expected a file of {model_name}.")
            names = [Path(path).name for path in data.get("robot_files", ())]
            files = {name: read_text(resources / "robot" / name) for name in names}
            robot = None if data["robot"] is None else _named(data["reader"])(data["robot"], file, files)
            made_by = {key: str(data["made_by"][key]) for key in ABOUT if key in data["made_by"]}
            content = Content(unit, robot, dict(data["start_values"]), tool=str(data["tool"]), made_by=made_by)
            _ = content.interface
        except FmuError:
            raise
        except (OSError, LookupError, AttributeError, TypeError, ValueError, VdfmuError) as error:
            reason = str(error) if isinstance(error, VdfmuError) else kind_text(error)
            raise FmuError(f"{file} cannot be used: {reason}. Build the FMU again.") from None
        return content


def _named(place: str) -> Any:
    """Return an object of the package by its module and name."""
    module, _, name = place.partition(":")
    if not module.startswith("vdfmu."):
        raise FmuError(f"{place}: expected a module of vdfmu")
    return getattr(import_module(module), name, None)


def is_built(path: Path, guid: str) -> bool:
    """Return whether an FMU on disk has exactly the bytes of a build here with this GUID or instantiation token."""
    try:
        return path.is_file() and built_as(path) == guid
    except OSError:
        return False


def about(unit: type[BaseUnit]) -> dict[str, str]:
    """Return author, licence, copyright and version of a unit, if known, by attribute of its class.

    Units of the package have fixed texts.
    """
    if is_shipped(unit):
        return {"version": __version__, "author": "vdfmu contributors", "license": "MIT"}
    return {name: text for name in ABOUT if (text := getattr(unit, name))}


def terms(about: Mapping[str, str]) -> str:
    """Return copyright, author and licence in one line."""
    owner = about.get("copyright") or about.get("author")
    return f"{f'{owner}, ' if owner else ''}{about.get('license') or 'no licence is named'}."
