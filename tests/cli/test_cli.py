"""The command line as a user meets it, in a separate process."""

import os
import re
import subprocess
import sys
import tomllib
import zipfile

import fmpy
import pytest

from tests.conftest import TYPICAL
from tests.warm import command


def vdfmu(*arguments, cwd, **options):
    return command(*arguments, cwd=cwd, **options)


@pytest.mark.heavy
def test_build_efmus_of_a_scenario_and_of_a_unit_by_name(tmp_path):
    built = vdfmu("build", "planar_tracking", "--target", "efmi", "--out", "efmus", "--step", "0.0005", cwd=tmp_path)
    assert built.returncode == 0, built.stderr
    assert "plant: not for efmi: it has continuous states" in " ".join(built.stderr.split())
    assert sorted(p.name for p in (tmp_path / "efmus").iterdir()) == [
        "Feedforward.fmu", "PDController.fmu", "Trajectory.fmu",
    ]  # fmt: skip
    with zipfile.ZipFile(tmp_path / "efmus" / "PDController.fmu") as archive:
        source = archive.read("eFMU/ProductionCode/PDController.c").decode()
        program = archive.read("eFMU/AlgorithmCode/PDController.alg").decode()
    assert "PDController_period = 0.0005;" in source
    assert "self.K_p := {1000.0, 1000.0}" not in program  # but the scenario's
    single = vdfmu(
        "build", "notch_filter", "--robot", "planar_2dof", "--set", "f=30", "--target", "efmi", "--precision",
        "float32", "--out", "one", cwd=tmp_path,
    )  # fmt: skip
    assert single.returncode == 0, single.stderr
    with zipfile.ZipFile(tmp_path / "one" / "NotchFilter.fmu") as archive:
        assert b"30.0f, 30.0f" in archive.read("eFMU/ProductionCode/NotchFilter.c")


SYSTEM = ["Feedforward", "PDController", "Plant", "Trajectory"]
LOADED = ("--robot", "planar_2dof", "--set")


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("words", "files", "starts"),
    [
        (("Plant", *LOADED, "payload_mass=2", "--set", "gravity[1]=3"), ["Plant"], ("2.0", "3.0")),
        (("plant", "--robot", "planar_2dof"), ["Plant"], ("0.0", "0.0")),
        (("planar_tracking", "--folded"), SYSTEM, (None, None)),
        (("planar_tracking", "--set", "plant.payload_mass=2", "--set", "plant.gravity[1]=3"), SYSTEM, ("2.0", "3.0")),
        (("planar_tracking",), SYSTEM, ("0.0", "0.0")),
    ],
)  # fmt: skip
def test_build_does_what_its_words_say(tmp_path, words, files, starts):
    done = vdfmu("build", *words, "--backend", "python", "--out", "fmus", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert sorted(path.stem for path in (tmp_path / "fmus").iterdir()) == files
    variables = fmpy.read_model_description(str(tmp_path / "fmus" / "Plant.fmu")).modelVariables
    of_plant = {v.name: v.start for v in variables}
    assert (of_plant.get("payload_mass"), of_plant.get("gravity[1]")) == starts
    with zipfile.ZipFile(tmp_path / "fmus" / "Plant.fmu") as archive:
        (folded,) = re.findall("<Folded xmlns=.*>(.*)</Folded>", archive.read("modelDescription.xml").decode())
    assert ("gravity[1]" in folded.split()) == (starts[1] is None)
    assert {"rotation", "tool_rotation", "offset[1,1]"} < {*folded.split()} - of_plant.keys()


def test_a_unit_is_built_before_a_scenario_of_its_name(tmp_path):
    done = vdfmu("build", "wall", "--backend", "python", "--out", "fmus", cwd=tmp_path)
    assert [path.name for path in (tmp_path / "fmus").iterdir()] == ["Wall.fmu"], done.stderr
    assert "the unit wall. For the scenario: 'vdfmu scenario show wall > my.toml'" in " ".join(done.stderr.split())


@pytest.mark.heavy
@pytest.mark.parametrize("name", TYPICAL)
def test_a_robot_is_shown_whole_in_80_columns(tmp_path, name):
    """No word is cut: every number, heading and word of a source is there as it is in a wide terminal."""
    narrow, wide = (
        vdfmu("robot", "show", name, cwd=tmp_path, env={**os.environ, "COLUMNS": columns}).stdout
        for columns in ("80", "400")
    )
    assert max(len(line) for line in narrow.splitlines()) <= 80
    assert "…" not in narrow
    words = re.compile(r"[^\s┃│━╇┼─]+")
    assert sorted(words.findall(narrow)) == sorted(words.findall(wide))  # a heading may have more lines
    assert "theta_err_amplitude" in narrow


@pytest.mark.heavy
def test_a_scenario_is_shown_as_its_file(tmp_path):
    shown = vdfmu("scenario", "show", "tracking", cwd=tmp_path, env={**os.environ, "COLUMNS": "40"})
    assert tomllib.loads(shown.stdout)["name"] == "tracking"


@pytest.mark.few(9)
@pytest.mark.parametrize(("arguments", "words"), [
    (["run", "trackng"], "trackng"),
    (["run", "planar_tracking", "--set", "controller.K_p"], "expected COMPONENT.VARIABLE=VALUE"),
    (
        ["run", "planar_tracking", "--unit", "controller"],
        "--unit controller: expected COMPONENT=UNIT, such as controller=my_unit.py.",
    ),
    (["run", "planar_tracking", "--set", "controller.K_q=1"], "controller has no K_q."),
    (["run", "planar_tracking", "--algorithm", "euler"], "expected gauss-seidel, jacobi, extrapolated or iterative"),
    (["run", "planar_tracking", "--adaptive", "1e-6"], "use extrapolated or iterative"),
    (["run", "planar_tracking", "--step", "fast"], "Invalid value for '--step'"),
    (["run", "system.ssp"], "there is no such file"),
    (["run", "a.fmu", "b.fmu"], "a.fmu: must be NAME=FILE if there are several. Write a=a.fmu."),
    (["run", "a=a.fmu", "--connect", "a.y"], "--connect a.y: expected OUTPUT=INPUT, such as a.y=b.u."),
    (["run", "a.ssp", "--connect", "a.y=b.u"], "--connect is for a scenario or FMUs; a.ssp has its own connections."),
    (["run", "a.ssp", "--robot", "arm", "--no-reference"],
     "--robot is only for a scenario, got a.ssp. --reference/--no-reference is only for a scenario, got a.ssp."),
    (["run", "--start", "1"], "--start is only for FMUs, got the scenario tracking."),
    (["run", "planar_tracking", "two_joint"], "planar_tracking two_joint: expected one scenario, got 2."),
    (["run", "planar_tracking", "--connect", "plant.qq=controller.q"], 'got \'qq\'. Did you mean "q"?'),
    (["run", "planar_tracking", "--connect", "plnt.q=controller.q"], 'got \'plnt\'. Did you mean "plant"?'),
    (["check", "missing.fmu"], "there is no such file"),
    (["robot", "show", "robot.toml"], "robot.toml"),
])  # fmt: skip
def test_wrong_usage_ends_with_code_2_and_the_fix(tmp_path, arguments, words):
    done = vdfmu(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert words in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr


@pytest.mark.heavy
def test_the_cache_is_shown_and_cleared(tmp_path):
    environment = os.environ | {"VDFMU_CACHE_DIR": str(tmp_path / "cache"), "VDFMU_CACHE_MB": "300"}

    def output(*arguments):
        done = vdfmu(*arguments, cwd=tmp_path, env=environment)
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert "Entries  0\n" in output("doctor", "--cache")
    output("build", "planar_tracking", "--backend", "python")
    entries = [path for path in (tmp_path / "cache").rglob("*") if path.is_file()]
    size = f"{sum(path.stat().st_size for path in entries) / 2**20:.1f} MB"
    shown = output("doctor", "--cache")
    assert f"Cache    {tmp_path / 'cache'}\n" in shown and f"Entries  {len(entries)}\n" in shown
    assert entries and f"Size     {size}, at most 300 MB\n" in shown
    assert output("doctor", "--clear-cache") == f"Removed {len(entries)} entries, {size}.\n"
    assert "Entries  0\n" in output("doctor", "--cache")
    wrong = vdfmu("doctor", "--cache", cwd=tmp_path, env=environment | {"VDFMU_CACHE_MB": "much"})
    assert wrong.returncode == 2 and "VDFMU_CACHE_MB: expected" in wrong.stderr


def test_version(tmp_path):
    import vdfmu as package

    done = vdfmu("--version", cwd=tmp_path)
    assert (done.returncode, done.stdout.strip()) == (0, f"vdfmu {package.__version__}")


@pytest.mark.heavy
def test_a_temporary_folder_that_crashes_python_fmus_is_refused(tmp_path):
    folder = tmp_path / "j\u00fcrgen"
    folder.mkdir()
    arguments = ("run", "planar_tracking", "--stop", "0.01", "--no-reference")
    environment = {**os.environ, "TMPDIR": str(folder)}
    done = vdfmu(*arguments, "--backend", "python", cwd=tmp_path, env=environment)
    assert done.returncode == 1
    assert "Set TMPDIR to another folder." in " ".join(done.stderr.split())
    assert vdfmu(*arguments, "--backend", "native", cwd=tmp_path, env=environment).returncode == 0


@pytest.mark.heavy
@pytest.mark.parametrize("output", ["closed", "/dev/full"])
def test_findings_that_cannot_be_written_are_an_error(tmp_path, output):
    (tmp_path / "text.fmu").write_text("no zip")
    redirection = ">&-" if output == "closed" else f"> {output}"
    done = subprocess.run(
        ["/bin/sh", "-c", f'"$0" -m vdfmu.cli check --json text.fmu {redirection}', sys.executable],
        cwd=tmp_path, stderr=subprocess.PIPE, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "the findings cannot be written: " in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="the platform has no full device")
@pytest.mark.parametrize("words", [["robot", "show", "nosuch"], ["run", "--bogus"]])
def test_an_error_that_cannot_be_written_has_its_exit_code(tmp_path, words):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "vdfmu.cli", *words], cwd=tmp_path, stderr=full, timeout=300, check=False
        )
    assert done.returncode == 2
