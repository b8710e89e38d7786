"""The generated C files of traced functions."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping

import casadi as ca

from vdfmu.base.cache import cached_per_command
from vdfmu.compiler.c.expressions import c_prototype
from vdfmu.compiler.c.functions import c_texts
from vdfmu.compiler.c.loop_text import c_loops
from vdfmu.compiler.c.loops import find_loops, straight
from vdfmu.compiler.c.operations import c_derivatives, c_operations
from vdfmu.compiler.c.text import head, source_text, wrapped
from vdfmu.compiler.functions.derivatives import DIRECTIONS, has_roundings

_MOST_IN_C = 1_700
"""Operations of a function whose derivatives, three times as long, are written as C; see :mod:`.operations` for longer.

Importers call derivatives rarely, and to compile those of a feedforward took 4 s. Those of the paper's plant, which an
importer's implicit solver may call, are shorter.
"""
_DEFINED = re.compile(r"^void (\w+)\([^;{]*\)\n{", re.MULTILINE)
"""Name of a function where it is defined."""


def kernel_files(
    function: ca.Function,
    apart: Collection[str] = (),
    joints: int = 0,
    derivative: Callable[[str], ca.Function] | None = None,
) -> dict[str, str]:
    """Return file name to text of a traced function, without what it calls of `apart`; it loops over many `joints`.

    With `derivative`, which traces a derivative by its direction, the files of its derivatives too.
    """
    loops = find_loops(function, joints)
    calls = not function.is_a("SXFunction")
    texts = [c_loops(loops)] if loops is not None else c_texts(function, apart=apart, joints=joints if calls else 0)
    name = f"kernel_{function.name()}"
    top = head(f"The traced function {function.name()}, operation by operation.") + "#include <math.h>\n"
    files = {f"{name}_part_{k}.c": f"{top}\n{text}" for k, text in enumerate(texts[:-1], 1)}
    files[f"{name}.c"] = f"{top}\n{wrapped(c_prototype(function))};\n\n{texts[-1]}"
    if not calls:
        _sources()[function, joints] = "\n".join(files.values())
    if derivative is None:
        return files
    if loops is None and function.n_instructions() > _MOST_IN_C:
        loops = straight(function)
    text = head(f"The derivatives of the traced function {function.name()}.")
    if loops is not None and not has_roundings(function):
        text += f'#include <math.h>\n\n#include "operations.h"\n\n{c_derivatives(loops)}'
        files |= c_operations()
    else:
        text += "#include <math.h>\n"
        for ending in DIRECTIONS:
            text += "\n".join(["", f"{wrapped(c_prototype(function, ending))};", "", *c_texts(derivative(ending))])
    return files | {f"{name}_forward_reverse.c": text}


def avx2_copies(files: Mapping[str, str]) -> dict[str, str]:
    """Files that compile the files of the step again, for AVX2, with other names of their functions."""
    names = _DEFINED.findall("\n".join(files.values()))
    renamed = "".join(f"#define {name} {name}_avx2\n" for name in names)
    return {
        file.replace(".c", "_avx2.c"): head(f"{file} once more, for processors with AVX2; see processor.h.")
        + source_text("avx2.c").replace("/* RENAMED */\n", renamed + "\n").replace("FILE", file)
        for file in files
    }


def kernel_source(function: ca.Function, joints: int = 0) -> str:
    """Return the C text of a traced function in one file, see :func:`kernel_files`; in a job it is made once."""
    known = _sources()
    if (function, joints) not in known:
        known[function, joints] = "\n".join(kernel_files(function, joints=joints).values())
    return known[function, joints]


@cached_per_command
def _sources() -> dict[tuple[ca.Function, int], str]:
    """Texts of the functions of a job, which FMUs and references share, and so their objects."""
    return {}
