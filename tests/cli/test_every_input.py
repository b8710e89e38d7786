"""Commands end in words, whatever the input, the streams and the packages that are installed."""

import json
import math
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.warm import command
from vdfmu import __version__
from vdfmu.base.text import to_json
from vdfmu.engine.algorithms import ALGORITHMS

ROOT = Path(__file__).parents[2]


def vdfmu(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    if not any(name.startswith("PYTHON") for name in environment):
        return command(*arguments, env=os.environ | environment)
    return subprocess.run(
        [sys.executable, "-m", "vdfmu.cli", *arguments],
        capture_output=True, encoding="utf-8", errors="surrogateescape", env=os.environ | environment, timeout=300,
        check=False,
    )  # fmt: skip


@pytest.mark.heavy
@pytest.mark.parametrize("arguments", [
    ("run", "a" * 300), ("run", "--robot", "a" * 100_000), ("run", "a" * 300 + ".toml"), ("check", "a" * 300),
    ("run", "a" * 300 + ".ssp"), ("run", "planar_tracking", "--stop", "1e308"),
    ("run", "planar_tracking", "--stop", "1e9"), ("run", "planar_tracking", "--set", "plant.I_m=1e308"),
    ("run", "planar_tracking", "--set", "plant.K_f0=5e-324"),
], ids=lambda arguments: " ".join(arguments)[:40])  # fmt: skip
def test_an_input_that_cannot_be_used_is_named(arguments: tuple[str, ...]) -> None:
    done = vdfmu(*arguments)
    assert done.returncode == 2, done.stderr[-500:]
    assert done.stderr.splitlines()[-1].startswith("error: ")
    assert "Traceback" not in done.stderr
    assert "output cannot be written" not in done.stderr


@pytest.mark.heavy
@pytest.mark.parametrize(
    "environment",
    [{"PYTHONIOENCODING": "ascii"}, {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}],
    ids=["ascii", "C locale"],
)
def test_streams_of_ascii_take_every_text(environment: dict[str, str]) -> None:
    done = vdfmu("robot", "show", "tést·", **environment)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("error: no robot 't\\")
    assert done.stderr.isascii()
    listed = vdfmu("robot", "list", **environment)
    assert listed.returncode == 0
    assert listed.stdout.isascii()


NEEDED = [
    re.split("[<>=]", entry)[0]
    for entry in tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
]


def without(package: str, folder: Path) -> str:
    """Return a path of modules on which a package is missing."""
    (folder / "sitecustomize.py").write_text(f"import sys\nsys.modules[{package!r}] = None\n", encoding="utf-8")
    return os.pathsep.join([str(folder), str(ROOT)])


@pytest.mark.heavy
@pytest.mark.parametrize("package", [*NEEDED, "attrs"])
def test_a_missing_package_is_named_where_it_is_needed(package: str, tmp_path: Path) -> None:
    module = {"attrs": "attr"}.get(package, package)  # of fmpy
    path = without(module, tmp_path)
    done = vdfmu("--version", PYTHONPATH=path)
    assert (done.returncode, done.stdout) == (0, f"vdfmu {__version__}\n"), done.stderr
    out = str(tmp_path / "out")
    done = vdfmu("run", "planar_tracking", "--stop", "0.001", "--backend", "python", "--out", out,
                 "--pictures", "png", PYTHONPATH=path)  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.startswith(f"error: the Python package {module} is not installed. ")
    first, *rest = done.stderr.splitlines()
    assert first.endswith(f"-m pip install {module}")
    assert all(line.startswith("The rows so far are in ") for line in rest)


@pytest.mark.few(2)
@pytest.mark.parametrize("package", [name for name in NEEDED if name not in ("click", "rich")])
def test_help_needs_only_what_draws_it(package: str, tmp_path: Path) -> None:
    done = vdfmu("run", "--help", PYTHONPATH=without(package, tmp_path))
    assert done.returncode == 0, done.stderr
    assert all(name in done.stdout for name in ALGORITHMS)


def test_a_package_that_does_not_load_says_why_and_a_summary_is_json_whatever_its_numbers(tmp_path: Path) -> None:
    (tmp_path / "numpy.py").write_text("raise ImportError('libgone.so: no such file', name='numpy')\n")
    done = vdfmu("robot", "list", PYTHONPATH=os.pathsep.join([str(tmp_path), str(ROOT)]))
    assert done.returncode == 1
    assert done.stderr.startswith("error: the Python package numpy cannot be imported: libgone.so: no such file. ")
    assert "Traceback" not in done.stderr
    text = to_json({"a": math.nan, "b": [math.inf, (-math.inf, 1.5)], "c": {"d": None, "e": True, "f": "é"}})

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is not JSON")

    read = json.loads(text, parse_constant=refuse)
    assert read == {"a": "nan", "b": ["inf", ["-inf", 1.5]], "c": {"d": None, "e": True, "f": "é"}}
