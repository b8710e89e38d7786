"""The text of TOML files."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np


def toml_text(table: Mapping[str, Any], rounding: float = 0.0) -> str:
    """Return the content of a file, the values of each table before its tables; `rounding`: see `toml_value`."""
    return "\n".join(_lines(table, "", rounding)).lstrip("\n") + "\n"


def toml_value(value: Any, rounding: float = 0.0) -> str:
    """Return a value of TOML; numbers of a list that are at most `rounding` of its largest are written as zero."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, (list, tuple, np.ndarray)):
        if (whole := np.asarray(value)).dtype.kind == "U":
            return f"[{', '.join(map(toml_value, whole.tolist()))}]"
        if whole.dtype.kind == "i":
            return str(whole.tolist())
        array = np.asarray(value, dtype=float)
        clean = np.where(np.abs(array) <= rounding * np.abs(array).max(initial=0.0), 0.0, array)
        return f"[{', '.join(toml_value(entry, rounding) for entry in clean)}]"
    if isinstance(value, bool):
        return str(value).lower()
    return repr(int(value)) if isinstance(value, int) else repr(float(value))


def _lines(table: Mapping[str, Any], path: str, rounding: float) -> Iterator[str]:
    inner = {key: value for key, value in table.items() if _is_table(value)}
    for key, value in table.items():
        if key not in inner:
            yield f"{key if key.isidentifier() else toml_value(key)} = {toml_value(value, rounding)}"
    for key, value in inner.items():
        name = f"{path}.{key}" if path else key
        for each in value if isinstance(value, list) else [value]:
            yield ""
            yield f"[[{name}]]" if isinstance(value, list) else f"[{name}]"
            yield from _lines(each, name, rounding)


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and isinstance(value[0], dict))
