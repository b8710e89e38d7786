"""What a compiler finds in the environment: nothing there changes an FMU, neither built anew nor from a cache."""

import os
import shutil
import subprocess
import sys
from hashlib import sha256

import pytest

from vdfmu.base import platforms
from vdfmu.base.compile import Compilation, compile_library
from vdfmu.base.platforms import this_platform

OWN = [name for name in ("gcc", "clang") if shutil.which(name)]
ALL = [*(["zig"] if platforms.native_available() and platforms.compiler().is_zig else []), *OWN]
HEADER = "#include_next <math.h>\n#define sqrt(x) 0.25\n"
ROOT = b"#include <math.h>\ndouble root(double x);\ndouble root(double x) { return sqrt(x) + sin(x); }\n"
PROGRAM = '#!/bin/sh\necho "a program in place of the compiler\'s" >&2\nexit 3\n'
BUILD = """
import os, sys
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import load_robot
os.umask(int(sys.argv[2], 8))
build_fmus(load_robot("planar_2dof"), sys.argv[1], units=["controller"], backend="native")
"""


@pytest.fixture
def hostile(tmp_path):
    """Return variables that change what a compiler makes or stop it, with a header, programs and a library."""
    headers, programs, libraries = (tmp_path / name for name in ("headers", "programs", "libraries"))
    for folder in (headers, programs, libraries):
        folder.mkdir()
    (headers / "math.h").write_text(HEADER)
    (libraries / "libm.so").write_text("this is no library")
    for name in ("as", "ld", "cc1", "collect2"):
        (programs / name).write_text(PROGRAM)
        (programs / name).chmod(0o755)
    return {
        "CPATH": str(headers), "C_INCLUDE_PATH": str(headers), "CPLUS_INCLUDE_PATH": str(headers),
        "LIBRARY_PATH": str(libraries), "LD_LIBRARY_PATH": str(libraries), "COMPILER_PATH": str(programs),
        "GCC_EXEC_PREFIX": f"{programs}/", "CCC_OVERRIDE_OPTIONS": "+-DEXTRA +-ffast-math", "SDKROOT": str(headers),
        "CFLAGS": "-ffast-math", "ZIG_LIB_DIR": str(headers), "ZIG_LOCAL_CACHE_DIR": str(headers / "zig"),
        "ZIG_LIBC": str(headers / "math.h"), "DEPENDENCIES_OUTPUT": str(tmp_path / "dependencies"),
        "SOURCE_DATE_EPOCH": "1", "LANG": "de_DE.UTF-8", "LC_ALL": "tr_TR.UTF-8", "LD_RUN_PATH": str(libraries),
    }  # fmt: skip


@pytest.mark.skipif(not ALL, reason="needs a C compiler")
def test_a_compiler_gets_no_variable_that_its_key_lacks(hostile, monkeypatch, tmp_path):
    """All at once. That they do harm is seen where the same compiler is started with them."""
    monkeypatch.setenv("VDFMU_COMPILER", ALL[-1])
    monkeypatch.setenv("VDFMU_CACHE_DIR", str(tmp_path / "1"))
    sources, here = {"unit.c": ROOT}, this_platform()
    clean, key = compile_library(sources, here, name="Root"), Compilation("Root", sources, here).key
    monkeypatch.setenv("VDFMU_CACHE_DIR", str(tmp_path / "2"))
    for name, value in hostile.items():
        monkeypatch.setenv(name, value)
    platforms._compiler.cache_clear()
    mask = os.umask(0o077)
    try:
        assert Compilation("Root", sources, here).key == key
        assert compile_library(sources, here, name="Root") == clean
    finally:
        os.umask(mask)
        platforms._compiler.cache_clear()
    assert not (tmp_path / "dependencies").exists()
    (tmp_path / "unit.c").write_bytes(ROOT)
    command = [*platforms.compiler(here).command, "-E", "unit.c"]
    shown = subprocess.run(command, cwd=tmp_path, env=os.environ | hostile, capture_output=True, text=True)
    assert shown.returncode or "0.25 + sin" in shown.stdout


@pytest.mark.heavy
@pytest.mark.parametrize("program", ALL)
def test_the_environment_leaves_an_fmu_as_it_is(program, hostile, tmp_path):
    """Built with all variables and a umask that closes files to others, and from the cache that this left."""

    def digest(place: str, cache: str, mask: str, **variables: str) -> str:
        shared = {"VDFMU_CACHE_DIR": str(tmp_path / cache), "VDFMU_COMPILER": program}
        words = [sys.executable, "-c", BUILD, str(tmp_path / place), mask]
        done = subprocess.run(words, env={**os.environ, **shared, **variables}, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return sha256((tmp_path / place / "PDController.fmu").read_bytes()).hexdigest()

    obeyed = {name: value for name, value in hostile.items() if name != "LD_LIBRARY_PATH"}  # which Python obeys itself
    expected = digest("clean", "clean_cache", "022")
    assert digest("hostile", "cache", "077", **obeyed) == expected
    assert digest("again", "cache", "022") == expected
