"""What a command does not import: most of the time of a short one is imports."""

import subprocess
import sys

import pytest

from vdfmu.base.platforms import native_available

_CODE = """
import sys
sys.argv = ["vdfmu", *{arguments!r}]
from vdfmu.cli import main
try:
    main()
except SystemExit as end:
    code = end.code
print(code, *sorted({heavy!r} & set(sys.modules)), file=sys.stderr)
"""
_HEAVY = {"numpy", "scipy", "casadi", "matplotlib", "fmpy", "lxml", "pythonfmu", "pydantic", "rich.progress"}
_TO_MAKE = {
    "vdfmu.compiler.c.functions", "vdfmu.compiler.c.generate", "vdfmu.compiler.fmu.native",
    "vdfmu.study.sweeps", "vdfmu.system.program",
}  # fmt: skip
"""Modules that make what a run again has in the cache."""
_SLOW = {
    "email", "http", "importlib.metadata", "matplotlib", "pydantic", "pythonfmu", "rich.progress",
    "scipy.integrate", "scipy.io", "scipy.linalg", "scipy.optimize", "scipy.sparse", "scipy.spatial",
}  # fmt: skip


def end(*arguments, heavy=_HEAVY):
    """Return exit code and which of the heavy modules were imported."""
    code = _CODE.format(arguments=arguments, heavy=heavy)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    return done.stderr.splitlines()[-1].split()


@pytest.mark.parametrize("arguments", [["--version"], ["run", "--help"]])
def test_help_imports_nothing_heavy(arguments):
    code, *imported = end(*arguments)
    assert code == ("0" if arguments else "2")  # without a command, as wrong usage
    assert imported == []


@pytest.mark.parametrize(
    "arguments",
    [
        ["run", "--foo"], ["ran"], ["build", "trackng"],
        ["run", "--robot", "manipulator"],
    ],
)  # fmt: skip
def test_a_usage_error_or_a_wrong_name_is_reported_before_anything_heavy(arguments):
    code, *imported = end(*arguments)
    assert code == "2"
    assert imported == []


def test_a_file_of_another_kind_is_reported_before_anything_but_numpy():
    code, *imported = end("run", "x.py")
    assert code == "2"
    assert set(imported) <= {"numpy"}


@pytest.mark.heavy
@pytest.mark.skipif(not native_available(), reason="the compiler of native FMUs is not installed")
def test_a_run_again_imports_nothing_that_makes_what_it_has(tmp_path):
    for _ in range(2):
        code, *imported = end("run", "planar_tracking", "--out", str(tmp_path / "run"), heavy=_TO_MAKE | _SLOW)
    assert code == "0"
    assert imported == []
