"""Building: the same bytes from the same sources, nothing stale, nothing built that could not start."""

import dataclasses
import sys
import zipfile
from collections.abc import Mapping

import fmpy
import numpy as np
import pytest
from lxml import html

from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.units import shipped_units
from vdfmu.base.errors import FmuError, ModelError, UsageError
from vdfmu.compiler.fmu.content import Content
from vdfmu.compiler.unit.interface import Interface, general_description
from vdfmu.compiler.unit.variable import Variable

BUILD = """
import sys
import fmpy
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import load_robot
for fmu in sys.argv[1:]:
    fmpy.simulate_fmu(fmu, stop_time=0.01)
robot = load_robot("planar_2dof")
build_fmus(robot, "python", backend="python", folded=True)
build_fmus(robot, "native", units=["trajectory", "controller"], backend="native", folded=True)
"""


@pytest.mark.heavy
@pytest.mark.parametrize(
    "environment", [{"PYTHONHASHSEED": "0"}, {"PYTHONHASHSEED": "12345", "VDFMU_CACHE_DIR": "{}/cache"}], ids=str
)
def test_another_process_in_another_folder_builds_the_same_bytes(built, tmp_path, run_python, environment):
    """The seed decides the order of Python's sets, the folder all paths; an empty cache has no traces."""
    folder = tmp_path / "a longer name of a folder"
    folder.mkdir()
    python, native = (built(backend, "planar_2dof") for backend in ("python", "native"))
    environment = {name: value.format(folder) for name, value in environment.items()}
    # what an FMU that ran has brought into the process must not take the place of the installed packages
    run_python(BUILD, python["plant"], cwd=folder, TMPDIR=str(folder), **environment)
    for path in (*python.values(), native["trajectory"], native["controller"]):
        backend = "python" if path in python.values() else "native"
        assert (folder / backend / path.name).read_bytes() == path.read_bytes(), (backend, path.name)


def test_an_fmu_that_is_up_to_date_is_left_alone(planar, tmp_path):
    before = {unit: path.stat() for unit, path in build_fmus(planar, tmp_path, backend="python", folded=True).items()}
    after = {unit: path.stat() for unit, path in build_fmus(planar, tmp_path, backend="python", folded=True).items()}
    for unit in shipped_units():
        assert before[unit].st_mtime_ns == after[unit].st_mtime_ns
        assert before[unit].st_ino == after[unit].st_ino


def test_guids_tell_apart_what_differs_and_nothing_else(planar):
    robots = {
        "planar": planar, "heavier": planar.with_parameters(mass=[2.0, 1.1]),
        "longer": planar.with_parameters(tool_offset=[0.4, 0.1, 0.0]),
    }  # fmt: skip

    def guid(
        *form: str, unit: str = "plant", robot: str = "planar", values: Mapping[str, float] | None = None,
        **content: str,
    ) -> str:  # fmt: skip
        return Content(shipped_units()[unit], robots[robot], values or {}, *form, **content).guid

    forms: list[tuple[str, ...]] = [(), ("native",), ("native", "3.0")]
    changes = [{"digest": "another"}, {"version": "9.9.9"}, {"tool": "pythonfmu 9.9.9"}, {"unit": "controller"}]
    changes += [{"robot": "heavier"}, {"robot": "longer"}]
    guids = [guid(*form, **other) for form in forms for other in ({}, *changes)]
    guids += [guid(*form, values={"q_0[1]": 0.1}) for form in forms]
    assert len(set(guids)) == len(guids) == 24
    assert guid("native") == guid("native")


@pytest.mark.parametrize("damage", [b"not a zip", None])
def test_a_file_that_vdfmu_did_not_write_is_not_replaced(planar, tmp_path, damage):
    path = build_fmus(planar, tmp_path, units=["controller"], backend="python", folded=True)["controller"]
    good = path.read_bytes()
    path.write_bytes(b"")  # no loss
    build_fmus(planar, tmp_path, units="controller", backend="python", folded=True)
    assert path.read_bytes() == good
    there = good[: len(good) // 2] if damage is None else damage
    path.write_bytes(there)
    with pytest.raises(UsageError, match=r"PDController\.fmu: expected no file of this name, or one that vdfmu wrote"):
        build_fmus(planar, tmp_path, units=["controller"], backend="python", folded=True)
    assert path.read_bytes() == there


def test_others_may_read_the_files_and_nothing_else_is_left(planar, tmp_path):
    search_path = list(sys.path)
    built = build_fmus(planar, tmp_path, backend="python", folded=True)
    assert sys.path == search_path
    assert sorted(tmp_path.iterdir()) == sorted(built.values())
    other = tmp_path / "other"
    other.touch()  # has the mode that the umask leaves
    for path in built.values():
        assert path.stat().st_mode == other.stat().st_mode


def test_an_fmu_holds_what_it_needs_and_no_copy_of_pythonfmu(fmus, unit_name):
    path = fmus["planar_2dof"][unit_name]
    with zipfile.ZipFile(path) as archive:
        names = set(archive.namelist())
        assert archive.testzip() is None
        assert {info.date_time for info in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        module = archive.read("resources/slavemodule.txt").decode()
    script = f"vdfmu_{unit_name}_slave"
    assert module == script
    assert names == {
        "modelDescription.xml", "documentation/index.html", f"binaries/linux64/{path.stem}.so",
        f"binaries/win64/{path.stem}.dll", "resources/slavemodule.txt", "resources/vdfmu.json",
        f"resources/{script}.py",
    }  # fmt: skip


def test_the_page_inside_describes_every_variable(planar, fmus, unit_name):
    with zipfile.ZipFile(fmus["planar_2dof"][unit_name]) as archive:
        page = html.fromstring(archive.read("documentation/index.html").decode())
    rows = [[cell.text_content() for cell in row] for row in page.iter("tr")][1:]
    interface = Interface(shipped_units()[unit_name], planar)
    described: list[Variable] = []
    for name, references, _, unit, _, _, text in rows:
        first, *last = map(int, references.split(" .. "))
        members = interface.variables[first : (last or [first])[0] + 1]
        assert name == " .. ".join(dict.fromkeys((members[0].name, members[-1].name)))
        assert {v.unit or "" for v in members} == {unit}
        alike = {general_description(v.description) if last else v.description for v in members}
        assert alike == {text}
        described += members
    assert described == list(interface.variables)
    kinds = {row[2] for row in rows}
    assert kinds <= {"input", "output", "fixed parameter", "tunable parameter"}
    assert "Robot: planar_2dof." in page.text_content()


def test_a_name_with_signs_of_html_is_shown_as_it_is(planar, tmp_path):
    odd = dataclasses.replace(planar, name="arm <2> & more")
    path = build_fmus(odd, tmp_path, units=["controller"], backend="python", folded=True)["controller"]
    with zipfile.ZipFile(path) as archive:
        page = html.fromstring(archive.read("documentation/index.html").decode())
    assert "Robot: arm <2> & more." in page.text_content()
    assert fmpy.read_model_description(path).description.endswith("(arm <2> & more)")


def test_start_values_are_those_of_the_instance_and_of_the_description_and_of_numpy_too(planar, tmp_path, fmus):
    """Static equilibrium at q = 0: tau_s[1] = g (m1 a1 + m2 (l1 + b)), see the robot's file."""
    values = {"plant": {"mass[1]": 3.0, "q_dot_0[2]": 0.5, "equilibrium": False, "tau_s_0[1]": 2.0}}
    path = build_fmus(planar, tmp_path, parameters=values, backend="python", folded=True)["plant"]
    starts = {v.name: v.start for v in fmpy.read_model_description(path).modelVariables}
    assert [starts[name] for name in values["plant"]] == ["3.0", "0.5", "false", "2.0"]
    row = fmpy.simulate_fmu(str(path), stop_time=1e-3, output_interval=1e-3)[0]
    assert row["tau_s[1]"] == 2.0
    assert row["q_dot[2]"] == 0.5
    row = fmpy.simulate_fmu(str(path), stop_time=1e-3, output_interval=1e-3, start_values={"equilibrium": True})[0]
    expected = 9.81 * (3.0 * 0.25 + 1.0 * (0.5 + 0.2))
    assert row["tau_s[1]"] == pytest.approx(expected, rel=1e-14)  # four rounded operations
    values = {"feedforward": {"mode": np.int64(1), "Lambda[1]": np.float64(2.5)}}
    path = build_fmus(planar, tmp_path, units=["feedforward"], parameters=values, backend="python", folded=True)[
        "feedforward"
    ]
    starts = {v.name: v.start for v in fmpy.read_model_description(path).modelVariables}
    assert (starts["mode"], starts["Lambda[1]"]) == ("1", "2.5")


@pytest.mark.parametrize(("unit", "values", "words"), [
    ("plant", {"masss[1]": 1.0}, r"plant has no variable 'masss\[1\]'"),
    ("plant", {"q[1]": 1.0}, r"start values of plant: q\[1\] is an output"),
    ("plant", {"mass[1]": 0.0}, r"plant: mass\[1\]: expected a number above 0, got 0 kg"),
    ("plant", {"mass[1]": "heavy"}, r"mass\[1\]: expected a number in kg, got 'heavy'"),
    ("plant", {"f_s[2]": 0.01}, r"plant: f_s\[2\]: expected f_s >= f_c, got f_s\[2\] = 0.01 N.m, f_c\[2\] = 0.1 "),
    ("feedforward", {"mode": 0.5}, r"mode: expected 0 \(inverse\) or 1 \(vdc\), got 0.5"),
    ("controller", {"ell[1]": 0.5, "K_p[2]": -1.0}, r"ell\[1\]: .* at least 1, got 0.5.*K_p\[2\]: .*got -1"),
])  # fmt: skip
def test_start_values_that_could_not_start_are_refused(planar, tmp_path, unit, values, words):
    with pytest.raises(UsageError, match=words):
        build_fmus(planar, tmp_path, parameters={unit: values}, backend="python", folded=True)
    assert list(tmp_path.iterdir()) == []


def test_a_robot_that_is_not_physical_unknown_units_and_closed_folders_are_refused(planar, tmp_path):
    with pytest.raises(ModelError, match=r"joints\[2\].link.mass: expected a finite number > 0") as caught:
        build_fmus(planar.with_parameters(mass=[0.0, -1.0], ell=0.5), tmp_path, backend="python", folded=True)
    assert len(caught.value.problems) == 4
    with pytest.raises(UsageError, match="There is no unit 'motor'. There are: controller"):
        build_fmus(planar, tmp_path, units=["motor"], backend="python", folded=True)
    for unit in (int, 3):
        with pytest.raises(UsageError, match="expected the name of a unit, a file or a class of Unit, got"):
            build_fmus(planar, tmp_path, units=[unit], backend="python", folded=True)
    with pytest.raises(UsageError, match="parameters: there is no unit 'motor'"):
        build_fmus(planar, tmp_path, parameters={"motor": {}}, backend="python", folded=True)
    (tmp_path / "file").write_text("")
    for backend in ("python", "native"):
        with pytest.raises(FmuError, match=r"file/PDController.fmu: cannot be written: .*Choose another folder"):
            build_fmus(planar, tmp_path / "file", units=["controller"], backend=backend, folded=True)
