"""Pieces of C text."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable

__all__ = ["array", "cell", "comment", "fields", "string"]

WIDTH = 110


def comment(text: str) -> str:
    """Return a block comment."""
    text = text.replace("*/", "* /").replace("/*", "/ *")
    lines = textwrap.wrap(_ascii(text), WIDTH - 3) or [""]
    return "/* " + "\n * ".join(lines) + "\n */\n"


def string(text: str) -> str:
    """Return a string literal; bytes beyond ASCII are written as octal escapes of UTF-8."""
    found: list[str] = []
    for byte in text.encode("utf-8"):
        if byte in b'"\\':
            found.append("\\" + chr(byte))
        elif 32 <= byte < 127 and byte != ord("?"):  # no trigraphs
            found.append(chr(byte))
        else:
            found.append(f"\\{byte:03o}")
    return f'"{"".join(found)}"'


def cell(*values: object) -> str:
    """Return an initializer of a structure."""
    return f"{{{', '.join(str(v) for v in values)}}}"


def fields(items: Iterable[str], *, one_a_line: bool = False, indent: str = "    ") -> str:
    """Return items separated by commas, in lines of limited width."""
    lines: list[str] = []
    for item in items:
        if lines and not one_a_line and len(lines[-1]) + len(item) + 2 < WIDTH:
            lines[-1] += f", {item}"
        else:
            if lines:
                lines[-1] += ","
            lines.append(indent + item)
    return "\n".join(lines)


def array(kind: str, name: str, items: Iterable[str], *, one_a_line: bool = False) -> str:
    """Return the definition of a constant array. C has no empty ones: without items it has one of zeros."""
    listed = fields(items, one_a_line=one_a_line) or "    0"
    return f"static const {kind} {name}[] = {{\n{listed}\n}};\n"


def _ascii(text: str) -> str:
    return text.encode("ascii", "replace").decode()
