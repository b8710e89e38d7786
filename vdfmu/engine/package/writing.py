"""Elements of the XML files of a package (SSP), by their prefixed names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # lxml ships no stubs

from vdfmu.base.version import __version__
from vdfmu.engine.package.parse import EXPERIMENT_TYPE, FOREIGN, NAMESPACES, OSP_TYPE

META = {
    "generationTool": f"vdfmu {__version__}",
    "generationDateAndTime": "2026-01-01T00:00:00Z",  # a constant: the same system gives the same bytes
}
_SPACES = NAMESPACES | FOREIGN


def _tag(name: str) -> str:
    prefix, _, local = name.partition(":")
    return f"{{{_SPACES[prefix]}}}{local}"


def root(name: str, attributes: Mapping[str, str], prefixes: Iterable[str]) -> Any:
    """Return a root element ``prefix:name`` with the namespaces of the prefixes."""
    return etree.Element(_tag(name), dict(attributes), nsmap={p: _SPACES[p] for p in prefixes})


def add(parent: Any, name: str, /, **attributes: Any) -> Any:
    """Append an element ``prefix:name`` with the attributes except None."""
    texts = {key: _text(value) for key, value in attributes.items() if value is not None}
    return etree.SubElement(parent, _tag(name), texts)


def _text(value: Any) -> str:
    if isinstance(value, float):
        return repr(float(value))  # the shortest text that reads back as the same number
    return str(value).lower() if isinstance(value, bool) else str(value)


def add_experiment(top: Any, stop: float, step: float | None, **ours: Any) -> None:
    """Append the default experiment, with annotations of vdfmu, with `ours`, and of libcosim."""
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
