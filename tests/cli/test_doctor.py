"""What ``vdfmu doctor`` says, with and without packages."""

import logging
import tomllib
from importlib.metadata import PackageNotFoundError
from pathlib import Path

from click.testing import CliRunner

from vdfmu.base.progress import warn_once
from vdfmu.cli import doctor, extras
from vdfmu.cli.commands import app
from vdfmu.compiler.fmu import build

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
OURS = {"test", "docs", "dev"}


def declared(_: str) -> list[str]:
    extras = PROJECT["optional-dependencies"]
    return [*PROJECT["dependencies"], *(f'{text}; extra == "{name}"' for name in extras for text in extras[name])]


def test_what_is_missing_is_said_with_its_price_and_the_way_to_it_for_every_extra(monkeypatch, tmp_path):
    assert set(doctor.WITHOUT) == set(PROJECT["optional-dependencies"]) - OURS
    monkeypatch.setenv("VDFMU_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(extras, "requires", declared)
    whole = CliRunner().invoke(app, ["doctor"])
    assert whole.exit_code == 0
    assert "Extra    sweep: pyarrow " in whole.output
    assert f"Cache    {tmp_path}" in whole.output

    def version(name: str) -> str:
        if name in ("pyarrow", "casadi"):
            raise PackageNotFoundError(name)
        return "1.0"

    monkeypatch.setattr(extras, "version", version)
    less = CliRunner().invoke(app, ["doctor"])
    assert less.exit_code == 1
    assert "Extra    parquet: pyarrow>=16 not installed: results are CSV, three times the size. " in less.output
    assert "pip install 'vdfmu[sweep]'" in less.output
    assert "error: casadi>=3.7 not installed, without which nothing runs" in less.output


def test_the_shell_completes_names():
    def completed(words: str) -> list[str]:
        variables = {"COMP_WORDS": words, "COMP_CWORD": str(len(words.split()) - 1), "_VDFMU_COMPLETE": "bash_complete"}
        offered = CliRunner().invoke(app, [], env=variables).output.split()
        return [word.removeprefix("plain,") for word in offered]

    assert completed("vdfmu run two_joint") == ["two_joint", "two_joint_table5"]
    assert completed("vdfmu run tracking --robot planar") == ["planar_2dof"]
    assert completed("vdfmu run tracking --algorithm j") == ["jacobi"]
    assert completed("vdfmu run tracking --alg") == ["--algorithm"]
    assert completed("vdfmu doc") == ["doctor"]
    assert completed("vdfmu run ./tr") == ["file,./tr"]  # the shell lists files
    assert "_VDFMU_COMPLETE=bash_complete" in CliRunner().invoke(app, ["--completion", "bash"]).output


def test_a_run_without_a_compiler_says_first_what_that_costs(monkeypatch, caplog):
    caplog.set_level(logging.WARNING, "vdfmu")  # a command before may have been quiet
    monkeypatch.setattr(build, "native_available", lambda: False)
    warn_once.cache_clear()
    assert [build.choose_backend(None), build.choose_backend(None), build.choose_backend("python")] == ["python"] * 3
    (said,) = (record.getMessage() for record in caplog.records)
    assert said.startswith("FMUs are in Python: a run takes about 20 times as long")
    assert "pip install vdfmu[native]" in said
