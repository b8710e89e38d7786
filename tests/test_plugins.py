"""A package adds a unit, a robot, a reader of logs, a format and a master algorithm: that of ``docs/plugins.md``."""

import json
import logging
from pathlib import Path

import numpy as np
import pytest

import vdfmu
from tests.added import command, installed, write_acme
from vdfmu.arm.robot import robot_names
from vdfmu.arm.units import find_unit, known_units
from vdfmu.base.errors import UsageError
from vdfmu.base.plugins import Plugins, PluginTable
from vdfmu.engine.results.folder import known_formats
from vdfmu.engine.results.formats import FORMATS


@pytest.fixture(scope="module")
def acme(tmp_path_factory):
    return write_acme(tmp_path_factory.mktemp("acme"))


@pytest.mark.heavy
def test_each_works_on_the_command_line(acme, tmp_path):
    units, robots = (command(tmp_path, acme, *words) for words in (("unit", "list"), ("robot", "list")))
    assert "plain_pd" in units.stdout and "Feedback of the motors without limits" in units.stdout
    assert "acme_2" in robots.stdout
    words = (
        "run planar_tracking --robot acme_2 --unit controller=plain_pd --algorithm halving --format csv,npz --stop 0.1"
    )
    done = command(tmp_path, acme, *words.split(), "--no-reference")
    assert done.returncode == 0, done.stderr
    out = tmp_path / "results" / "planar_tracking"
    assert "results.npz" in done.stdout and (out / "results.csv").exists()
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["algorithm"], summary["robot"]) == ("halving", "acme_2")
    assert "results.npz" in summary["files"]
    (out / "results.csv").unlink()
    refused = command(tmp_path, acme, "report", str(out))  # the package alone reads this format
    assert (refused.returncode, "--trust runs it" in refused.stderr) == (2, True)
    assert command(tmp_path, acme, "report", str(out), "--trust").returncode == 0
    # the next run replaces it
    again = command(tmp_path, acme, "run", "planar_tracking", "--stop", "0.1", "--no-reference")
    assert again.returncode == 0, again.stderr
    assert not (out / "results.npz").exists()


@pytest.mark.heavy
def test_an_added_unit_is_built_and_one_that_does_not_work_is_named(acme, tmp_path):
    done = command(tmp_path, acme, "build", "plain_pd", "--robot", "acme_2", "--backend", "python")
    assert done.returncode == 0 and list((tmp_path / "fmus").glob("*.fmu")), done.stderr
    installed(tmp_path / "broken", "broken", {"vdfmu.units": {"gone": "no_such_module:it"}})
    done = command(tmp_path, tmp_path / "broken", "build", "gone")
    assert "unit 'gone' of the package broken 1.0 cannot be used: expected a class of a unit" in done.stderr
    done = command(tmp_path, acme, "build", "none_such")
    assert "no scenario 'none_such'" in done.stderr and done.returncode == 2


@pytest.mark.heavy
def test_names_are_found_in_python(acme, added):
    added(acme)
    assert find_unit("plain_pd").__name__ == "PlainPD"
    assert "plain_pd" in known_units()
    assert vdfmu.load_robot("acme_2").name == "acme_2"
    assert "acme_2" in robot_names()


def broken(tmp_path: Path, added) -> Plugins:
    """Install packages that do not work; return their group."""
    points = {
        "good": "math:pi", "shipped": "math:pi", "twice": "math:pi", "gone": "no_such_module:it", "wrong": "math:sin",
    }  # fmt: skip
    installed(tmp_path / "a", "one", {"vdfmu.toys": points})
    installed(tmp_path / "b", "two", {"vdfmu.toys": {"twice": "math:e"}})
    for name in ("a", "b"):
        added(tmp_path / name)
    return Plugins("toys", "toy", "a number", lambda toy: isinstance(toy, float))


def test_a_package_that_does_not_work_is_named_and_the_others_are_there(added, tmp_path, caplog):
    caplog.set_level(logging.WARNING, "vdfmu")  # a command before may have been quiet
    toys = PluginTable(broken(tmp_path, added), {".shipped": 1.0}, prefix=".")
    assert (toys[".good"], toys[".shipped"], ".none" in toys, "good" in toys) == (np.pi, 1.0, False, False)
    for name, said in (
        (
            ".gone",
            r"toy 'gone' of the package one 1\.0 cannot be used: expected a number, got no_such_module:it: Module",
        ),
        (".wrong", r"toy 'wrong' of the package one 1\.0 .* got math:sin, which is builtin_function_or_method"),
        (".twice", r"expected one package that adds it, got the package two 1\.0 and the package one 1\.0"),
    ):
        with pytest.raises(UsageError, match=said):
            toys[name]
    assert toys.names(".shipped") == [".shipped", ".good"]
    assert not caplog.text
    assert toys.names() == [".shipped", ".good"]
    for name in ("gone", "wrong", "twice", "shipped"):
        assert f"toy '{name}'" in caplog.text
    assert "vdfmu itself has one of this name" in caplog.text
    assert toys[".shipped"] == 1.0


@pytest.mark.heavy
def test_commands_that_use_no_added_format_load_none(added, tmp_path):
    installed(tmp_path, "broken", {"vdfmu.formats": {"npz": "no_such_module:it"}})
    for words in (("--help",), ("run", "--help"), ("robot", "list")):
        done = command(tmp_path, tmp_path, *words)
        assert done.returncode == 0, done.stderr
        assert "ignored" not in done.stdout + done.stderr
    done = command(tmp_path, tmp_path, "run", "planar_tracking", "--format", "none_such")
    assert "ignored: format of results 'npz' of the package broken 1.0" in done.stderr and done.returncode == 2
    done = command(tmp_path, tmp_path, "run", "planar_tracking", "--format", "npz")
    assert "error: format of results 'npz' of the package broken 1.0 cannot be used" in done.stderr


def test_an_added_format_is_known_by_its_name(acme, added):
    added(acme)
    try:
        known_formats(["csv", "npz"])
    finally:
        FORMATS.pop(".npz", None)  # for the tests after this one


def test_a_package_that_ends_python_is_named(added, tmp_path, caplog):
    caplog.set_level(logging.WARNING, "vdfmu")
    (tmp_path / "ends_python.py").write_text("import sys\nsys.exit(5)\n")
    installed(tmp_path, "ends", {"vdfmu.toys": {"ends": "ends_python:it"}})
    added(tmp_path)
    assert Plugins("toys", "toy", "a number", lambda toy: True).all(()) == {}
    assert (
        "toy 'ends' of the package ends 1.0 cannot be used: expected a number, got ends_python:it: SystemExit: 5"
        in (caplog.text)
    )
