"""The generated C files of traced functions."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping

import casadi as ca

from vdfmu.compiler.c.expressions import c_prototype
from vdfmu.compiler.c.functions import c_texts, is_long
from vdfmu.compiler.c.operations import c_table
from vdfmu.compiler.c.text import head, wrapped
from vdfmu.compiler.functions.derivatives import DIRECTIONS

_WHOLE_DERIVATIVE = 5_000
"""Operations of a derivative that go into one C function; parts compile in half the time and run a quarter longer."""
_DEFINED = re.compile(r"^void (\w+)\([^;{]*\)\n{", re.MULTILINE)
"""Name of a function where it is defined."""


def kernel_files(function: ca.Function, apart: Collection[str] = (), joints: int = 0) -> dict[str, str]:
    """Return file name to text of a traced function, without what it calls of `apart`; long ones loop over `joints`."""
    *parts, whole = _texts(function, apart, joints)
    files = {f"kernel_{function.name()}_part_{k}.c": part for k, part in enumerate(parts, 1)}
    return files | {f"kernel_{function.name()}.c": whole}


def avx2_copies(files: Mapping[str, str]) -> dict[str, str]:
    """Files that compile those of the step again, for AVX2, with other names of the functions in them."""
    names = _DEFINED.findall("\n".join(files.values()))
    renamed = "".join(f"#define {name} {name}_avx2\n" for name in names)
    return {
        file.replace(".c", "_avx2.c"): head(f"{file} once more, for processors with AVX2; see processor.h.")
        + f"""#include <math.h>
#include <string.h>

#include "processor.h"

#ifdef AVX2_STEP

#ifdef __clang__
#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)
#else
#pragma GCC target("avx2")
#endif

{renamed}
#include "{file}"

#ifdef __clang__
#pragma clang attribute pop
#endif

#endif
"""
        for file in files
    }


def kernel_source(function: ca.Function) -> str:
    """Return the C text of a traced function in one file."""
    return "\n".join(_texts(function))


def _texts(function: ca.Function, apart: Collection[str] = (), joints: int = 0) -> list[str]:
    """Return the C files of a traced function, itself in the last, without what it calls of `apart`."""
    derivative = function.name().rpartition("_")[2] in DIRECTIONS
    table = derivative and is_long(function)
    whole = _WHOLE_DERIVATIVE if derivative else None
    texts = [c_table(function)] if table else c_texts(function, whole, apart, 0 if derivative else joints)
    top = head(f"The traced function {function.name()}, operation by operation.")
    top += f"#include <math.h>\n{'#include <stdint.h>' * table}\n"
    return [*(top + text for text in texts[:-1]), f"{top}{wrapped(c_prototype(function))};\n\n{texts[-1]}"]
