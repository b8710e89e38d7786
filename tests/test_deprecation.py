"""What is deprecated works on and says what to write instead: each kind of word, by a row of `DEPRECATED`."""

from __future__ import annotations

import logging
import warnings

import pytest

import vdfmu
import vdfmu.motion
import vdfmu.plugin
import vdfmu.unit
from vdfmu.base import words
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.base.progress import warn_once
from vdfmu.base.toml_file import locate
from vdfmu.base.words import takes_old_words
from vdfmu.cli.app import reset_verbosity
from vdfmu.cli.commands import app
from vdfmu.system.scenario.values import override


@pytest.fixture
def deprecated(monkeypatch):
    """Return the table of deprecated words, for new rows."""
    warn_once.cache_clear()
    monkeypatch.setattr(words, "DEPRECATED", rows := {})
    yield rows
    reset_verbosity()


def test_a_parameter_of_a_function_with_options(deprecated):
    deprecated["sweep"] = {"number": "points"}
    with pytest.warns(DeprecationWarning, match=r"sweep\(\): number is deprecated; write points") as found:
        with pytest.raises(vdfmu.VdfmuError, match="points"):
            vdfmu.sweep("planar_tracking", vary=["controller.K_p=1"], number=-3)
    assert found[0].filename == __file__


def test_a_parameter_of_another_function(deprecated):
    deprecated["twice"] = {"amount": "number"}

    @takes_old_words
    def twice(number: float) -> float:
        return 2 * number

    with pytest.warns(DeprecationWarning, match=r"twice\(\): amount is deprecated; write number") as found:
        assert twice(amount=2) == 4
    assert found[0].filename == __file__
    with warnings.catch_warnings(action="error"):
        assert twice(2) == twice(number=2) == 4


def test_a_name_of_the_api(deprecated):
    deprecated["vdfmu"] = {"load_arm": "load_robot"}
    with pytest.warns(DeprecationWarning, match=r"vdfmu\.load_arm is deprecated; write load_robot") as found:
        assert vdfmu.load_arm is vdfmu.load_robot
    assert found[0].filename == __file__
    with pytest.raises(AttributeError, match="load_hand"):
        vdfmu.load_hand  # noqa: B018


@pytest.mark.parametrize(
    ("module", "name"), [(vdfmu.unit, "Unit"), (vdfmu.motion, "load_motion"), (vdfmu.plugin, "Signal")]
)
def test_a_name_of_a_module_of_the_api(deprecated, module, name):
    deprecated[module.__name__] = {"OldName": name}
    with pytest.warns(DeprecationWarning, match=rf"{module.__name__}\.OldName is deprecated; write {name}") as found:
        assert module.OldName is getattr(module, name)
    assert found[0].filename == __file__
    with pytest.raises(AttributeError, match=f"module '{module.__name__}' has no attribute 'Nothing'"):
        module.Nothing  # noqa: B018


@pytest.mark.parametrize("quiet", [[], ["--quiet"]])
def test_a_command_and_an_option(deprecated, capsys, quiet):
    deprecated["robot"], deprecated["robot list"] = {"names": "list"}, {"as_json": "json"}
    with pytest.raises(SystemExit) as left:
        app(["robot", "names", "--as-json", *quiet])
    said = capsys.readouterr()
    assert left.value.code == 0 and '"planar_2dof": ' in said.out
    notes = ["note: names is deprecated; write list. It goes with the next major version.",
             "note: --as-json is deprecated; write --json. It goes with the next major version."]  # fmt: skip
    assert said.err.splitlines() == ([] if quiet else notes)


def test_an_option_with_its_value_behind_a_sign(deprecated, capsys):
    deprecated["modes"] = {"where": "pose"}
    with pytest.raises(UsageError, match="--pose nowhere: expected numbers"):
        app(["modes", "planar_2dof", "--where=nowhere"])
    assert capsys.readouterr().err.startswith("note: --where is deprecated; write --pose.")


def test_keys_of_files(deprecated, tmp_path, caplog):
    text = locate("planar_2dof", "robots").read_text(encoding="utf-8")
    file = tmp_path / "arm.toml"
    file.write_text(text.replace("gravity =", "weight =").replace("mass", "weight"), encoding="utf-8")
    deprecated["robots"] = {"weight": "gravity", "joints.link.weight": "joints.link.mass"}
    with caplog.at_level(logging.WARNING, "vdfmu"):
        robot = vdfmu.load_robot(file)
    assert (robot.gravity == vdfmu.load_robot("planar_2dof").gravity).all()
    assert f"{file}: joints.link.weight is deprecated; write joints.link.mass." in caplog.text
    file.write_text(f"weight = 3\n{text}", encoding="utf-8")
    with pytest.raises(ModelError, match="weight: expected a known key"):  # as the new one is there too
        vdfmu.load_robot(file)


def test_variables_of_a_unit_in_settings(deprecated, caplog):
    deprecated["PDController"] = {"stiffness": "K_p"}
    with caplog.at_level(logging.WARNING, "vdfmu"):
        found = override(vdfmu.load_scenario("planar_tracking"), {"controller.stiffness[1]": 30})
    assert found == {"controller": {"K_p[1]": 30}}
    assert "controller.stiffness[1]: stiffness is deprecated; write K_p." in caplog.text
