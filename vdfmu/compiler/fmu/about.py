"""Who made a unit, and under which licence its FMU may be used."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vdfmu.base.version import __version__
from vdfmu.compiler.unit.base import ABOUT, BaseUnit, is_shipped
from vdfmu.compiler.unit.place import source_file


def about(unit: type[BaseUnit]) -> dict[str, str]:
    """Return author, licence, copyright and version of a unit, without those that nobody has written down.

    The attributes of its class count, then ``[project]`` of the nearest ``pyproject.toml`` in the folders above its
    file. Those of units of the package are its own.
    """
    if is_shipped(unit):
        return {"version": __version__, "author": "vdfmu contributors", "license": "MIT"}
    file = source_file(unit)
    project = {} if file is None else _project(file)
    found = {name: getattr(unit, name) or project.get(name, "") for name in ABOUT}
    return {name: text for name, text in found.items() if text}


def terms(known: Mapping[str, str]) -> str:
    """Return copyright, author and licence in a line."""
    who = known.get("copyright") or known.get("author")
    return f"{f'{who}, ' if who else ''}{known.get('license') or 'no licence is named'}."


def _project(file: Path) -> dict[str, str]:
    """Return what the nearest project of a file says."""
    for folder in file.resolve().parents:
        try:
            table: Any = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
            authors = [one.get("name") or one["email"] for one in table.get("authors", ())]
            terms = table.get("license", "")
            return {
                "version": str(table.get("version", "")),
                "author": ", ".join(authors),
                "license": terms if isinstance(terms, str) else str(terms.get("text", "")),
            }
        except (OSError, ValueError, LookupError, TypeError, AttributeError):
            continue  # there is none, or not of a project
    return {}
