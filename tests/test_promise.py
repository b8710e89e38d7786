"""All that is public is as it is recorded in ``promise.txt``, and files of the first version are read."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

import vdfmu
from tests import promise
from tests.promise import WAY_OUT, changes
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.study.report.shown_run import read_run


def test_nothing_public_changes_unseen():
    gone, new = changes()
    lines = [*(f"- {line}" for line in gone), *(f"+ {line}" for line in new)]
    assert not lines, "\n".join([*lines, WAY_OUT])


def test_a_line_that_goes_from_one_part_is_seen_though_another_has_it(monkeypatch):
    lines = promise.promised()
    place = lines.index("description: string", lines.index("# keys of scenario files"))
    assert "description: string" in lines[:place]  # of robots
    monkeypatch.setattr(promise, "promised", lambda: [*lines[:place], *lines[place + 1 :]])
    assert "keys of scenario files: description: string" in promise.changes()[0]


def test_values_and_defaults_of_options_are_public():
    lines = promise.promised()
    assert {"vdfmu tune --combine mean|worst = mean", "vdfmu run --stop float", "vdfmu run SCENARIO = tracking"} <= {
        *lines
    }
    assert {"vdfmu sweep run --seed int = 0", "vdfmu run --set COMPONENT.VARIABLE=VALUE ..."} <= {*lines}


@pytest.fixture
def earlier(tmp_path):
    """Return a copy of the files that version 0.1 wrote and read, from before they had a key ``format``."""
    return shutil.copytree(Path(__file__).parent / "earlier" / "0.1", tmp_path / "0.1")


def test_files_of_the_first_version_are_read(earlier):
    scenario = vdfmu.load_scenario(earlier / "scenario.toml")
    assert (scenario.robot.n, scenario.system.path.name) == (2, "system.toml")
    run = read_run(earlier)
    # the stop time is 10 steps of the file
    assert (len(run.results), run.summary["vdfmu"], run.results.units["plant.q[1]"]) == (11, "0.1.0", "rad")


@pytest.mark.parametrize("name", ["robot.toml", "scenario.toml", "system.toml"])
def test_a_file_says_its_format_and_one_of_a_later_version_is_refused(earlier, name):
    file, text = earlier / name, (earlier / name).read_text()
    file.write_text(f"format = 1\n{text}")
    vdfmu.load_scenario(earlier / "scenario.toml")
    for wrong, way_out in (("2", "A later vdfmu than this .* wrote it: update vdfmu"), ('"1"', "Leave the key out")):
        file.write_text(f"format = {wrong}\nsecrets = 1\n{text}")
        with pytest.raises(ModelError, match=f"{name}: format: expected 1, got .*{way_out}") as found:
            vdfmu.load_scenario(earlier / "scenario.toml")
        assert "secrets" not in str(found.value)  # what else it holds is not for this version


def test_a_summary_of_a_later_version_is_refused(earlier):
    file = earlier / "summary.json"
    file.write_text(json.dumps({"format": 2, **json.loads(file.read_text())}))
    with pytest.raises(UsageError, match=r"summary.json: format: expected 1, got 2. A later vdfmu"):
        read_run(earlier)
