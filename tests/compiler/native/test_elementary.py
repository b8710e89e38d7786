"""The elementary functions of the C: within their last places, at the ends of their range, and four at a time."""

import math
from ctypes import c_int64, c_void_p
from functools import partial

import numpy as np
import pytest

from tests.compiler.native.elementary import FUNCTIONS, assert_accurate
from vdfmu.base.compile import SHOWN, loaded
from vdfmu.compiler.c.text import elementary_files

OF_TWO = ("pow", "atan2", "hypot", "fmod")
LANES = ("exp", "expm1", "tanh", "atan")


@pytest.fixture(scope="module")
def library():
    texts = [f'#include "elementary.h"\n{SHOWN}']
    for name in (*FUNCTIONS, *OF_TWO):
        other = ", const double *y" if name in OF_TWO else ""
        head = f"SHOWN void call_{name}(const double *x{other}, double *out, int64_t n)"
        value = f"{name}(x[i]{', y[i]' if other else ''})"
        texts.append(f"{head};\n{head}\n{{\n    for (int64_t i = 0; i < n; i++)\n        out[i] = {value};\n}}")
    for name in LANES:
        head = f"SHOWN void each_of_{name}(double *x)"
        texts.append(f"{head};\n{head}\n{{\n    each_{name}(x, 8);\n}}")
    head = "SHOWN void each_of_sin_cos(double *x, double *y)"
    texts.append(f"{head};\n{head}\n{{\n    each_sin_cos(x, y, 8);\n}}\n")
    files = {name: text.encode() for name, text in elementary_files().items()}
    return loaded(files | {"called.c": "\n".join(texts).encode()}, "called")


def called(library, name, *arguments):
    arrays = [np.ascontiguousarray(x, dtype=float) for x in arguments]
    out = np.zeros_like(arrays[0])
    function = library[f"call_{name}"]
    function.argtypes, function.restype = (c_void_p,) * (len(arrays) + 1) + (c_int64,), None
    function(*(x.ctypes.data for x in arrays), out.ctypes.data, len(out))
    return out


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_are_within_their_last_places_and_at_the_ends_those_of_the_c_library(library, name):
    assert_accurate(name, partial(called, library, name))


def pairs(first, second):
    return (x.ravel() for x in np.meshgrid(first, second))


def test_powers_are_within_two_last_places(library):
    random = np.random.default_rng(3)
    for base, exponent in (
        (10.0 ** random.uniform(-3, 3, 40_000), 90.0),
        (1.0 + random.uniform(-1e-4, 1e-4, 40_000), 1e6),
    ):
        y = random.uniform(-exponent, exponent, len(base))
        expected = base.astype(np.longdouble) ** y.astype(np.longdouble)
        # 2^k times a number near 1 that exp rounds, 1.5; extended precision loses up to 2^-54 of a power itself
        ulp = np.abs((called(library, "pow", base, y) - expected) / np.spacing(expected.astype(float)))
        assert ulp.max() < 2


def test_functions_of_two_numbers_are_those_of_the_c_library(library):
    """Python's own call the C library. Both are within 1 and 2 units of the value, and fmod is exact."""
    special = [0.0, -0.0, 0.5, -0.5, 1.0, 2.0, 3.0, -3.0, 5e-324, 1e-310, 1e200, -1e308, math.inf, -math.inf, math.nan]
    x, y = pairs(special, special)
    for name in OF_TWO:
        for a, b, value in zip(x, y, called(library, name, x, y), strict=True):
            try:
                expected = float(getattr(math, name)(a, b))
            except (ValueError, OverflowError):  # Python refuses NaN and infinity as results
                assert not math.isfinite(value), (name, a, b)
                continue
            assert value == pytest.approx(expected, rel=0 if name == "fmod" else 7e-16, abs=0, nan_ok=True), (
                name,
                a,
                b,
            )
            assert math.isnan(expected) or math.copysign(1.0, value) == math.copysign(1.0, expected), (name, a, b)


def test_several_numbers_have_the_bits_of_one(library):
    random = np.random.default_rng(2)
    x = np.concatenate([random.uniform(-3.0, 3.0, 96), [math.nan, math.inf, 1e9, -1e300, 700.0, -0.5, 0.0, -800.0]])
    x = random.permutation(x).reshape(-1, 8)
    for name in (*LANES, "sin_cos"):
        function = library[f"each_of_{name}"]
        function.argtypes, function.restype = (c_void_p,) * (2 if name == "sin_cos" else 1), None
        for row in x:
            y, cosine = row.copy(), np.zeros(8)
            function(*(each.ctypes.data for each in (y, cosine)[: len(function.argtypes)]))
            results = {"sin": y, "cos": cosine} if name == "sin_cos" else {name: y}
            for of, made in results.items():
                assert made.tobytes() == called(library, of, row).tobytes(), of
