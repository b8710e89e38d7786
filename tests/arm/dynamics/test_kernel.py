"""The kernel's cache, its calls and their errors, and the symbols that trace."""

import os
import subprocess
import sys

import casadi as ca
import numpy as np
import platformdirs
import pytest

from vdfmu.arm.kernel import Kernel
from vdfmu.base import cache
from vdfmu.base.cache import cache_folder
from vdfmu.base.errors import KernelError, UsageError
from vdfmu.base.extras import extra_modules
from vdfmu.base.sources import imported
from vdfmu.compiler.scalar.generic import clip, sgn, zeros
from vdfmu.compiler.scalar.jet import Jet
from vdfmu.compiler.scalar.symbol import Symbol, from_sx, to_sx

SIZES = [2, 2, 2, 6]
UNITS = ["arm.units", *(module.__name__.removeprefix("vdfmu.") for module in extra_modules("units"))]


def arguments():
    return [np.array([0.1, 0.2]), np.array([0.3, -0.4]), np.array([1.0, 2.0]), np.arange(6.0)]


def torque(kernel):
    return kernel.rows("inverse_dynamics", arguments(), SIZES)


def files(folder):
    return [path for path in folder.rglob("*") if path.is_file()]


def test_functions_are_kept_by_their_structure_in_the_cache_folder_of_the_environment(planar, tmp_path, monkeypatch):
    first = torque(Kernel(planar, tmp_path))
    # Other values of the same structure use the same functions.
    heavy = torque(Kernel(planar.with_parameters(mass=5.0), tmp_path))
    assert (np.abs(heavy - first) > 1.0).all()
    assert [path.name for path in files(tmp_path)] == ["inverse_dynamics.casadi"]
    torque(Kernel(planar.with_parameters(tool_offset=0.0), tmp_path))
    assert len(files(tmp_path)) == 2
    monkeypatch.setenv("VDFMU_CACHE_DIR", str(tmp_path))
    assert cache_folder() == tmp_path
    np.testing.assert_array_equal(torque(Kernel(planar)), first)
    assert len(files(tmp_path)) == 2
    monkeypatch.delenv("VDFMU_CACHE_DIR")
    assert cache_folder() == platformdirs.user_cache_path("vdfmu", appauthor=False)


@pytest.mark.heavy
@pytest.mark.parametrize(("roots", "code"), [
    (["arm.kernel"], "import vdfmu.arm.kernel"),
    (["compiler", *UNITS], "import vdfmu.arm.units; vdfmu.arm.units.shipped_units()"),
    (["compiler"], "import vdfmu.compiler.fmu.native; import vdfmu.compiler.fmu.documentation"),
    (["system.reference"], "import vdfmu.system.reference.reference"),
])  # fmt: skip
def test_the_digest_of_the_sources_covers_all_that_is_loaded(roots, code):
    """Else a change there would leave functions of before in the cache. Formats of results calculate nothing."""
    code = f"import sys; {code}; print(*(name for name in sys.modules if name.startswith('vdfmu.')))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    formats = {name for name in imported("extras.matlab.result_formats") if name.startswith("extras")}
    loaded = {name.removeprefix("vdfmu.") for name in run.stdout.split()} - {"base.version", "extras"} - formats
    assert "base.measure" in loaded
    assert loaded <= set(imported(*roots))


@pytest.mark.parametrize("damage", [
    lambda good: b"", lambda good: b"not a function", lambda good: good[: len(good) // 2],
    lambda good: good[:70] + bytes([good[70] ^ 1]) + good[71:],
    lambda good: good[:-2] + bytes([good[-2] ^ 1, good[-1]]),
])  # fmt: skip
def test_a_damaged_cache_file_changes_no_result_and_is_replaced(planar, tmp_path, damage):
    expected = torque(Kernel(planar, tmp_path))
    (path,) = tmp_path.rglob("*.casadi")
    good = path.read_bytes()
    path.write_bytes(damage(good))
    np.testing.assert_array_equal(torque(Kernel(planar, tmp_path)), expected)
    assert path.read_bytes() == good


def test_a_cache_folder_that_cannot_be_made_only_costs_time(planar, tmp_path):
    file = tmp_path / "file"
    file.write_text("in the way of a folder")
    expected = torque(Kernel(planar, None))
    np.testing.assert_array_equal(torque(Kernel(planar, file / "cache")), expected)
    assert os.listdir(tmp_path) == ["file"]


def fill(folder, names, size):
    for age, name in enumerate(reversed(names)):
        cache.store(folder / name, name.encode().ljust(size))
        os.utime(folder / name, (1e9 - age, 1e9 - age))


def stored(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def test_beyond_its_size_the_cache_forgets_what_was_not_used_for_longest(tmp_path, monkeypatch):
    monkeypatch.setenv("VDFMU_CACHE_MB", str(10_000 / 2**20))
    (tmp_path / cache.COMPILER).mkdir()
    (tmp_path / cache.COMPILER / "huge").write_bytes(bytes(50_000))  # is not ours
    fill(tmp_path, ["a/1", "a/2", "b/3", "b/4", "b/5"], 1_900)  # and 65 bytes each for the digest: below the limit
    assert stored(tmp_path) == ["a/1", "a/2", "b/3", "b/4", "b/5", f"{cache.COMPILER}/huge"]
    assert cache.load(tmp_path / "a/1") is not None  # used now
    cache.store(tmp_path / "c/6", bytes(1_900))
    # 6 times 1965 bytes are too many: three quarters of the limit hold 3 files
    assert stored(tmp_path) == ["a/1", "b/5", "c/6", f"{cache.COMPILER}/huge"]
    cache.store(tmp_path / "c/7", bytes(9_000))  # one that fills the cache stays alone; empty folders go
    assert stored(tmp_path) == ["c/7", f"{cache.COMPILER}/huge"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["c", cache.COMPILER]


def test_a_folder_that_holds_other_files_too_keeps_them(tmp_path, monkeypatch):
    """Such as ``VDFMU_CACHE_DIR=$HOME``."""
    monkeypatch.setenv("VDFMU_CACHE_MB", "0")
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "long").write_bytes(bytes(20_000))
    fill(tmp_path, ["a/1", "letters/2"], 100)
    assert stored(tmp_path) == ["a/1", "letters/long"]  # of the entries the last that was stored
    assert [entry.path.name for entry in cache.entries(tmp_path) if entry.remove()] == ["1"]
    assert stored(tmp_path) == ["letters/long"]


@pytest.mark.parametrize("limit", ["much", "-1", "nan"])
def test_a_limit_that_is_not_a_size_is_refused(tmp_path, monkeypatch, limit):
    monkeypatch.setenv("VDFMU_CACHE_MB", limit)
    with pytest.raises(UsageError, match=f"VDFMU_CACHE_MB: expected .* a number >= 0 in MB, got '{limit}'"):
        cache.store(tmp_path / "a" / "1", b"")
    with pytest.raises(UsageError, match="VDFMU_CACHE_MB"):  # before any work that would then be lost
        cache_folder()


CROWD = """
import sys
from pathlib import Path
from vdfmu.base import cache
folder, seed = Path(sys.argv[1]), int(sys.argv[2])
for k in range(300):
    name = f"{(seed * k) % 3}/{(7 * k + seed) % 40}"
    expected = name.encode().ljust(1_000)
    stored = cache.load(folder / name)
    assert stored in (None, expected), name
    if stored is None:
        cache.store(folder / name, expected)
"""


@pytest.mark.heavy
def test_processes_share_a_cache_that_each_of_them_empties(tmp_path):
    crowd = [
        subprocess.Popen(
            [sys.executable, "-c", CROWD, tmp_path, str(seed)], stderr=subprocess.PIPE, text=True,
            env=os.environ | {"VDFMU_CACHE_MB": str(20_000 / 2**20)},
        )
        for seed in (1, 2, 5)
    ]  # fmt: skip
    for process in crowd:
        _, errors = process.communicate(timeout=120)
        assert process.returncode == 0, errors
    files = stored(tmp_path)
    assert files and not [name for name in files if name.endswith(".tmp")]
    # the last file of each process may come after the last look of the others
    assert sum((tmp_path / name).stat().st_size for name in files) <= 20_000 + 3 * 1_065


def test_a_function_has_buffers_of_its_own_or_those_that_are_given(planar, kernel_of):
    a, b = (kernel_of(planar).function("inverse_dynamics") for _ in range(2))
    a.args["q"][:] = 1.0
    assert not b.args["q"].any()
    q = np.array([0.3, 0.4])
    assert kernel_of(planar).function("inverse_dynamics", q=q).args["q"] is q
    for wrong in (np.zeros(3), np.zeros(2, dtype=np.float32), np.zeros(4)[::2]):
        with pytest.raises(KernelError, match=r"buffer of q: expected a contiguous float array of shape \(2,\)"):
            kernel_of(planar).function("inverse_dynamics", q=wrong)


def symbol(name="s"):
    return Symbol(ca.SX.sym(name))


def test_symbol_refuses_to_become_a_float():
    with pytest.raises(KernelError, match=r"Symbol\(s\) has no value while equations are traced"):
        float(symbol())
    with pytest.raises(KernelError, match=r"zeros\(shape, \*like\) for an array that receives it"):
        np.zeros(2)[0] = symbol()
    assert float(Symbol(2.5)) == 2.5


@pytest.mark.parametrize("ask", [
    lambda s: bool(s), lambda s: s == 0.0, lambda s: s != 0.0, lambda s: s in [0.0],
    lambda s: np.array([s, s]) == 0.0, lambda s: 1.0 if s else 0.0,
])  # fmt: skip
def test_symbol_refuses_to_be_true_or_false(ask):
    with pytest.raises(KernelError, match="a condition on a value is not known while equations are traced"):
        ask(symbol())


def test_symbols_compute_as_floats_do_without_order_or_hash():
    with pytest.raises(KernelError, match=r"where\(condition, a, b\), clip, minimum, maximum or sgn"):
        sorted([symbol("a"), symbol("b")])
    with pytest.raises(TypeError, match="unhashable"):
        {symbol()}
    x = ca.SX.sym("x", 2)
    s = from_sx(x)
    value = np.array([0.7, -1.3])

    def f(u):
        a, b = u[0], u[1]
        return [
            a + 1 - b, 1 - a, 2.0 * a / b, 3.0 / a, -a, abs(b), a**2, a**b,
            np.float64(2.0) * a, a * np.float64(2.0), sgn(b), *np.sin(u), *np.cos(u), *np.tanh(u), *np.exp(u),
            *np.expm1(u), *np.arctan(u), *np.log1p(u * u), *np.sqrt(u * u), *clip(u, -1.0, 0.5), *sgn(u),
        ]  # fmt: skip

    results = ca.Function("f", [x], [to_sx(f(s))])(value).full().ravel()
    # One rounding of each library's own functions, on values up to 4.
    np.testing.assert_allclose(results, np.array(f(value), dtype=float), rtol=0, atol=4e-15)


def test_symbols_and_jets_mix_with_arrays_that_are_laid_out_row_by_row_as_in_fmi():
    s = symbol()
    row = s * np.array([1.0, 2.0])
    assert row.dtype == object and all(isinstance(v, Symbol) for v in row)
    assert isinstance(s * Jet(1.0, 2.0), Jet) and isinstance(Jet(1.0, 2.0) - s, Jet) and isinstance(s - Jet(1.0), Jet)
    assert Symbol(0.0).is_zero() and not s.is_zero()
    assert (s * 0.0).is_zero()
    assert zeros((2,), row).dtype == object and zeros((2,), np.zeros(3)).dtype == float
    assert repr(s) == "Symbol(s)" and len(repr(sum([s] * 100, s))) < 75
    jet, array = Jet(1.0, 2.0, 3.0), np.array([2.0, 3.0])
    for product in (jet * array, array * jet, jet + array, array - jet, jet - array, jet / array, array / jet):
        assert isinstance(product, np.ndarray) and all(isinstance(v, Jet) for v in product)
    matrix = ca.SX.sym("m", 2, 3)
    assert from_sx(matrix).shape == (2, 3)
    function = ca.Function("f", [matrix], [to_sx(from_sx(matrix))])
    values = np.arange(6.0).reshape(2, 3)
    np.testing.assert_array_equal(function(values).full().ravel(), values.ravel())
