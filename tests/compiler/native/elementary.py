"""Accuracy of elementary functions in the C, for tests of FMUs and of the batch engine."""

from collections.abc import Callable

import numpy as np

SMALL = 1e-6
FUNCTIONS = {
    # name: numpy's, units in the last place, and sizes up to which arguments are tried
    "sin": (np.sin, 3, (SMALL, 1.0, 1e3, 9.9e4, 1e7, 1e15, 1e300)),
    "cos": (np.cos, 3, (SMALL, 1.0, 1e3, 9.9e4, 1e7, 1e15, 1e300)),
    "tan": (np.tan, 6, (SMALL, 1.0, 1e3, 1e15)),
    "asin": (np.arcsin, 3, (SMALL, 0.5, 1.0)),
    "acos": (np.arccos, 3, (SMALL, 0.5, 1.0)),
    "atan": (np.arctan, 3, (SMALL, 0.2, 1.0, 6.0, 1e6)),
    "sinh": (np.sinh, 4, (SMALL, 1.0, 40.0, 710.0)),
    "cosh": (np.cosh, 4, (SMALL, 1.0, 40.0, 710.0)),
    "tanh": (np.tanh, 3, (SMALL, 1.0, 10.0, 1e3)),
    "asinh": (np.arcsinh, 3, (SMALL, 1.0, 1e3, 1e300)),
    "acosh": (np.arccosh, 3, (1.0 + SMALL, 10.0, 1e300)),
    "atanh": (np.arctanh, 3, (SMALL, 0.5, 0.999999)),
    "exp": (np.exp, 3, (SMALL, 1.0, 40.0, 700.0)),
    "expm1": (np.expm1, 3, (SMALL, 1.0, 40.0, 700.0)),
    "log": (np.log, 2, (1.001, 3.0, 1e300)),
    "log1p": (np.log1p, 2, (SMALL, 0.3, 0.99)),
}
"""A rounding is half a unit, or one unit just above a power of 2.

exp: the sum 1 + less, and `less`, at most 0.42, with two roundings and the rounding of its argument. expm1: a product
and a sum after that. tanh: a quotient of that by a rounded divisor. sin, cos: two roundings of the angle, one of the
sum. tan: a quotient of both, 3 + 3. atan: a quotient and a sum. sinh, cosh: a quotient and a sum after expm1 or exp.
asin, acos: atan of a quotient by a root. log: the rest and its sum with the leading part. asinh, acosh, atanh: log1p of
an argument with four roundings. Less than half of each arrives.
"""


def assert_accurate(name: str, run: Callable[[np.ndarray], np.ndarray], count: int = 40_000) -> None:
    """Hold a function against numpy's in extended precision, and at the ends of its range."""
    of, last_places, sizes = FUNCTIONS[name]
    random = np.random.default_rng(1)
    least = {"log": 0.0, "acosh": 1.0}
    for size in sizes:
        x = random.uniform(least.get(name, -size), size, count)
        expected = of(x.astype(np.longdouble))
        ulp = np.abs((run(x) - expected) / np.spacing(np.abs(expected).astype(float)))
        assert ulp.max() < last_places, (size, x[ulp.argmax()])
    ends = [0.0, -0.0, np.inf, -np.inf, np.nan, 800.0, -800.0, 1e-320, 1.0, -1.0, 2.0, 709.7, -707.9, 0.5, -0.5, 1e5]
    ends += [-1e9, -1e17, -1e200, 1e17, 1e200, -1e-320, -700.0, 1e-200]
    x = np.array(ends)  # three vectors of eight
    with np.errstate(all="ignore"):
        expected = of(x.astype(np.longdouble)).astype(float)
    # a number below the normal ones may be off by its own last place
    np.testing.assert_allclose(run(x), expected, rtol=last_places * 2.3e-16, atol=5e-324)
