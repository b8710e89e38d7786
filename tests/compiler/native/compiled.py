"""Functions in C, compiled and called: values, and derivatives by tables against those of CasADi."""

import ctypes
import subprocess

import numpy as np

from tests.cc import CC
from vdfmu.compiler.c.operations import c_derivatives, c_operations
from vdfmu.compiler.c.text import c_prototype, elementary_files
from vdfmu.compiler.functions.derivatives import DIRECTIONS, derivative

FLAGS = ("-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O0", "-ffp-contract=off", "-fPIC")


def library_of(text, functions, tmp_path, name="kernel"):
    """Compile the C text of functions, without a warning, and load it."""
    common = tmp_path.parent / "common"  # the same for all tests of this process
    runner = common / "operations.o"
    if not runner.exists():
        common.mkdir()
        for file, other in (c_operations() | elementary_files()).items():
            (common / file).write_text(other)
        subprocess.run([*CC, *FLAGS, "-c", "-o", runner, common / "operations.c"], check=True)
    source, library = tmp_path / f"{name}.c", tmp_path / f"{name}.so"
    prototypes = "".join(f"{c_prototype(function)};\n" for function in functions)
    source.write_text(f'#include "elementary.h"\n{prototypes}{text}')
    subprocess.run([*CC, *FLAGS, "-shared", f"-I{common}", "-o", library, source, runner], check=True)
    return ctypes.CDLL(str(library))


def called(library, function, inputs):
    """Return the results of a function of a library for given arguments."""
    # It is called twice: the second time has what the first has left in memory.
    made = [np.full(function.numel_out(i), np.nan) for i in range(function.n_out())]
    arguments = [a.ctypes.data_as(ctypes.c_void_p) for a in (*inputs, *made)]
    library[function.name()](*arguments)
    first = np.concatenate(made)
    library[function.name()](*arguments)
    np.testing.assert_array_equal(np.concatenate(made), first)
    return first


def results_of(text, function, inputs, tmp_path, name="kernel"):
    """Compile the C text of a function, and return its results for given arguments."""
    return called(library_of(text, [function], tmp_path, name), function, inputs)


def both_derivatives(functions, tmp_path):
    """Compile tables of functions; return for each its derivatives forward and backward, and the library."""
    traced = [[derivative(function, direction) for direction in DIRECTIONS] for function in functions]
    tables = "\n".join(map(c_derivatives, functions))
    return traced, library_of(f'#include "operations.h"\n{tables}', sum(traced, []), tmp_path)
