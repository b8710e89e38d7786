"""An FMU and the vdfmu that runs it belong together: anything else is refused with what to do."""

import json
import shutil
from pathlib import Path
from typing import Any

import fmpy
import pytest

from tests.compiler.native.binding import Instance, Model
from vdfmu import __version__
from vdfmu.arm.fmus import build_fmus


def change(folder: Path, **values: Any) -> Path:
    path = folder / "resources" / "vdfmu.json"
    data = {**json.loads(path.read_text(encoding="utf-8")), **values}
    path.write_text(json.dumps({k: v for k, v in data.items() if v is not None}), encoding="utf-8")
    return folder


def test_an_fmu_of_another_version_or_of_other_sources_is_refused_before_its_content_is_read(copy_of, words_of_refusal):
    folder = change(copy_of("plant"), version="9.9.9")
    words = words_of_refusal(folder)
    assert words.endswith(
        f"unit: instantiate failed: Plant.fmu was built with vdfmu 9.9.9, but this Python has vdfmu {__version__}. "
        "Build the FMU again with `vdfmu build`, or install vdfmu 9.9.9."
    )
    folder = change(folder, robot={"arms": 2}, start_values=None, tool=None)
    assert "was built with vdfmu 9.9.9" in words_of_refusal(folder)
    words = words_of_refusal(change(copy_of("controller"), digest="0123456789abcdef"))
    assert f"PDController.fmu was built with vdfmu {__version__} from other sources" in words
    assert "digest 01234567, here " in words
    assert words.endswith("Build the FMU again with `vdfmu build`.")


@pytest.mark.parametrize(("text", "words"), [
    ("", "JSONDecodeError"), ("{}", "KeyError: 'unit'"), ("[1, 2]", "TypeError"),
    ("null", "TypeError"), ("\x00\x01", "JSONDecodeError"),
])  # fmt: skip
def test_a_damaged_content_file_is_refused(copy_of, words_of_refusal, text, words):
    folder = copy_of("plant")
    (folder / "resources" / "vdfmu.json").write_text(text)
    said = words_of_refusal(folder)
    assert f"unit: instantiate failed: resources/vdfmu.json cannot be used: {words}" in said
    assert said.endswith("Build the FMU again.")


def test_a_lost_content_file_is_said(copy_of, words_of_refusal):
    """Without it, an FMU is that of the file in ``fmu_src``, if its description says so."""
    folder = copy_of("plant")
    (folder / "resources" / "vdfmu.json").unlink()
    assert words_of_refusal(folder).endswith("or its content file is missing. Build the FMU again.")


@pytest.mark.parametrize(("values", "words"), [
    ({"unit": "controller"}, "belongs to unit 'controller', expected a file of Plant"),
    ({"unit": "motor"}, "belongs to unit 'motor', expected a file of Plant"),
    ({"robot": None}, "KeyError: 'robot'"),
    ({"robot": 3}, "resources/vdfmu.json: the file: expected a table, got 3"),
    ({"robot": {}}, "resources/vdfmu.json: name: expected a string"),
    ({"start_values": {"mass[1]": 0.0}}, "start values of plant: mass[1]: expected a number above 0"),
    ({"start_values": 3}, "TypeError"),
    ({"tool": None}, "KeyError: 'tool'"),
])  # fmt: skip
def test_a_content_file_with_wrong_entries_is_refused(copy_of, words_of_refusal, values, words):
    said = words_of_refusal(change(copy_of("plant"), **values))
    assert "unit: instantiate failed: resources/vdfmu.json" in said
    assert words in said


def test_the_refusal_reaches_a_user_who_left_fmi_logging_off(copy_of, caplog):
    """Plain fmpy shows no FMI message then; Python's logging shows errors to everybody."""
    folder = change(copy_of("plant"), version="9.9.9")
    with pytest.raises(Exception, match="Failed to instantiate model"):
        fmpy.simulate_fmu(str(folder), stop_time=0.01)
    (record,) = (r for r in caplog.records if r.name == "vdfmu.compiler.fmu")
    assert record.levelname == "ERROR"
    assert "was built with vdfmu 9.9.9" in record.getMessage()


WITHOUT = """
import ctypes, os, sys
os.dup2(1, 2)

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] == sys.argv[2]:
            raise ModuleNotFoundError(f"No module named {name!r} at 100%s", name=name)

sys.meta_path.insert(0, Blocked())
import fmpy
for _ in range(3):
    try:
        fmpy.simulate_fmu(sys.argv[1], stop_time=0.01, debug_logging=sys.argv[3] == "logging")
    except Exception as error:
        print("raised:", error)
sys.stdout.flush()
ctypes.CDLL(None).fflush(None)
os._exit(0)  # of processes with libraries of pythonfmu that could not start, one in many dies at the end
"""


@pytest.mark.few(1)
@pytest.mark.parametrize("package", ["vdfmu", "casadi"])
@pytest.mark.parametrize("logging", ["logging", "silent"])
def test_a_python_without_the_packages_says_what_to_install(folders, run_python, package, logging):
    """On stderr, and by fmpy's own logger, which passes the text to printf: a percent sign must not reach it."""
    said = run_python(WITHOUT, folders["planar_2dof"]["plant"], package, logging)
    expected = (
        "this FMU needs the package vdfmu in the Python that imports it (pip install vdfmu): "
        f"No module named '{package}' at 100"
    )
    assert said.count(f"{expected}%s") == 3
    assert said.count(f"{expected} percents") == (3 if logging == "logging" else 0)
    assert said.count("raised: Failed to instantiate model") == 3


def test_a_rebuilt_fmu_in_the_same_folder_is_read_anew(planar, tmp_path):
    """Nothing of an FMU is remembered by its folder."""
    weights = []
    for mass in (2.0, 3.0):
        built = build_fmus(
            planar.with_parameters(mass=[mass, 1.0]), tmp_path / "fmus", units=["plant"], backend="python", folded=True
        )
        shutil.rmtree(tmp_path / "unpacked", ignore_errors=True)
        fmpy.extract(built["plant"], tmp_path / "unpacked")
        plant = Instance(Model(tmp_path / "unpacked")).start()
        weights.append(plant.get("tau_s")[0])
        plant.free()
    # static equilibrium, g a1 per kilogram of link 1; the weights are rounded to 1e-15
    assert weights[1] - weights[0] == pytest.approx(9.81 * 0.25, rel=1e-14)
