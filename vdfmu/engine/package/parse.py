"""XML of packages: parsed with limits, validated against schemas, written."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # lxml ships no stubs

from vdfmu.base.errors import SspError
from vdfmu.base.standards import SSP_1, SSP_FORMATS
from vdfmu.base.version import __version__
from vdfmu.engine.rules import Finding, breach, finding

_FILES = {
    "ssc": "SystemStructureCommon",
    "ssd": "SystemStructureDescription",
    "ssv": "SystemStructureParameterValues",
    "ssm": "SystemStructureParameterMapping",
    "ssb": "SystemStructureSignalDictionary",
}
NAMESPACES = {prefix: f"http://ssp-standard.org/SSP1/{name}" for prefix, name in _FILES.items()}
"""The same for SSP 1.0 and 2.0."""
EXPERIMENT_TYPE, OSP_TYPE = "org.vdfmu.experiment", "com.opensimulationplatform"
"""Types of the annotations of this project and of libcosim."""
FOREIGN = {"osp": "http://opensimulationplatform.com/SSP/OSPAnnotations", "vdfmu": "urn:org.vdfmu:experiment"}
"""Namespaces of the annotations' content. The root declares them, because libcosim mistakes a declaration inside an
annotation for an algorithm."""
_NAMED = {
    f"{{{NAMESPACES[prefix]}}}{tag}"
    for prefix, tag in (
        ("ssd", "Connector"),
        ("ssd", "Component"),
        ("ssd", "SignalDictionaryReference"),
        ("ssv", "Parameter"),
        ("ssb", "DictionaryEntry"),
    )
}
_MANY = 1000
"""Most violations of a schema that are reported individually, with lines."""
_SMALL = 2**14
"""Size of an XML file [byte] up to which any number of violations takes a tenth of a second."""


def parse_xml(data: bytes, where: str) -> Any:
    """Parse XML without entities, external files or network, and return its root, with `where` as its URL.

    SspError for text that is not well-formed XML, or has a document type declaration or an XInclude.
    """
    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        dtd_validation=False,
        huge_tree=False,
        remove_comments=True,
        remove_pis=True,
    )
    url = where.encode("utf-8", "backslashreplace").decode()  # lxml accepts only UTF-8
    try:
        root = etree.fromstring(data, parser, base_url=url)
    except (etree.XMLSyntaxError, ValueError) as error:
        if b"<!DOCTYPE" in data:  # entities may have caused the error
            raise breach("PKG009", f"{where}: {_DOCTYPE}", (where, 0)) from None
        place = where, getattr(error, "lineno", None) or 0
        raise breach("PKG008", f"{where}: is not well-formed XML: {error}", place) from None
    if root.getroottree().docinfo.doctype or root.getroottree().docinfo.internalDTD is not None:
        raise breach("PKG009", f"{where}: {_DOCTYPE}", (where, 0))
    for include in root.iter("{http://www.w3.org/2001/XInclude}*"):
        text = f"{where}, line {include.sourceline}: has an XInclude, not allowed; write the text in its place"
        raise breach("PKG009", text, include)
    return root


_DOCTYPE = "has a document type declaration, not allowed because of entities; remove it"


@lru_cache
def schema_of(kind: str, version: str) -> Any:
    """Return a schema of SSP; None if the package with the schemas is not installed."""
    package, folder = SSP_FORMATS[version].schemas
    spec = importlib.util.find_spec(package)
    for place in (spec and spec.submodule_search_locations) or ():
        file = Path(place, folder, f"{_FILES[kind]}.xsd")
        return etree.XMLSchema(file=str(file)) if file.is_file() else None
    return None


def validate(root: Any, kind: str, where: str, version: str = SSP_1.name) -> None:
    """Check a tree against a schema of SSP or, without the schema, check the names of elements.

    `kind` is ``ssd``, ``ssv``, ``ssm`` or ``ssb``, `where` the name in messages, `version` the SSP version.
    """
    schema = schema_of(kind, version)
    if schema is None:
        nameless = [item for item in root.iter(*_NAMED) if item.get("name") is None]
        places = [(item.sourceline, item.tag.rsplit("}")[1]) for item in nameless]
        wrong = [finding("SSP003", f"{where}, line {n}: {tag} has no name", (where, n)) for n, tag in places]
    else:
        wrong = schema_breaches(schema, root, "SSP003", where)
    if wrong:
        raise SspError(wrong)


def schema_breaches(schema: Any, root: Any, rule: str, where: str) -> list[Finding]:
    """Return the violations of a schema as findings on a rule; messages call the file `where`.

    Validating a tree writes a path for each violation, for which it counts the elements before, so thousands of
    violations take minutes. A parser takes linear time, but reports no lines. So it checks large trees first, and if
    there are very many violations it reports the first.
    """
    text = etree.tostring(root, with_tail=False)
    if len(text) > _SMALL:
        parser = etree.XMLParser(schema=schema)
        with suppress(etree.XMLSyntaxError):
            etree.fromstring(text, parser)
        if (count := len(parser.error_log)) > _MANY:
            first = f"{where}: {parser.error_log[0].message} This is the first of {count} violations of the schema"
            return [finding(rule, first, (where, 0))]
    if schema.validate(root):
        return []
    return [finding(rule, f"{where}, line {e.line}: {e.message}", (where, e.line)) for e in schema.error_log]


def parse_ssp_xml(data: bytes, kind: str, where: str, version: str | None = SSP_1.name) -> Any:
    """Parse and validate an SSP file; for version None use its stated version; for `kind` see `validate`."""
    root = parse_xml(data, where)
    space = etree.QName(root).namespace
    if space != NAMESPACES[kind]:
        versions = version or " and ".join(SSP_FORMATS)
        raise breach("SSP002", f"{where}: expected namespace {NAMESPACES[kind]} (SSP {versions}), got {space}", root)
    validate(root, kind, where, version or version_of(root))
    return root


def version_of(root: Any) -> str:
    """Return the SSP version for reading a file: its own, else one with the same first digit, else 1.0."""
    stated = root.get("version") or ""
    alike = (name for name in SSP_FORMATS if name[0] == stated[:1])
    return stated if stated in SSP_FORMATS else next(alike, SSP_1.name)


META = {
    "generationTool": f"vdfmu {__version__}",
    "generationDateAndTime": "2026-01-01T00:00:00Z",  # a constant, for reproducible bytes
}
_SPACES = NAMESPACES | FOREIGN


def _tag(name: str) -> str:
    prefix, _, local = name.partition(":")
    return f"{{{_SPACES[prefix]}}}{local}"


def root(name: str, attributes: Mapping[str, str], prefixes: Iterable[str]) -> Any:
    """Return a root element ``prefix:name`` with the namespaces of the prefixes."""
    return etree.Element(_tag(name), dict(attributes), nsmap={p: _SPACES[p] for p in prefixes})


def add(parent: Any, name: str, /, **attributes: Any) -> Any:
    """Append an element ``prefix:name`` with all attributes that are not None."""
    texts = {key: _text(value) for key, value in attributes.items() if value is not None}
    return etree.SubElement(parent, _tag(name), texts)


def _text(value: Any) -> str:
    if isinstance(value, float):
        return repr(float(value))  # the shortest text that is read back as the same number
    return str(value).lower() if isinstance(value, bool) else str(value)


def add_experiment(top: Any, stop: float, step: float | None, **ours: Any) -> None:
    """Append the default experiment, with an annotation of vdfmu, which contains `ours`, and one of libcosim."""
    experiment = add(top, "ssd:DefaultExperiment", startTime=0.0, stopTime=float(stop))
    if step is None and not any(value is not None for value in ours.values()):
        return
    annotations = add(experiment, "ssd:Annotations")
    annotation = add(annotations, "ssc:Annotation", type=EXPERIMENT_TYPE)
    add(annotation, "vdfmu:Experiment", communicationStepSize=step, **ours)
    if step is not None:
        algorithm = add(add(annotations, "ssc:Annotation", type=OSP_TYPE), "osp:Algorithm")
        add(algorithm, "osp:FixedStepAlgorithm", baseStepSize=float(step))


def to_bytes(element: Any) -> bytes:
    """Return the content of a file."""
    return etree.tostring(element, xml_declaration=True, encoding="UTF-8", pretty_print=True)
