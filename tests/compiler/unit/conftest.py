"""The example units, built and run once as a user has them."""

import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from vdfmu.arm.units import find_unit
from vdfmu.cli.commands import app
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.package.write import build_parts, write_ssp
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import system_values


def command(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


EXAMPLES = Path(__file__).resolve().parents[3] / "examples" / "units"


@pytest.fixture(scope="session")
def example():
    return lambda name: find_unit(EXAMPLES / f"{name}.py")


class System:
    """The scenario of the examples with its packages."""

    def __init__(self, folder):
        self.scenario = load_scenario(EXAMPLES / "scenario.toml")
        self.values = system_values(self.scenario)
        self.description = SystemDescription(self.scenario, self.values)
        fmus = build_parts(self.scenario, folder / "fmus", self.values)
        self.package = write_ssp(self.scenario, fmus, folder / "own_units.ssp", self.values)


@pytest.fixture(scope="session")
def system(tmp_path_factory, kernel_cache):
    return System(tmp_path_factory.mktemp("own_units"))


@pytest.fixture
def examples(tmp_path, monkeypatch):
    """Return the folder of a user with a copy of the examples, which is the current one. Their arm has a law."""
    pytest.importorskip("vdfmu.extras.laws")
    shutil.copytree(EXAMPLES, tmp_path / "units", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.chdir(tmp_path)
    return tmp_path / "units"
