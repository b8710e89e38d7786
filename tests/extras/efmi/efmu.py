"""An eFMU as its manifests describe it: the production code as a library of this machine, the program in GALEC run."""

import ctypes as ct
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tests.compiler.native.conftest import run
from vdfmu.base.compile import compile_library
from vdfmu.base.platforms import this_platform

Rows = dict[str, np.ndarray]
"""Variable to its values, a row for each step."""
_KINDS = {"efmiFloat64": ct.c_double, "efmiFloat32": ct.c_float, "efmiInteger32": ct.c_int32,
          "efmiUnsignedInteger32": ct.c_uint32, "efmiBool": ct.c_bool}  # fmt: skip


class Efmu:
    """An unpacked eFMU."""

    def __init__(self, path: Path) -> None:
        with zipfile.ZipFile(path) as archive:
            self.files = {name: archive.read(name) for name in archive.namelist()}
        self.content = ET.fromstring(self.files["eFMU/__content.xml"])
        self.name = self.content.attrib["name"]
        self.algorithm = ET.fromstring(self.files["eFMU/AlgorithmCode/manifest.xml"])
        self.production = ET.fromstring(self.files["eFMU/ProductionCode/manifest.xml"])
        self.variables = {v.attrib["id"]: v for v in self.algorithm.iterfind("Variables/*")}

    @property
    def program(self) -> str:
        """The program in GALEC."""
        return self.files[f"eFMU/AlgorithmCode/{self.name}.alg"].decode()

    @property
    def code(self) -> dict[str, bytes]:
        """File name to content of the production code."""
        return {f"{self.name}.{end}": self.files[f"eFMU/ProductionCode/{self.name}.{end}"] for end in "ch"}

    def names(self, *causalities: str) -> list[str]:
        """Names of the variables of some causalities."""
        return [v.attrib["name"] for v in self.variables.values() if v.attrib["blockCausality"] in causalities]

    def size(self, name: str) -> int:
        """Return the number of elements of a variable."""
        dimension = self.variable(name).find("Dimensions/Dimension")
        return 1 if dimension is None else int(dimension.attrib["size"])

    def is_array(self, name: str) -> bool:
        """Whether a variable is an array."""
        return self.variable(name).find("Dimensions") is not None

    def variable(self, name: str) -> ET.Element:
        """Return a variable of the manifest of the algorithm code."""
        (variable,) = (v for v in self.variables.values() if v.attrib["name"] == name)
        return variable

    def write(self, path: Path) -> None:
        """Write the files as an eFMU."""
        with zipfile.ZipFile(path, "w") as archive:
            for name, content in self.files.items():
                archive.writestr(name, content)


class Production:
    """The production code of an eFMU, compiled here, and its block.

    The package's compiler makes the library, or gcc where it is given: that with numbers of double precision calls no
    other functions than FMUs do.
    """

    def __init__(self, efmu: Efmu, folder: Path, gcc: str = "") -> None:
        self.efmu = efmu
        library = folder / f"{efmu.name}.so"
        flags = ("-std=c99", "-pedantic", "-Wconversion", "-Werror", "-fvisibility=default")
        if b"typedef double" in efmu.code[f"{efmu.name}.h"]:  # with the functions of the FMU it has its bits
            functions = Path(__file__).parents[3] / "fmu_src/functions"
            flags = (*flags, "-isystem", str(functions), "-include", "elementary.h")
        if gcc:
            for name, text in efmu.code.items():
                (folder / name).write_bytes(text)
            options = [*flags, "-Wall", "-Wextra", "-O2", "-ffp-contract=off", "-shared", "-fPIC"]
            run([gcc, *options, "-o", library, folder / f"{efmu.name}.c", "-lm"])
        else:
            library.write_bytes(compile_library(efmu.code, this_platform(), name=efmu.name, flags=flags))
        self._library = ct.CDLL(str(library))
        root = efmu.production
        targets = {t.attrib["id"]: _KINDS.get(t.attrib["kind"]) for t in root.iter("TargetType")}
        aliases = {t.attrib["id"]: t.find("Alias") for t in root.iter("Typedef")}
        types = {name: targets[alias.attrib["targetTypeRefId"]] for name, alias in aliases.items() if alias is not None}
        fields: list[tuple[str, Any]] = []
        for component in root.iter("Component"):
            kind, dimension = types[component.attrib["typeDefRefId"]], component.find("Dimensions/Dimension")
            assert kind is not None
            size = None if dimension is None else int(dimension.attrib["size"])
            fields.append((component.attrib["name"], kind if size is None else kind * size))
        self.block = type("Block", (ct.Structure,), {"_fields_": fields})()
        self._components: dict[str, str] = {}  # variable of the algorithm code to the member of the structure
        for reference in root.iter("DataReference"):
            here, there = reference.find("FormalParameter"), reference[0].attrib["foreignRefId"]
            if here is not None and there in efmu.variables:
                self._components[efmu.variables[there].attrib["name"]] = here.attrib["componentIdentifier"]
        self.functions = {f.attrib["id"]: f.attrib["name"] for f in root.iter("Function")}

    def call(self, method: str) -> int:
        """Call a method; return the error signals."""
        (name,) = (n for k, n in self.functions.items() if k.endswith(method))
        getattr(self._library, name)(ct.byref(self.block))
        return self.block.errorSignals

    def set(self, name: str, values: Any) -> None:
        """Set a variable."""
        member = self._components[name]
        flat = np.ravel(values).tolist()
        if isinstance(getattr(self.block, member), ct.Array):
            getattr(self.block, member)[:] = flat
        else:
            setattr(self.block, member, flat[0])

    def get(self, name: str) -> np.ndarray:
        """Value of a variable."""
        return np.array(np.ravel(getattr(self.block, self._components[name])), dtype=float)

    def run(self, inputs: Mapping[str, np.ndarray], steps: int) -> Rows:
        """Return the outputs of each step, for the inputs of each."""
        assert self.call("Startup") == 0
        assert self.call("Recalibrate") == 0
        outputs = self.efmu.names("output")
        series: dict[str, list[np.ndarray]] = {name: [] for name in outputs}
        for k in range(steps):
            for name, values in inputs.items():
                self.set(name, values[k])
            assert self.call("DoStep") == 0, k
            for name in outputs:
                series[name].append(self.get(name))
        return {name: np.array(values) for name, values in series.items()}
