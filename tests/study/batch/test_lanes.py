"""The functions of lanes.h against numpy's in extended precision, and that lanes do not meet."""

from ctypes import c_int64, c_void_p

import numpy as np
import pytest

from tests.conftest import heavy
from vdfmu.base.compile import SHOWN, compile_library, load_library
from vdfmu.base.files import data_path
from vdfmu.base.platforms import this_platform
from vdfmu.study.batch.make import FLAGS, LEVELS

FUNCTIONS = {
    # name: numpy's, and sizes up to which arguments are tried
    "sin": (np.sin, (1e-6, 1.0, 1e3, 9.9e4, 1e7)),
    "cos": (np.cos, (1e-6, 1.0, 1e3, 9.9e4, 1e7)),
    "exp": (np.exp, (1e-6, 1.0, 40.0, 700.0)),
    "expm1": (np.expm1, (1e-6, 1.0, 40.0, 700.0)),
    "tanh": (np.tanh, (1e-6, 1.0, 10.0, 1e3)),
    "atan": (np.arctan, (1e-6, 0.2, 1.0, 6.0, 1e6)),
    "tan": (np.tan, (1.0,)),
    "log1p": (np.log1p, (0.5,)),
}
ULP = 3.0
"""Units in the last place. exp: the sum 1 + less rounds by 1/2, and `less`, at most 0.42, has two roundings of 1/4, and
less than 1/4 by the reduction of the argument. expm1: a product and a sum after that, 2; tanh: a quotient of that by a
rounded divisor, 2.5. sin, cos, atan: the sum of the leading term and a small correction, 1; for atan after a quotient,
1.5."""


def source() -> bytes:
    called = "\n".join(
        f"SHOWN void call_{name}(const scalar *x, scalar *y, int64_t n);\n"
        f"void call_{name}(const scalar *x, scalar *y, int64_t n)\n{{\n"
        "    for (int64_t i = 0; i < n; i += LANES) {\n        real v;\n        memcpy(&v, x + i, sizeof v);\n"
        f"        v = {name}(v);\n        memcpy(y + i, &v, sizeof v);\n    }}\n}}"
        for name in FUNCTIONS
    )
    return f'#include "lanes.h"\n#include "shown.h"\n{called}\n'.encode()


@pytest.fixture(scope="module", params=[0, *heavy(*range(1, len(LEVELS)))])
def library(request):
    folder = data_path("fmu_src")
    files = {name: (folder / "batch" / name).read_bytes() for name in ("lanes.h", "level.c")}
    files |= {name: (folder / "c" / name).read_bytes() for name in ("processor.c", "processor.h")}
    files |= {"shown.h": SHOWN.encode(), "functions.c": source()}

    def made(level):
        lanes, flags = LEVELS[level]
        flags = (*FLAGS, f"-DLANES={lanes}", *flags)
        return load_library(compile_library(files, this_platform(), name="functions", flags=flags), "functions")

    best = made(0).level()
    if request.param > best:  # what this processor cannot run is compiled all the same, and its best tried once more
        made(request.param)
    return made(min(request.param, best))


def called(library, name, x):
    x = np.ascontiguousarray(x, dtype=float)
    y = np.zeros_like(x)
    function = library[f"call_{name}"]
    function.argtypes, function.restype = (c_void_p, c_void_p, c_int64), None
    function(x.ctypes.data, y.ctypes.data, len(x))
    return y


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_are_within_their_last_places_and_at_the_ends_those_of_the_c_library(library, name):
    of, sizes = FUNCTIONS[name]
    random = np.random.default_rng(1)
    for size in sizes:
        x = random.uniform(-size, size, 80_000)
        expected = of(x.astype(np.longdouble))
        ulp = np.abs((called(library, name, x) - expected) / np.spacing(np.abs(expected).astype(float)))
        assert ulp.max() < ULP, (size, x[ulp.argmax()])
    x = np.array([0.0, -0.0, np.inf, -np.inf, np.nan, 800.0, -800.0, 1e-320])
    with np.errstate(all="ignore"):
        expected = FUNCTIONS[name][0](x.astype(np.longdouble)).astype(float)
    y = called(library, name, x)
    # ULP as above; a number below the normal ones may be off by its own last place
    np.testing.assert_allclose(y, expected, rtol=ULP * 2.3e-16, atol=5e-324)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_lane_has_its_bits_whatever_is_beside_it(library, name):
    random = np.random.default_rng(2)
    x = random.uniform(-0.9, 0.9, 64)
    alone = np.array([called(library, name, np.full(8, one))[0] for one in x])
    mixed = np.zeros(8 * len(x))
    neighbours = [np.nan, np.inf, 1e9, -1e300, 700.0, -0.5, 0.0]
    for k, one in enumerate(x):
        row = random.permutation([*neighbours, one])
        mixed[8 * k : 8 * k + 8] = row
    y = called(library, name, mixed)
    assert (y[np.isin(mixed, x) & (mixed != -0.5)] == alone).all()
