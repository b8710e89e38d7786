"""Functions in C, compiled and called: values, and derivatives by tables against those of CasADi."""

import ctypes
import subprocess

import numpy as np

from tests.cc import CC
from vdfmu.compiler.c.operations import c_derivatives, c_operations
from vdfmu.compiler.c.text import c_prototype, elementary_files
from vdfmu.compiler.functions.derivatives import derivative


def results_of(text, function, inputs, tmp_path, name="kernel", level="-O1"):
    """Compile the C text of a function, without a warning, and return its results for given arguments."""
    # It is called twice: the second time has what the first has left in memory.
    source, library = tmp_path / f"{name}.c", tmp_path / f"{name}.so"
    source.write_text(f'#include "elementary.h"\n{c_prototype(function)};\n{text}')
    for file, other in (c_operations() | elementary_files()).items():
        (tmp_path / file).write_text(other)
    sources = [source, *([tmp_path / "operations.c"] if "Operations" in text else [])]
    flags = ["-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", level, "-ffp-contract=off", "-shared", "-fPIC"]
    subprocess.run([*CC, *flags, "-o", library, *sources], check=True)
    made = [np.full(function.numel_out(i), np.nan) for i in range(function.n_out())]
    arguments = [a.ctypes.data_as(ctypes.c_void_p) for a in (*inputs, *made)]
    called = ctypes.CDLL(str(library))[function.name()]
    called(*arguments)
    first = np.concatenate(made)
    called(*arguments)
    np.testing.assert_array_equal(np.concatenate(made), first)
    return first


def derivatives(function, direction, random, tmp_path):
    """Return the results of a derivative at random arguments, of the table and by CasADi."""
    traced = derivative(function, direction)
    inputs = [random(traced.numel_in(i)) for i in range(traced.n_in())]
    text = f'#include "operations.h"\n{c_derivatives(function)}'
    actual = results_of(text, traced, inputs, tmp_path, direction)
    return actual, np.concatenate([each.full().ravel() for each in traced.call(inputs)])
