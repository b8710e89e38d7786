"""All that is public is as it is recorded in ``promise.txt``, and files of the first version are read."""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path

import pytest

import vdfmu
from tests import promise
from tests.promise import CHANGELOG, EARLIER, WAY_OUT, changes, name_of, not_named, sections
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.study.report.shown_run import read_run


def test_nothing_public_changes_unseen():
    gone, new = changes()
    lines = [*(f"- {line}" for line in gone), *(f"+ {line}" for line in new)]
    assert not lines, "\n".join([*lines, WAY_OUT])


def test_the_changelog_names_what_changed_since_the_last_release():
    versions = sections(CHANGELOG.read_text(encoding="utf-8"))
    released = [heading for heading in versions if "unreleased" not in heading.lower()]
    for heading in released:  # each has its record: `cp tests/promise.txt tests/earlier/0.2`
        assert record_of(heading).exists(), heading
    if released:
        gone, new = changes(record_of(released[0]))
        since = "".join(text for heading, text in versions.items() if heading not in released)
        assert not not_named([*gone, *new], since), WAY_OUT


def record_of(heading):
    """Return the record of the release with a heading, ``[0.2.0] - 2027-01-31``; a patch has that of its minor."""
    number = re.match(r"\[(\d+\.\d+)", heading)
    return EARLIER / number[1] / "promise.txt"


@pytest.mark.parametrize(("line", "name"), [
    ("Python: vdfmu.sweep vary: Sequence[str] = ()", "vary"),
    ("Python: vdfmu.Results.compare()", "compare"),
    ("Python: vdfmu.simulate() -> Results", "simulate"),
    ("commands: vdfmu sweep run --seed int = 0", "--seed"),
    ("commands: vdfmu sweep", "sweep"),
    ("exit codes: 2 wrong usage or input", "2"),
    ("files of a run: figure_10.pdf", "figure_10.pdf"),
    ("keys of summary.json: pace: table of speed, rows", "pace"),
    ("keys of robot files: joints[].drive.I_m: number, needed", "I_m"),
    ("variables of units, and columns of results: plant.M_e[6,6]: input Real [kg, kg.m, kg.m2]", "M_e"),
    ("entry points: vdfmu.units: a class of a unit", "vdfmu.units"),
])  # fmt: skip
def test_a_change_is_named_by_its_word_in_code(line, name):
    assert name_of(line) == name
    assert not_named([line], f"- `vdfmu x {name}` is new.") == []
    for other in ("", name, f"`{name}_more`", f"`--{name}`"):
        assert not_named([line], f"- {other} is new.") == [line]


def test_a_change_is_recorded_once_the_changelog_names_it(monkeypatch, tmp_path, capsys):
    now = promise.promised()
    place = now.index("# scenarios")
    monkeypatch.setattr(promise, "promised", lambda: [*now[: place + 1], "new_scenario", *now[place + 1 :]])
    monkeypatch.setattr(promise, "RECORD", record := tmp_path / "promise.txt")
    monkeypatch.setattr(promise, "CHANGELOG", changelog := tmp_path / "CHANGELOG.md")
    monkeypatch.setattr(sys, "argv", ["promise", "--write"])
    record.write_text("\n".join(now), encoding="utf-8")
    changelog.write_text("# Changelog\n\n## [0.3.0] - unreleased\n\n- Better.\n\n## [0.2.0]\n\n- `new_scenario`\n")
    with pytest.raises(SystemExit, match="does not name `new_scenario`"):
        promise.main()
    assert capsys.readouterr().out == "+ scenarios: new_scenario\n" and "new_scenario" not in record.read_text()
    changelog.write_text("# Changelog\n\n## [0.3.0] - unreleased\n\n- A scenario `new_scenario`.\n")
    promise.main()
    assert "\nnew_scenario\n" in record.read_text()


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
