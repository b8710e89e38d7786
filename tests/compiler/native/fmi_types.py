"""The functions of FMI as ctypes sees them; signatures are read from the official headers, so that none is missed."""

import ctypes as ct
import re
from functools import lru_cache
from pathlib import Path
from typing import Any

import fmpy

HEADERS = Path(fmpy.__file__).parent / "c-code"

_SCALARS = {
    "2": {
        "fmi2Component": ct.c_void_p, "fmi2FMUstate": ct.c_void_p, "fmi2ValueReference": ct.c_uint32,
        "size_t": ct.c_size_t,
        "fmi2Real": ct.c_double, "fmi2Integer": ct.c_int, "fmi2Boolean": ct.c_int, "fmi2String": ct.c_char_p,
        "fmi2Type": ct.c_int, "fmi2StatusKind": ct.c_int, "fmi2Status": ct.c_int,
    },
    "3": {
        "fmi3Instance": ct.c_void_p, "fmi3FMUState": ct.c_void_p, "fmi3ValueReference": ct.c_uint32,
        "size_t": ct.c_size_t,
        "fmi3Float64": ct.c_double, "fmi3Boolean": ct.c_bool, "fmi3String": ct.c_char_p, "fmi3Status": ct.c_int,
        "fmi3InstanceEnvironment": ct.c_void_p,
    },
}  # fmt: skip
LOG_2 = ct.CFUNCTYPE(None, ct.c_void_p, ct.c_char_p, ct.c_int, ct.c_char_p, ct.c_char_p)
LOG_3 = ct.CFUNCTYPE(None, ct.c_void_p, ct.c_int, ct.c_char_p, ct.c_char_p)
UPDATE = ct.CFUNCTYPE(
    None, ct.c_void_p, ct.c_double, ct.c_bool, ct.c_bool, ct.c_bool, ct.c_bool,
    ct.POINTER(ct.c_bool), ct.POINTER(ct.c_double),
)  # fmt: skip


class Callbacks(ct.Structure):
    """fmi2CallbackFunctions."""

    _fields_ = [
        ("logger", LOG_2), ("allocate", ct.c_void_p), ("free", ct.c_void_p), ("finished", ct.c_void_p),
        ("environment", ct.c_void_p),
    ]  # fmt: skip


@lru_cache
def signatures(version: str) -> dict[str, tuple[Any, tuple[Any, ...]]]:
    major = version[0]
    text = (HEADERS / f"fmi{major}FunctionTypes.h").read_text(encoding="utf-8", errors="replace")
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
    pattern = rf"typedef\s+([\w\s*]+?)\s*\(?\*?\s*fmi{major}(\w+)TYPE\)?\s*\(([^;]*)\)\s*;"
    prototypes: dict[str, tuple[Any, tuple[Any, ...]]] = {}
    for result, name, arguments in re.findall(pattern, text):
        listed = [] if arguments.strip() in ("", "void") else arguments.split(",")
        types = tuple(_ctype(argument, major) for argument in listed)
        prototypes[name] = (None if result.strip() == "void" else _ctype(result, major), types)
    return prototypes


def _ctype(text: str, major: str) -> Any:
    if "*" in text or "[" in text:
        return ct.c_char_p if re.sub(r"\s", "", text) == "constchar*" else ct.c_void_p
    return _SCALARS[major].get(text.replace("const", "").split()[0], ct.c_void_p)  # else a callback
