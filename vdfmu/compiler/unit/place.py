"""Place of a unit's declaration: file and line."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from pathlib import Path


def source_file(unit: type) -> Path | None:
    """Return the file of a unit; None if it was typed interactively."""
    try:
        file = Path(inspect.getsourcefile(unit) or "")
    except (OSError, TypeError):
        return None
    return file if file.is_file() else None


def shown(unit: type) -> str:
    """Return a unit's file, relative to the current folder if inside, or its name if it was typed interactively."""
    file = source_file(unit)
    if file is None:
        return unit.__name__
    return str(file.relative_to(Path.cwd()) if file.is_relative_to(Path.cwd()) else file)


def place(unit: type, name: str = "") -> str:
    """Return file and line, ``my_unit.py, line 7``, of a variable or method of a unit; without a name, of its class."""
    owner = next((c for c in unit.__mro__ if name in vars(c)), unit) if name else unit
    file = source_file(owner)
    if file is None:
        return unit.__name__
    for line, declared in declarations(file.read_text(encoding="utf-8"), owner.__name__):
        if declared == name:
            return f"{shown(owner)}, line {line}"
    return shown(owner)


def declarations(source: str, class_name: str) -> Iterator[tuple[int, str]]:
    """Yield line and name of the declarations of a class, the class itself first, with an empty name."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ClassDef) and node.name == class_name:
            yield node.lineno, ""
            for statement in node.body:
                if isinstance(statement, ast.FunctionDef):
                    yield statement.lineno, statement.name
                elif isinstance(statement, (ast.Assign, ast.AnnAssign)):
                    targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
                    yield from ((statement.lineno, t.id) for t in targets if isinstance(t, ast.Name))
