"""The words of the command line: one for each thing, groups of commands, one kind of error."""

import json
import re
import shlex
from pathlib import Path

import pytest

from tests.warm import command
from vdfmu.base.option import Option
from vdfmu.cli.app import FunctionCommand
from vdfmu.cli.commands import COMMANDS, app
from vdfmu.cli.options import parameter, rows_by_task
from vdfmu.engine.run import simulate


def commands(name="", node=None):
    node = node or app
    inner = getattr(node, "commands", {})
    if not inner:
        yield name, node
    for word, below in inner.items():
        yield from commands(f"{name} {word}".strip(), below)


ROOT = Path(__file__).resolve().parents[2]

ALL = dict(commands())


def options(node):
    return {word: option for option in node.params if option.param_type_name == "option" for word in option.opts}


def test_every_command_that_writes_takes_out_and_its_letter():
    writes = {name for name, node in ALL.items() if "--out" in options(node)}
    assert {"run", "report", "ssp", "build", "unit new"} <= writes
    assert all(options(ALL[name])["-o"] is options(ALL[name])["--out"] for name in writes)


def test_every_option_has_help_and_values_that_there_are_can_be_completed():
    for name, node in ALL.items():
        for word, option in options(node).items():
            assert option.help, (name, word)
    for name, word, values in (
        ("run", "--algorithm", "gauss-seidel|jacobi|extrapolated|iterative"),
        ("run", "--backend", "python|native"),
        ("run", "--fmi", "2.0|3.0"),
        ("ssp", "--ssp", "1.0|2.0"),
    ):
        assert options(ALL[name])[word].metavar == values


@pytest.mark.few(4)
@pytest.mark.parametrize(("words", "said"), [
    ("sweep tracking --varry x=1", "No such option"),
    ("run --mastre jacobi", "No such option"),
    ("rum", "No such command 'rum'."),
    ("scenario show tracking reach", "Got unexpected extra argument (reach). See"),
    ("run --step fast", "Invalid value for '--step'"),
    ("judge x.ssp --step nan", "Invalid value for '--step': expected a number, got nan."),
    ("run --set", "Option '--set' requires an argument. See 'vdfmu run --help'."),
])  # fmt: skip
def test_wrong_words_are_errors_of_one_kind(tmp_path, words, said):
    done = command(*words.split(), cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"error: {said}")
    assert len(done.stderr.splitlines()) == 1
    assert "--help'." in done.stderr


def test_a_wrong_keyword_has_a_close_one():
    with pytest.raises(
        TypeError, match=r"simulate\(\) got .* keyword argument 'wait_limmit'; did you mean wait_limit\?"
    ):
        simulate("x.ssp", wait_limmit=1.0)


def test_the_bare_command_and_help_have_all_commands_in_groups(tmp_path):
    bare, done = command(cwd=tmp_path), command("--help", cwd=tmp_path)
    assert bare.stderr == done.stdout and bare.returncode == 2
    assert {name.split()[0] for name in ALL} <= set(re.findall(r"[a-z]+", done.stdout))
    assert all(f"\n{group}:\n" in done.stdout for group in COMMANDS)
    assert "\nCommands:\n" not in done.stdout
    groups = [command(name, "--help", cwd=tmp_path).stdout for name in ("sweep", "robot", "scenario", "unit")]
    assert max(len(line) for said in (done.stdout, *groups) for line in said.splitlines()) <= 80


@pytest.mark.parametrize("name", ALL)
def test_every_command_has_help_in_80_columns_a_line_an_option_with_an_example(name, capsys):
    with pytest.raises(SystemExit) as end:
        app([*name.split(), "--help"])
    said = capsys.readouterr().out
    assert end.value.code == 0
    assert max(map(len, said.splitlines())) <= 80
    most = {"run": 76, "sweep run": 62}  # they have the options of scenarios and of FMUs
    assert len(said.splitlines()) <= most.get(name, 60)
    for each in ALL[name].params:
        words = each.opts[-1] if each.opts[-1].startswith("--") else ""
        assert any(words in line and each.help.rstrip(".") in line for line in said.splitlines()), each.name
    example = said.partition("Example: ")[2].replace("\\\n", " ")
    assert shlex.split(example) == shlex.split(ALL[name].example) and example.startswith("vdfmu ")


def test_an_option_that_no_task_names_has_a_place_and_other_packages_are_replaced_on_request(tmp_path):
    added = FunctionCommand("added", callback=lambda: None, example="vdfmu added")
    added.params.append(parameter("remark", str | None, Option("Toy.")))
    assert [row[0] for row in rows_by_task(added.params)["Options"]][-1] == "--remark TEXT"
    (tmp_path / "mine.ssp").write_text("not of vdfmu")
    words = ("ssp", "planar_tracking", "--backend", "python", "-o", "mine.ssp")
    refused = command(*words, cwd=tmp_path)
    assert refused.returncode == 2
    assert "or replace it with --overwrite" in refused.stderr
    assert (tmp_path / "mine.ssp").read_text() == "not of vdfmu"
    done = command(*words, "--overwrite", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (0, "Written to mine.ssp\n")


def test_the_motion_of_a_shipped_scenario_by_its_name(tmp_path):
    done = command("scenario", "motion", "planar_tracking", "--json", cwd=tmp_path)
    joint = json.loads(done.stdout)["joints"][1]
    # (57): the peak of the speed is 2 (q_end - q_start) / T, at T/2, which is a row; printed with 16 digits
    assert joint["speed"] == pytest.approx(2.0 * (joint["to"] - joint["from"]) / 2.0, rel=1e-12)


LINES = re.findall(r"`vdfmu ([^`]+)`", (ROOT / "docs/index.md").read_text(encoding="utf-8"))


@pytest.mark.parametrize("line", LINES)
def test_the_start_page_has_commands_that_there_are(line):
    node, words, name = app, shlex.split(line), "vdfmu"
    while inner := getattr(node, "commands", {}):
        name = words.pop(0)
        if name not in inner and name in ("export", "identify", "import", "linear", "tune"):
            pytest.skip("a command of an extra that is not here")
        node = inner[name]
    node.make_context(name, words)  # raises for a word that the command does not take
