"""Accuracy of elementary functions in the C, for tests of FMUs and of the batch engine."""

import re
from collections.abc import Callable

import numpy as np

from vdfmu.compiler.c.text import elementary_files

SMALL, NEAREST = 1e-6, 5e-324
FUNCTIONS = {
    # name: numpy's, and sizes up to which arguments are tried
    "sin": (np.sin, (SMALL, 1.0, 1e3, 9.9e4, 1e7, 1e15, 1e300)),
    "cos": (np.cos, (SMALL, 1.0, 1e3, 9.9e4, 1e7, 1e15, 1e300)),
    "tan": (np.tan, (SMALL, 1.0, 1e3, 1e15, 1e300)),
    "asin": (np.arcsin, (SMALL, 0.5, 1.0)),
    "acos": (np.arccos, (SMALL, 0.5, 1.0)),
    "atan": (np.arctan, (SMALL, 0.2, 1.0, 6.0, 1e6)),
    "sinh": (np.sinh, (SMALL, 1.0, 40.0, 710.0)),
    "cosh": (np.cosh, (SMALL, 1.0, 40.0, 710.0)),
    "tanh": (np.tanh, (SMALL, 1.0, 10.0, 1e3)),
    "asinh": (np.arcsinh, (SMALL, 1.0, 1e3, 1e300)),
    "acosh": (np.arccosh, (1.0 + SMALL, 10.0, 1e300)),
    "atanh": (np.arctanh, (SMALL, 0.5, 0.999999)),
    "exp": (np.exp, (SMALL, 1.0, 40.0, 700.0)),
    "expm1": (np.expm1, (SMALL, 1.0, 40.0, 700.0)),
    "log": (np.log, (1.001, 3.0, 1e300)),
    "log1p": (np.log1p, (SMALL, 0.3, 0.99)),
}
"""The measured errors are about half of what the roundings allow. A rounding is half a unit, or one unit just above a
power of 2.

exp: the sum 1 + less, and `less`, at most 0.42, with two roundings and the rounding of its argument. expm1: a product
and a sum after that. tanh: a quotient of that by a rounded divisor. sin, cos: two roundings of the angle, one of the
sum. tan: a quotient of both. atan: a quotient and a sum. sinh, cosh: a quotient and a sum after expm1 or exp. asin,
acos: atan of a quotient by a root. log: the rest and its sum with the leading part. asinh, acosh, atanh: log1p of an
argument with four roundings.
"""
LIKE_ITS_ARGUMENT = {"sin", "tan", "asin", "atan", "sinh", "tanh", "asinh", "atanh", "expm1", "log1p"}
"""Functions f with f(0) = 0 and f'(0) = 1: f(x) is x below 1e-300, to the sign of zero."""


def documented_errors() -> dict[str, float]:
    """Return the largest errors [units in the last place] that elementary.h states."""
    text = elementary_files()["elementary.h"].partition("*/")[0]
    return {name: float(error) for name, error in re.findall(r"(\w+) (\d\.\d)", text) if name in FUNCTIONS}


def errors(name: str, run: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """Return the errors [units in the last place] of a function; 0 where the value is beyond the finite numbers."""
    with np.errstate(all="ignore"):
        expected = FUNCTIONS[name][0](x.astype(np.longdouble))
        size = np.maximum(np.abs(expected).astype(float), NEAREST)
        return np.where(np.isfinite(size), np.abs((run(x) - expected) / np.spacing(size)), 0.0)


def assert_accurate(name: str, run: Callable[[np.ndarray], np.ndarray], count: int = 40_000) -> None:
    """Hold a function against numpy's in extended precision, and at the ends of its range."""
    of, sizes = FUNCTIONS[name]
    last_places = documented_errors()[name]
    random = np.random.default_rng(1)
    least = {"log": 0.0, "acosh": 1.0}
    for size in sizes:
        x = random.uniform(least.get(name, -size), size, count)
        ulp = errors(name, run, x)
        assert ulp.max() < last_places, (size, x[ulp.argmax()])
    ends = [0.0, -0.0, np.inf, -np.inf, np.nan, 800.0, -800.0, 1e-320, 1.0, -1.0, 2.0, 709.7, -707.9, 0.5, -0.5, 1e5]
    ends += [-1e9, -1e17, -1e200, 1e17, 1e200, -1e-320, -700.0, 1e-200]
    x = np.array(ends)  # three vectors of eight
    with np.errstate(all="ignore"):
        expected = of(x.astype(np.longdouble)).astype(float)
    # a number below the normal ones may be off by its own last place
    np.testing.assert_allclose(run(x), expected, rtol=last_places * 2.3e-16, atol=NEAREST)
    if name in (
        "sin",
        "cos",
        "tan",
    ):  # beside multiples of pi/2, the last of which is the nearest of all numbers to one
        turns = np.concatenate([np.arange(1.0, 10_000.0), random.integers(1, 2**53, 10_000).astype(float)])
        beside = (turns.astype(np.longdouble) * (2 * np.arctan(np.longdouble(1.0)))).astype(float)
        for x in (beside, np.nextafter(beside, 0.0), np.array([6381956970095103.0 * 2.0**797])):
            assert errors(name, run, x).max() < last_places
    if name in LIKE_ITS_ARGUMENT:
        x = np.array([0.0, NEAREST, 3 * NEAREST, 7e-322, 1e-310, 2.3e-308, 1e-305, 1e-300])
        assert run(x).tobytes() == x.tobytes()
        assert run(-x).tobytes() == (-x).tobytes()
