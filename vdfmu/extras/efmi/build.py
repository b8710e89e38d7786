"""Makes the folder ``eFMU`` with its manifests, which turns an FMU into an eFMU."""

from __future__ import annotations

import uuid
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from hashlib import sha1, sha256
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from vdfmu.base.files import data_path, pack_zip, source_bytes, storing
from vdfmu.base.measure import measure
from vdfmu.compiler.fmu.content import EFMU, Content
from vdfmu.compiler.fmu.description import TIME_STAMP, boolean, document, number
from vdfmu.compiler.unit.base import BaseUnit
from vdfmu.compiler.unit.declaration import Event, State
from vdfmu.extras.efmi.block import PERIOD, BlockVariable, SampledBlock
from vdfmu.extras.efmi.galec import galec_name, galec_text, galec_value
from vdfmu.extras.efmi.production import (
    METHODS,
    PRECISIONS,
    Precision,
    c_name,
    c_type,
    constant_name,
    header_text,
    members,
    source_text,
)


def reason_against(unit: type[BaseUnit]) -> str | None:
    """Return the reason why a unit cannot be an eFMU, or None."""
    if unit.backend == "python":
        return "it runs in Python"
    if unit.exchange:
        return "it is for model exchange"
    if any(isinstance(declared, Event) for declared in unit.declared.values()):
        return "it has events; an eFMU is a sampled or memoryless unit"
    if any(type(declared) is State for declared in unit.declared.values()):
        return "it has continuous states; an eFMU is a sampled or memoryless unit"
    return None


def finish(path: Path, fmu: Content, precision: str, step: float) -> None:
    """Add the folder ``eFMU`` to the native FMU with this content.

    `precision`: name in :data:`~vdfmu.extras.efmi.production.PRECISIONS`. `step`: step [s] of a memoryless unit; a
    sampled unit uses its period.
    """
    with storing(path):
        whole = path.read_bytes()
        with zipfile.ZipFile(path) as archive:
            files = {name: archive.read(name) for name in archive.namelist()}
        added = _folder(fmu, whole, precision, step)
        pack_zip(path, files | {f"{EFMU}/{name}": text for name, text in added.items()})


def _folder(fmu: Content, whole: bytes, precision: str, step: float) -> dict[str, bytes]:
    """Return path to content of the folder ``eFMU``."""
    block, kind = SampledBlock(fmu.interface, step), PRECISIONS[precision]
    origin = _Origin(f"{fmu.guid} {precision} {block.period!r}", fmu.generation_tool, fmu.made_by)
    name = block.name
    program = {f"{name}.alg": galec_text(block).encode()}
    code = {f"{name}.h": header_text(block, kind).encode(), f"{name}.c": source_text(block, kind).encode()}
    inside = {f"{name}.fmu": whole}
    algorithm = document(_algorithm_manifest(block, origin, program))
    production = document(_production_manifest(block, origin, algorithm, code, inside, kind))
    manifests = {ALGORITHM: algorithm, PRODUCTION: production}
    return {
        "__content.xml": document(_content(block, origin, manifests)),
        **{f"{ALGORITHM}/{file}": text for file, text in program.items()},
        **{f"{PRODUCTION}/{file}": text for file, text in (inside | code).items()},
        **{f"{container}/{_MANIFEST}": text for container, text in manifests.items()},
        **{f"schemas/{file}": text for file, text in _schemas().items()},
    }


@lru_cache
def _schemas() -> dict[str, bytes]:
    """Return path to content of the eFMI schemas, which are part of every eFMU."""
    folder = data_path("fmu_src") / "efmi" / "schemas"
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    return {file.relative_to(folder).as_posix(): source_bytes(file) for file in files}


ALGORITHM, PRODUCTION = "AlgorithmCode", "ProductionCode"
_MANIFEST = "manifest.xml"
_XSI = "http://www.w3.org/2001/XMLSchema-instance"
_ORIGIN = "algorithm"
"""Reference from the production code to the manifest of the algorithm code."""
_STRUCTURE = "type.block"


@dataclass(frozen=True)
class _Origin:
    """Common data of all manifests of an eFMU."""

    seed: str
    """Text that identifies the eFMU."""
    tool: str
    about: Mapping[str, str]
    """Version, copyright and licence of the unit, if they are known."""

    def identifier(self, kind: str) -> str:
        """Return the identifier of a manifest."""
        return f"{{{uuid.UUID(bytes=sha256(f'{kind} {self.seed}'.encode()).digest()[:16])}}}"

    def root(self, tag: str, kind: str, block: SampledBlock, version: str, schema: str) -> Element:
        """Return the root element of a manifest."""
        about = {name: self.about[name] for name in ("version", "copyright", "license") if name in self.about}
        attributes = {
            f"{{{_XSI}}}noNamespaceSchemaLocation": schema,
            "xsdVersion": version,
            "efmiVersion": "1.0.0",
            "id": self.identifier(kind),
            "name": block.name,
            "description": block.description,
            "generationDateAndTime": TIME_STAMP,
            "generationTool": self.tool,
            **about,
        }
        return Element(tag, attributes)


def _checksum(content: bytes) -> str:
    return sha1(content, usedforsecurity=False).hexdigest()


def _add(parent: Element, tag: str, **attributes: str) -> Element:
    return SubElement(parent, tag, attributes)


def _add_files(root: Element, files: Mapping[str, tuple[bytes, str]]) -> None:
    """Add the files of a container, given by name to content and role."""
    listed = _add(root, "Files")
    for name, (content, role) in files.items():
        _add(
            listed,
            "File",
            id=f"file.{name}",
            name=name,
            path="./",
            needsChecksum="true",
            checksum=_checksum(content),
            role=role,
        )


def _identifier(v: BlockVariable) -> str:
    return f"variable.{c_name(v)}"


def _algorithm_manifest(block: SampledBlock, origin: _Origin, program: Mapping[str, bytes]) -> Element:
    """Return the manifest of the algorithm code in the file of `program`."""
    schema = f"../schemas/{ALGORITHM}/efmiAlgorithmCodeManifest.xsd"
    root = origin.root("Manifest", ALGORITHM, block, "0.14.0", schema)
    root.set("kind", ALGORITHM)
    root.set("fileRefId", f"file.{block.name}.alg")
    _add_files(root, {name: (text, "Code") for name, text in program.items()})
    period = next(v for v in block.variables if v.name == PERIOD)
    _add(root, "Clock", id="clock", variableRefId=_identifier(period))
    methods = _add(root, "BlockMethods")
    signals = {"DoStep": "NAN"} | ({"Recalibrate": "INVALID_ARGUMENT"} if block.tunable else {})
    for name in METHODS:
        method = _add(methods, "BlockMethod", id=f"method.{name}", kind=name)
        if name in signals:
            _add(_add(method, "Signals"), "Signal", value=signals[name])
    _add(root, "ErrorSignalStatus", id="errorSignals")
    units = _add(root, "Units")
    for name in sorted({v.unit for v in block.variables if v.unit}):
        exponents = {base: str(exponent) for base, exponent in measure(name).exponents.items()}
        _add(_add(units, "Unit", id=_unit_id(name), name=name), "BaseUnit", **exponents)
    variables = _add(root, "Variables")
    for v in block.variables:
        _add_variable(variables, v)
    return root


def _unit_id(name: str) -> str:
    return f"unit.{name.replace('*', '.').replace('^', '_')}"


def _add_variable(parent: Element, v: BlockVariable) -> None:
    values = v.start if len(set(v.start)) > 1 else v.start[:1]
    text = number if v.type == "Real" else partial(galec_value, v)
    element = _add(
        parent,
        f"{v.type}Variable",
        id=_identifier(v),
        name=galec_name(v),
        description=v.description,
        blockCausality=v.causality,
        start=" ".join(map(text, values)),
    )
    if v.unit:
        element.set("unitRefId", _unit_id(v.unit))
    _add_size(element, v, "1")


def _production_manifest(
    block: SampledBlock,
    origin: _Origin,
    algorithm: bytes,
    code: Mapping[str, bytes],
    fmu: Mapping[str, bytes],
    precision: Precision,
) -> Element:
    """Return the manifest of the production code.

    `algorithm` is the manifest of the algorithm code, `code` is the header and source, and `fmu` the FMU, as name to
    content.
    """
    schema = f"../schemas/{PRODUCTION}/efmiProductionCodeManifest.xsd"
    root = origin.root("Manifest", PRODUCTION, block, "0.17.0", schema)
    root.set("kind", PRODUCTION)
    reference = {"manifestRefId": origin.identifier(ALGORITHM), "checksum": _checksum(algorithm), "origin": "true"}
    _add(_add(root, "ManifestReferences"), "ManifestReference", id=_ORIGIN, **reference)
    files = {name: (text, "Code") for name, text in code.items()} | {name: (text, "FMU") for name, text in fmu.items()}
    _add_files(root, files)
    container = _add(
        root, "CodeContainer", language="C", standard="C99", platform="Legacy", floatPrecision=f"{precision.bits}-bit"
    )
    _add(container, "Target").text = "Generic"
    types = {
        f"{block.name}_Real": (f"efmiFloat{precision.bits}", precision.type),
        "int32_t": ("efmiInteger32", "int32_t"),
        "uint32_t": ("efmiUnsignedInteger32", "uint32_t"),
        "bool": ("efmiBool", "bool"),
        "void": ("efmiVoid", "void"),
    }
    targets = _add(container, "TargetTypes")
    for name, (kind, coded) in types.items():
        _add(targets, "TargetType", id=f"target.{name}", kind=kind, codedType=coded)
    code_files = _add(container, "CodeFiles")
    _add_header(code_files, block, types)
    _add_source(code_files, block)
    _add_logical_data(container, block)
    return root


def _add_header(files: Element, block: SampledBlock, types: Iterable[str]) -> None:
    file = _add(files, "CodeFile", id="code.header", fileType=PRODUCTION, codeType="HeaderFile")
    _add(file, "FileReference", fileRefId=f"file.{block.name}.h")
    definitions = _add(file, "Typedefs")
    for name in types:
        definition = _add(definitions, "Typedef", id=f"type.{name}", name=name)
        _add(definition, "Alias", targetTypeRefId=f"target.{name}")
    structure = _add(_add(definitions, "Typedef", id=_STRUCTURE, name=block.name), "Components")
    for v in members(block):
        component = _add(
            structure, "Component", id=f"component.{c_name(v)}", name=c_name(v), typeDefRefId=f"type.{c_type(v, block)}"
        )
        _add_size(component, v, "0")
    _add(structure, "Component", id="component.errorSignals", name="errorSignals", typeDefRefId="type.uint32_t")


def _add_source(files: Element, block: SampledBlock) -> None:
    file = _add(files, "CodeFile", id="code.source", fileType=PRODUCTION, codeType="SourceFile")
    _add(file, "FileReference", fileRefId=f"file.{block.name}.c")
    _add(_add(file, "Includes"), "Include", codeFileRefId="code.header")
    constants = _add(file, "Variables")
    for v in block.of("constant"):
        attributes = {"typeDefRefId": f"type.{c_type(v, block)}", "const": "true", "static": boolean(v.name != PERIOD)}
        variable = _add(constants, "Variable", id=f"constant.{v.name}", name=constant_name(block, v), **attributes)
        _add_size(variable, v, "0")
    functions = _add(file, "Functions")
    for method in METHODS:
        function = _add(functions, "Function", id=f"function.{method}", name=f"{block.name}_{method}")
        _add(function, "ReturnParameter", id=f"return.{method}", typeDefRefId="type.void")
        _add(
            _add(function, "FormalParameters"),
            "FormalParameter",
            id=f"self.{method}",
            name="self",
            number="0",
            typeDefRefId=_STRUCTURE,
            pointer="true",
        )


def _add_size(parent: Element, v: BlockVariable, first: str) -> None:
    """Add the dimension of an array, with the number `first`."""
    if v.size:
        _add(_add(parent, "Dimensions"), "Dimension", number=first, size=str(v.size))


def _add_logical_data(container: Element, block: SampledBlock) -> None:
    """Map each variable and each method of the algorithm code to the production code."""
    data = _add(container, "LogicalData")

    def reference(parent: Element, kind: str, identifier: str, tag: str, **attributes: str) -> None:
        element = _add(parent, f"{'Data' if kind == 'Variable' else kind}Reference")
        _add(element, f"Foreign{kind}Reference", manifestReferenceRefId=_ORIGIN, foreignRefId=identifier)
        _add(element, tag, **attributes)

    references = _add(data, "DataReferences")
    components = {_identifier(v): c_name(v) for v in members(block)} | {"errorSignals": "errorSignals"}
    for identifier, component in components.items():
        place = {"formalParameterRefId": "self.DoStep", "componentIdentifier": component}
        reference(references, "Variable", identifier, "FormalParameter", **place)
    for v in block.of("constant"):
        reference(references, "Variable", _identifier(v), "GlobalVariable", variableRefId=f"constant.{v.name}")
    functions = _add(data, "FunctionReferences")
    for method in METHODS:
        reference(functions, "Function", f"method.{method}", "GlobalFunction", functionRefId=f"function.{method}")


def _content(block: SampledBlock, origin: _Origin, manifests: Mapping[str, bytes]) -> Element:
    """Return the root element of ``__content.xml`` for the containers' manifests by kind."""
    root = origin.root("Content", "Content", block, "0.11.0", "schemas/efmiContainerManifest.xsd")
    root.set("activeFmu", PRODUCTION)
    for kind, text in manifests.items():
        _add(
            root,
            "ModelRepresentation",
            name=kind,
            kind=kind,
            manifest=_MANIFEST,
            checksum=_checksum(text),
            manifestRefId=origin.identifier(kind),
        )
    return root
