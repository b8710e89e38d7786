"""Where in its file a unit is declared."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator
from pathlib import Path

__all__ = ["declarations", "place"]


def place(unit: type, name: str = "") -> str:
    """Return file and line, ``my_unit.py, line 7``, of a variable or method of a unit; without a name, of its class."""
    owner = next((c for c in unit.__mro__ if name in vars(c)), unit) if name else unit
    try:
        file = inspect.getsourcefile(owner) or ""
        source = Path(file).read_text(encoding="utf-8")
    except (OSError, TypeError, ValueError):  # typed in, not read from a file
        return unit.__name__
    for line, declared in declarations(source, owner.__name__):
        if declared == name:
            return f"{file}, line {line}"
    return file


def declarations(source: str, class_name: str) -> Iterator[tuple[int, str]]:
    """Yield line and name of what a class declares, the class itself first, with an empty name."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ClassDef) and node.name == class_name:
            yield node.lineno, ""
            for statement in node.body:
                if isinstance(statement, ast.FunctionDef):
                    yield statement.lineno, statement.name
                elif isinstance(statement, (ast.Assign, ast.AnnAssign)):
                    targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
                    yield from ((statement.lineno, t.id) for t in targets if isinstance(t, ast.Name))
