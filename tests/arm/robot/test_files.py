"""Finding and reading files: names, paths, and files that are no TOML."""

import shutil

import numpy as np
import pytest

from vdfmu.arm.robot import load_robot, robot_names
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.base.files import data_path
from vdfmu.system.scenario import load_scenario, scenario_names
from vdfmu.system.scenario.values import group_value

SHIPPED = data_path("models") / "robots" / "planar_2dof.toml"


ROBOTS = (
    "iiwa_7dof kr300_6dof kr_6dof manipulator_6dof panda_7dof planar_2dof redundant_7dof scara_4dof slider_3dof "
    "snake_24dof ur5e_6dof"
).split()
SCENARIOS = (
    "estimation kr300 planar_tracking screw slider_tracking tracking tracking_split two_arms two_joint "
    "two_joint_table5 wall"
).split()


def test_shipped_names():
    assert (robot_names(), scenario_names()) == (ROBOTS, SCENARIOS)


@pytest.mark.parametrize(
    ("load", "name"), [*((load_robot, name) for name in ROBOTS), *((load_scenario, name) for name in SCENARIOS)]
)
def test_a_shipped_file_has_its_own_name_in_it(load, name):
    assert load(name).name == name


def test_unknown_name_lists_the_shipped_ones_and_a_missing_file_is_named(tmp_path):
    with pytest.raises(
        UsageError, match=r"no robot \'planar\': .* There are: iiwa_7dof, kr300_6dof, kr_6dof, manipulator_6dof"
    ):
        load_robot("planar")
    with pytest.raises(UsageError, match=r'no scenario \'trackin\': .* Did you mean "tracking"\?'):
        load_scenario("trackin")
    with pytest.raises(ModelError, match=r"nowhere\.toml: expected a TOML file, got nothing: it does not exist"):
        load_robot(tmp_path / "nowhere.toml")
    with pytest.raises(ModelError, match=r"nowhere\.toml: expected a TOML file, got nothing"):
        load_scenario("nowhere.toml")
    with pytest.raises(ModelError, match="expected a TOML file, got a directory"):
        load_robot(tmp_path)


def test_file_of_that_name_wins_over_the_shipped_one(tmp_path, monkeypatch):
    text = SHIPPED.read_text(encoding="utf-8").replace('name = "planar_2dof"', 'name = "mine"')
    (tmp_path / "planar_2dof").write_text(text, encoding="utf-8")
    assert load_robot("planar_2dof").name == "planar_2dof"
    monkeypatch.chdir(tmp_path)
    assert load_robot("planar_2dof").name == "mine"


DEEP = r"TOML, got .* nested too deeply"


@pytest.mark.parametrize(("content", "words"), [
    ('name = "Mühle"'.encode("latin-1"), r"UTF-8 text, got byte 0xfc at offset 9\. Save"),
    (b'name = "x"\ngravity = [0, 0, 9.81\nfriction = "lumped"\n', "TOML, got a syntax error: .*line 3"),
    (b"gravity = " + b"[" * 2000, DEEP),
    (b"gravity = " + b"[" * 200 + b"]" * 200, DEEP),
    (b"gravity = [{" + b"a." * 5000 + b"a = 1}]", DEEP),
    (b"name = " + b"9" * 5000, ".*digits"),
    (b"name = 0x" + b"f" * 5000, ".* got a number of thousands of digits"),
], ids=["latin", "syntax", "brackets", "lists", "dots", "digits", "hexadecimal"])  # fmt: skip
def test_a_file_that_is_no_toml_is_refused(tmp_path, content, words):
    (tmp_path / "broken.toml").write_bytes(content)
    with pytest.raises(ModelError, match=rf"broken\.toml: (name: )?expected {words}"):
        load_robot(tmp_path / "broken.toml")


def test_byte_order_mark_and_crlf_are_read_and_the_robot_path_starts_at_the_scenario_file(
    tmp_path, write, scenario_data
):
    path = tmp_path / "windows.toml"
    text = SHIPPED.read_text(encoding="utf-8").replace("\n", "\r\n")
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert load_robot(path).n == 2
    (tmp_path / "robots").mkdir()
    shutil.copy(SHIPPED, tmp_path / "robots" / "arm.toml")
    scenario_data["robot"] = "robots/arm.toml"
    scenario = load_scenario(write("own.toml", scenario_data))
    assert scenario.robot.name == "planar_2dof"


def test_problems_of_scenario_and_robot_together(write, robot_data, scenario_data):
    robot_data["joints"][0]["link"]["mass"] = -1
    write("arm.toml", robot_data)
    scenario_data.update(robot="arm.toml", step=-1)
    with pytest.raises(ModelError) as caught:
        load_scenario(write("own.toml", scenario_data))
    assert len(caught.value.problems) == 2
    assert "own.toml: step: expected a finite number > 0 in s, got -1" in str(caught.value)
    assert "arm.toml: joints[1].link.mass: expected" in str(caught.value)
    scenario_data["robot"] = "planer_2dof"
    with pytest.raises(
        ModelError, match=r'own\.toml: robot: no robot .* Did you mean "planar_2dof"\? There are: iiwa_7dof'
    ):
        load_scenario(write("own.toml", scenario_data))


def test_another_robot_drops_the_paper_and_one_of_other_size_is_reported_for_every_list(write, scenario_data):
    scenario_data["paper"] = {"source": "x", "rms_position_error_deg": [0.1, 0.2]}
    path = write("own.toml", scenario_data)
    assert load_scenario(path, "planar_2dof").paper["rms_position_error_deg"] == [0.1, 0.2]
    heavier = load_robot("planar_2dof").with_parameters(mass=[3.0, 2.0])
    np.testing.assert_array_equal(load_scenario(path, heavier).robot.mass, [3.0, 2.0])
    scenario_data["trajectory"].update(q_start=0.0, q_end=0.1)
    scenario_data["controller"].update(K_p=100.0, K_v=1.0)
    path = write("all.toml", scenario_data)
    scenario = load_scenario(path, "slider_3dof")
    assert scenario.paper == {}
    assert group_value(scenario, "controller.K_p").shape == (3,)
    with pytest.raises(ModelError) as caught:
        load_scenario("tracking", "planar_2dof")
    keys = ("trajectory.q_end", "controller.K_p", "controller.K_v")
    assert len(caught.value.problems) == len(keys)
    for key, line in zip(keys, caught.value.problems, strict=True):
        name = key.partition(".")[2]
        assert f"{key}: expected one value, or 2 for {name}[1] to {name}[2], got 6." in line


@pytest.mark.parametrize("name", ["robot.toml", "scenario.toml", "system.toml"])
def test_a_file_says_its_format_and_one_of_a_later_version_is_refused(name, tmp_path):
    for file, source in (
        ("robot.toml", SHIPPED),
        ("scenario.toml", data_path("models") / "scenarios" / "planar_tracking.toml"),
        ("system.toml", data_path("ssp") / "system.toml"),
    ):
        text = source.read_text(encoding="utf-8")
        text = text.replace('robot = "planar_2dof"', 'robot = "./robot.toml"\nsystem = "./system.toml"')
        (tmp_path / file).write_text(text, encoding="utf-8")
    scenario, file = tmp_path / "scenario.toml", tmp_path / name
    text = file.read_text(encoding="utf-8")
    for format in ("", "format = 1\n"):
        file.write_text(f"{format}{text}", encoding="utf-8")
        loaded = load_scenario(scenario)
        assert (loaded.robot.n, loaded.system.path) == (2, tmp_path / "system.toml")
    for wrong, fix in (("2", "A version later than .* wrote it: update vdfmu"), ('"1"', "Leave the key out")):
        file.write_text(f"format = {wrong}\nsecrets = 1\n{text}", encoding="utf-8")
        with pytest.raises(ModelError, match=f"{name}: format: expected 1, got .*{fix}") as refused:
            load_scenario(scenario)
        assert "secrets" not in str(refused.value)  # other keys are not for this version
