"""System files that cannot be used are refused in words, and scenarios of them."""

import pytest

from vdfmu.base.errors import ModelError
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.check import model_notes
from vdfmu.system.scenario.scenario_file import load_system

HEAD = 'name = "x"\nsystem = "mine.toml"\nrobot = "planar_2dof"\nstop = 0.01\nstep = 0.001\n'
NAME = "expected a name of letters, digits, spaces and _ [+] -, a letter, digit or _ first"


@pytest.mark.parametrize(("text", "said"), [
    ("[shared]\na = 3", r"shared\.a: expected a table such as .*, got 3\. Name a group of each component"),
    ("[shared.a]\nplant = 3", r"shared\.a: expected a table such as .*, got a table"),
    ("[shared.a]", r"shared\.a: expected a table such as .*, got a table"),
    ('[shared.a]\nplnt = "q_0"', r"shared\.a: expected names of \[components\], got plnt. Did you mean .plant"),
    ('[shared."../a"]\nplant = "q_0"', rf"shared\.\.\./a: {NAME}, got .\.\./a"),
    ('[shared.robot]\nplant = "q_0"', r"shared\.robot: expected another name, got robot\. It is in the robot's"),
    ("shared = [1]", r"shared: expected a table, got \[1\]\.$"),
    ("components = 3", "components: expected a table, got 3"),
    ('[units]\nwall = "wall"', r"toml: units: expected \[components\], got \[units\]\. Rename the table\.$"),
    ('connections = "x"', "connections: expected a table, got .x"),
    ('[components]\n"../x" = "wall"', rf"components\.\.\./x: {NAME}, got .\.\./x"),
    ('[components]\n"a.b" = "wall"', rf"components\.a\.b: {NAME}, got .a\.b"),
    ('[components]\n"" = "wall"', rf"components\.: {NAME}, got"),
    (
        "[components]\nplant = [0, 0, inf, 1]",
        "components.plant: expected corners .*, got .0, 0, inf, 1.. Or leave the box out",
    ),
    ("[components]\nplant = [false, false, true, true]", "components.plant: expected corners"),
    (f"[components]\nplant = [0, 0, 1{'0' * 400}, 1]", "components.plant: expected corners"),
])  # fmt: skip
def test_what_a_system_file_cannot_have_is_named(tmp_path, text, said):
    path = tmp_path / "mine.toml"
    path.write_text(f'extends = "system"\n{text}\n' if "[" in text[:1] else f'{text}\nextends = "system"\n')
    with pytest.raises(ModelError, match=said):
        load_system(path)


def test_files_that_extend_each_other_are_named(tmp_path):
    for name, other in (("a", "b"), ("b", "a")):
        (tmp_path / f"{name}.toml").write_text(f'extends = "{other}.toml"\n')
    with pytest.raises(ModelError, match=r"a\.toml: extends: the files extend each other\.$"):
        load_system(tmp_path / "a.toml")


@pytest.mark.parametrize(
    ("line", "said"),
    [('algorithm = ["jacobi"]', "algorithm: expected .gauss-seidel"), ("wall = 3", "wall: expected a table, got 3")],
)
def test_what_a_scenario_cannot_have_of_a_system_is_named(tmp_path, line, said):
    (tmp_path / "mine.toml").write_text('extends = "system"\n[components]\nwall = "wall"\n')
    (tmp_path / "x.toml").write_text(HEAD + line)
    with pytest.raises(ModelError, match=said):
        load_scenario(tmp_path / "x.toml")


def test_values_that_are_not_shared_and_cannot_be_set_are_noted(tmp_path):
    (tmp_path / "mine.toml").write_text(
        'extends = "system"\n[components]\nstop = "wall"\n[shared.mine]\nplant = "q_00"\ntrajectory = "q_end"\n'
    )
    (tmp_path / "x.toml").write_text(HEAD)
    assert model_notes(load_scenario(tmp_path / "x.toml")) == [
        "system: stop is a key of scenarios, which cannot set values of a component of this name.",
        "shared.mine: plant has no q_00, and shares nothing.",
    ]
