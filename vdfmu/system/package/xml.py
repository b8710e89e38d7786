"""Elements of the XML files of a system package."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # lxml ships no stubs

from vdfmu.base.measure import measure
from vdfmu.base.version import __version__
from vdfmu.compiler.fmu.description import number
from vdfmu.engine.package.experiment import FOREIGN
from vdfmu.engine.package.parse import NAMESPACES

META = {
    "generationTool": f"vdfmu {__version__}",
    "generationDateAndTime": "2026-01-01T00:00:00Z",  # a constant: the same system gives the same bytes
}


_SPACES = NAMESPACES | FOREIGN


def _tag(name: str) -> str:
    prefix, _, local = name.partition(":")
    return f"{{{_SPACES[prefix]}}}{local}"


def root(name: str, attributes: Mapping[str, str], prefixes: Iterable[str]) -> Any:
    """Root element ``prefix:name`` that declares the namespaces of the prefixes."""
    return etree.Element(_tag(name), dict(attributes), nsmap={p: _SPACES[p] for p in prefixes})


def add(parent: Any, name: str, /, **attributes: Any) -> Any:
    """Append an element ``prefix:name``; attributes that are None are left out."""
    return etree.SubElement(
        parent, _tag(name), {key: _text(value) for key, value in attributes.items() if value is not None}
    )


def add_units(parent: Any, name: str, units: Iterable[str]) -> None:
    """Append ``prefix:Units`` with the definitions, unless there are none."""
    wanted = sorted(units)
    if wanted:
        element = add(parent, name)
        for unit in wanted:
            add(add(element, "ssc:Unit", name=unit), "ssc:BaseUnit", **measure(unit).exponents)


def value_text(kind: str, value: Any) -> str:
    """Text of a parameter's value, of a type of SSP."""
    if kind == "Boolean":
        return str(bool(value)).lower()
    return str(int(value)) if kind in ("Integer", "Int32") else number(value)


def to_bytes(element: Any) -> bytes:
    """Whole file."""
    return etree.tostring(element, xml_declaration=True, encoding="UTF-8", pretty_print=True)


def _text(value: Any) -> str:
    return number(value) if isinstance(value, float) else str(value)
