"""Texts and packages of systems to read, and what the reading of a package refuses."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from vdfmu.base.errors import SspError
from vdfmu.engine.package.parse import NAMESPACES
from vdfmu.engine.package.read import load_ssp

SPACES = "".join(f'xmlns:{prefix}="{space}" ' for prefix, space in NAMESPACES.items())


def ssd(system: str = "", rest: str = "", attributes: str = "") -> str:
    """Text of an SSD with the inside of its system, and what follows that."""
    return (
        f'<ssd:SystemStructureDescription {SPACES} version="1.0" name="t">'
        f'<ssd:System name="s" {attributes}>{system}</ssd:System>{rest}</ssd:SystemStructureDescription>'
    )


def component(name: str = "a", source: str = "a.fmu", inner: str = "", attributes: str = "") -> str:
    """Text of a component."""
    return f'<ssd:Component name="{name}" source="{source}" {attributes}>{inner}</ssd:Component>'


def elements(*items: str) -> str:
    """Text of the elements of a system, empty for none."""
    return f"<ssd:Elements>{''.join(items)}</ssd:Elements>" if any(items) else ""


def binding(source: str, mapping: str = "") -> str:
    """Text of a binding of the parameter set of a file."""
    inner = f'<ssd:ParameterMapping source="{mapping}"/>' if mapping else ""
    return (
        f'<ssd:ParameterBindings><ssd:ParameterBinding source="{source}">{inner}</ssd:ParameterBinding>'
        "</ssd:ParameterBindings>"
    )


def write(path: Path, text: str, members: dict[str, bytes | str] | None = None) -> Path:
    """Write a package with an SSD and other members."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in {"SystemStructure.ssd": text, **(members or {})}.items():
            file.writestr(name, data)
    return path


def problems(path: Path) -> list[str]:
    """Return the problems for which a package is refused."""
    with pytest.raises(SspError) as info:
        load_ssp(path)
    return info.value.problems
