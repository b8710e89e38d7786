"""The functions of lanes.h with fused products against numpy's in extended precision, and that lanes do not meet."""

from ctypes import c_int64, c_void_p
from functools import partial

import numpy as np
import pytest

from tests.compiler.native.elementary import assert_accurate
from tests.conftest import heavy
from vdfmu.base.compile import SHOWN, compile_library, load_library
from vdfmu.base.files import data_path
from vdfmu.base.platforms import this_platform
from vdfmu.compiler.c.text import elementary_files
from vdfmu.extras.batch.programs import FLAGS, LEVELS

FUNCTIONS = ("sin", "cos", "exp", "expm1", "tanh", "atan", "tan", "log1p")


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
    files |= {name: text.encode() for name, text in elementary_files().items()}
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
    n, x = len(x), np.pad(np.asarray(x, dtype=float), (0, -len(x) % 8))  # to whole blocks of any number of lanes
    y = np.zeros_like(x)
    function = library[f"call_{name}"]
    function.argtypes, function.restype = (c_void_p, c_void_p, c_int64), None
    function(x.ctypes.data, y.ctypes.data, len(x))
    return y[:n]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_fused_products_keep_the_accuracy(library, name):
    assert_accurate(name, partial(called, library, name))


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_lane_has_its_bits_whatever_is_beside_it(library, name):
    random = np.random.default_rng(2)
    x = random.uniform(-0.9, 0.9, 64)
    alone = np.array([called(library, name, np.full(8, argument))[0] for argument in x])
    mixed = np.zeros(8 * len(x))
    neighbours = [np.nan, np.inf, 1e9, -1e300, 700.0, -0.5, 0.0]
    for k, argument in enumerate(x):
        row = random.permutation([*neighbours, argument])
        mixed[8 * k : 8 * k + 8] = row
    y = called(library, name, mixed)
    assert (y[np.isin(mixed, x) & (mixed != -0.5)] == alone).all()
