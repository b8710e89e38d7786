"""What a command does not import: most of the time of a short one is imports."""

import subprocess
import sys

import pytest

_CODE = """
import sys
sys.argv = ["vdfmu", *{arguments!r}]
from vdfmu.cli import main
try:
    main()
except SystemExit as end:
    code = end.code
heavy = {{"numpy", "scipy", "casadi", "matplotlib", "fmpy", "lxml", "pythonfmu", "pydantic", "rich.progress"}}
print(code, *sorted(heavy & set(sys.modules)), file=sys.stderr)
"""


def end(*arguments):
    """Return exit code and what of the heavy packages was imported."""
    code = _CODE.format(arguments=arguments)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    return done.stderr.splitlines()[-1].split()


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["run", "--help"], ["unit", "--help"], []])
def test_help_imports_nothing_heavy(arguments):
    code, *imported = end(*arguments)
    assert code == "0"
    assert imported == []


@pytest.mark.parametrize("arguments", [["run", "--foo"], ["ran"], ["simulate"], ["check"]])
def test_a_usage_error_imports_nothing_heavy(arguments):
    code, *imported = end(*arguments)
    assert code == "2"
    assert imported == []


@pytest.mark.parametrize(
    "arguments",
    [[command, "trackng"] for command in ("run", "build", "ssp", "linear")]
    + [["build", "trackng", "--container"], ["run", "--robot", "manipulator"]]
    + [["run", "trackng", "--set", "plant.mass=2", "--set", "plant.gravity=0", "--out", "here"]],
)
def test_a_wrong_name_is_told_before_anything_heavy(arguments):
    code, *imported = end(*arguments)
    assert code == "2"
    assert imported == []


def test_a_file_of_another_kind_is_told_before_anything_but_numpy():
    code, *imported = end("run", "x.py")
    assert code == "2"
    assert set(imported) <= {"numpy"}
