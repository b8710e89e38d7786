"""The generated C files of traced functions."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping

import casadi as ca

from vdfmu.compiler.c.expressions import c_prototype
from vdfmu.compiler.c.functions import WHOLE, c_texts
from vdfmu.compiler.c.loop_text import c_loops
from vdfmu.compiler.c.loops import find_loops
from vdfmu.compiler.c.operations import c_table
from vdfmu.compiler.c.text import head, wrapped
from vdfmu.compiler.functions.derivatives import DIRECTIONS, has_roundings

_WHOLE_DERIVATIVE = 5_000
"""Operations of a derivative that go into one C function; parts compile in half the time and run a quarter longer."""
_DEFINED = re.compile(r"^void (\w+)\([^;{]*\)\n{", re.MULTILINE)
"""Name of a function where it is defined."""


def kernel_files(
    function: ca.Function,
    apart: Collection[str] = (),
    joints: int = 0,
    derivative: Callable[[str], ca.Function] | None = None,
) -> dict[str, str]:
    """Return file name to text of a traced function, without what it calls of `apart`; it loops over many `joints`.

    With `derivative`, which traces one by its direction, those of its derivatives too.
    """
    loops = find_loops(function, joints)
    calls = not function.is_a("SXFunction")
    texts = [c_loops(loops)] if loops is not None else c_texts(function, apart=apart, joints=joints if calls else 0)
    files = _files(function.name(), c_prototype(function), texts)
    if derivative is None:
        return files
    for ending in DIRECTIONS:
        table = False
        if loops is not None and not has_roundings(function):
            texts = [c_loops(loops, ending)]
        else:
            traced = derivative(ending)
            table = traced.n_instructions() > WHOLE
            texts = [c_table(traced)] if table else c_texts(traced, _WHOLE_DERIVATIVE)
        files |= _files(f"{function.name()}_{ending}", c_prototype(function, ending), texts, table)
    return files


def _files(name: str, prototype: str, texts: list[str], table: bool = False) -> dict[str, str]:
    top = head(f"The traced function {name}, operation by operation.")
    top += "#include <math.h>\n" + "#include <stdint.h>\n" * table
    files = {f"kernel_{name}_part_{k}.c": f"{top}\n{text}" for k, text in enumerate(texts[:-1], 1)}
    return files | {f"kernel_{name}.c": f"{top}\n{wrapped(prototype)};\n\n{texts[-1]}"}


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
    return "\n".join(kernel_files(function).values())
