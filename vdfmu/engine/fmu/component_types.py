"""Types of the functions of a component of WebAssembly, as texts: those it has, and those of the draft's WIT.

Values of a call are read where they lie, by the types that the draft says. wasmtime makes them by the types that the
component says, so both must be the same, else a component could have any memory of this process read.
"""

from __future__ import annotations

import re
from functools import cache
from typing import Any

from vdfmu.base.files import data_path

_NAME = r"[\w-]+"


@cache
def drafted(kind: str) -> dict[str, str]:
    """Return the functions of an interface of the draft, ``co-simulation`` or ``model-exchange``, to their types."""
    folder = data_path("fmu_src") / "wasm" / "wit"
    text = "".join((folder / f"fmi3-{part}.wit").read_text(encoding="utf-8") for part in ("types", kind))
    text = re.sub(r"\s*([{}()<>,:;=]|->)\s*", r"\1", re.sub("//.*", "", text))
    text = re.sub(r",([})])", r"\1", text)
    names: dict[str, str] = {}

    def plain(kinds: str) -> str:
        return re.sub(rf"{_NAME}(?![\w:-])", lambda found: names.get(found[0], found[0]), kinds)

    for sort, name, content in re.findall(rf"\b(type|enum|record) ({_NAME})[={{]([^;}}]*)[;}}]", text):
        names[name] = plain(content) if sort == "type" else f"{sort}{{{plain(content)}}}"
    resource = f"{kind}-instance"
    names[resource] = "own"
    functions: dict[str, str] = {}
    for name, static, taken, given in re.findall(rf"({_NAME}):(static )?func\((.*?)\)(?:->(.*?))?;", text):
        kinds = [*([] if static else ["borrow"]), *([re.sub(f"{_NAME}:", "", taken)] if taken else [])]
        functions[f"[{'static' if static else 'method'}]{resource}.{name}"] = plain(f"({','.join(kinds)})->{given}")
    return functions


def type_of(function: Any) -> str:
    """Return a type of functions of wasmtime as `drafted` has it."""
    result = function.result
    return f"({','.join(_text(kind) for _, kind in function.params)})->{'' if result is None else _text(result)}"


def _text(kind: Any) -> str:
    """Return a type of wasmtime as WIT has it, named types in full."""
    from wasmtime import component as wc

    name = type(kind).__name__.removesuffix("Type").lower()
    match kind:
        case wc.ListType():
            return f"{name}<{_text(kind.element)}>"
        case wc.OptionType():
            return f"{name}<{_text(kind.payload)}>"
        case wc.ResultType():
            return f"{name}<{','.join('_' if each is None else _text(each) for each in (kind.ok, kind.err))}>"
        case wc.TupleType():
            return f"{name}<{','.join(map(_text, kind.elements))}>"
        case wc.EnumType():
            return f"{name}{{{','.join(kind.names)}}}"
        case wc.RecordType():
            return f"{name}{{{','.join(f'{field}:{_text(each)}' for field, each in kind.fields)}}}"
        case _:  # numbers, texts, and what the draft does not use
            return name
