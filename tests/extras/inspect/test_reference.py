"""Comparison of FMI 3.0 units with the reference results that they carry (FMI-LS-REF)."""

import re

import numpy as np
import pytest

from tests.engine.files import members
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.files import pack_zip
from vdfmu.engine.inspect.inspection import inspect_file
from vdfmu.extras.inspect.reference import compare, read_table
from vdfmu.system.scenario import load_scenario
from vdfmu.unit import Derivative, Input, State, Unit

FOLDER = "extra/org.fmi-standard.fmi-ls-ref/"


def tampered(fmus_3, path, suffix, change):
    content = members(fmus_3["plant"])
    name = f"{FOLDER}Plant_{suffix}.csv"
    rows = [line.split(",") for line in content[name].decode().splitlines()]
    change(rows[0], rows[1:])
    content[name] = "\n".join(",".join(row) for row in rows).encode()
    pack_zip(path, content)
    return compare(path)


def test_an_element_that_is_off_is_found_by_variable_element_and_time(fmus_3, tmp_path):
    def change(head, rows):
        cells = rows[6][head.index("q")].split()
        cells[1] = repr(float(cells[1]) + 0.01)
        rows[6][head.index("q")] = " ".join(cells)

    report = tampered(fmus_3, tmp_path / "off.fmu", "out", change)
    (problem,) = report.problems
    # row 6 of 10 intervals over 0.2 s
    assert problem.startswith("Plant_out.csv: q, element 2 at t = 0.12 s: expected ")
    assert problem.endswith("differs by 0.01")


def test_other_inputs_give_other_results_and_tables_that_cannot_be_compared_problems(fmus_3, tmp_path):
    """The inputs reach the unit, from the row after a change on: half the torque cannot pass."""

    def change(head, rows):
        for row in rows[-4:]:
            torques = np.array(row[head.index("tau")].split(), float)
            row[head.index("tau")] = " ".join(map(repr, (0.5 * torques).tolist()))

    report = tampered(fmus_3, tmp_path / "other.fmu", "in", change)
    assert any(problem.startswith("Plant_out.csv: kappa_dot, element") for problem in report.problems)

    def rename(head, _rows):
        head[head.index("tau")] = "torque"

    (problem,) = tampered(fmus_3, tmp_path / "a.fmu", "in", rename).problems
    assert problem == "Plant_out.csv: the reference results cannot be compared: the unit has no variable 'torque'"
    (problem,) = tampered(fmus_3, tmp_path / "b.fmu", "out", lambda _, rows: rows[3].pop()).problems
    assert "cannot be compared: line 5: expected" in problem


def test_a_column_that_this_unit_has_not_is_a_note_and_the_others_are_compared(fmus_3, tmp_path):
    """The official Feedthrough FMU of FMI 2.0 carries the table of that of FMI 3.0, which has more variables."""

    def change(head, rows):
        head[head.index("q")] = "quality"
        for row in rows:
            row[head.index("quality")] = "Set me!"
        rows[6][head.index("E_kin")] = "99"

    report = tampered(fmus_3, tmp_path / "off.fmu", "out", change)
    (note,) = report.notes
    assert note == "Plant_out.csv: quality: not compared: the unit has no such variable"
    assert note.rule.number == "RUN004"
    (problem,) = report.problems
    assert problem.startswith("Plant_out.csv: E_kin at t = 0.12 s: expected 99")
    assert report.compared == ["Plant_out.csv"]


def test_results_that_only_the_manifest_names_are_compared_with_quotes_arrays_and_truth_values(fmus_3, tmp_path):
    content = members(fmus_3["trajectory"])
    table = content.pop(f"{FOLDER}Trajectory_out.csv")
    manifest = content[f"{FOLDER}fmi-ls-manifest.xml"]
    content[f"{FOLDER}fmi-ls-manifest.xml"] = manifest.replace(b"Trajectory_out.csv", b"../results.csv")
    pack_zip(tmp_path / "named.fmu", content | {"extra/results.csv": table})
    report = compare(tmp_path / "named.fmu")
    assert (report.problems, report.compared) == ([], ["results.csv"])
    table = read_table('"time", "x", b\n0, 1 2, true\n1, 3 4, false\n')
    assert table.time.tolist() == [0.0, 1.0]
    assert table.columns["x"].tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert table.columns["b"].tolist() == [[1.0], [0.0]]


@pytest.mark.parametrize(("text", "message"), [
    ("time,x\n", "expected a head with 'time' and variables, and at least one row"),
    ("time,x\n0,a\n", "line 2: could not convert"),
    ("time,x\n0,1\n1,1 2\n", "column 'x': expected the same number of elements"),
    ("time,x\n1,1\n0,1\n", "times must not decrease"),
    ("time,x\n0,1\nnan,1\n", "line 3: times must be finite"),
    ("time,x\n0,1\ninf,1\n", "line 3: times must be finite"),
])  # fmt: skip
def test_a_table_that_is_none(text, message):
    with pytest.raises(ValueError, match=message):
        read_table(text)


def test_rows_that_are_too_close_for_the_even_steps_that_a_unit_takes_are_a_note(tmp_path_factory, tmp_path):
    robot = load_scenario("planar_tracking").robot
    plant = build_fmus(robot, tmp_path_factory.mktemp("fmus2"), backend="native", fmi_version="2.0", folded=True)[
        "plant"
    ]
    table = {f"{FOLDER}Plant_out.csv": b"time,E_kin\n0,0\n1e-12,0\n1,0\n"}
    content = members(plant)
    text = content["modelDescription.xml"].replace(b'canHandleVariableCommunicationStepSize="true"', b"")
    pack_zip(tmp_path / "close.fmu", content | {"modelDescription.xml": text} | table)
    findings = compare(tmp_path / "close.fmu")
    assert (findings.problems, findings.compared) == ([], [])
    assert any("two rows are 1e-12 s apart" in note for note in findings.notes)


class Length(Unit):
    """A rate without a slope where it starts, at u = x = 0, which the solver in the FMU refuses."""

    u = Input("1", start=1.5)
    x = State("1")
    x_dot = Derivative(x)

    def derivatives(self) -> None:  # noqa: D102
        self.x_dot = np.sqrt(self.u**2 + self.x**2) - 2.0 * self.x


@pytest.mark.heavy
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_a_unit_that_fails_the_comparison_says_why(tmp_path, version):
    (path,) = build_fmus(None, tmp_path, units=[Length], backend="native", fmi_version=version).values()
    (problem,) = inspect_file(path).problems
    words = r"cannot be compared: FMU failed at t = \S+ s in doStep: .*state x is not finite, and the internal step"
    assert re.search(words, problem)


EXPERIMENT = """<Experiments name="e"><Experiment name="one" {times}>{kind}<Stimuli source="../given.csv"/>
<References source="seen.csv"/></Experiment><Experiment name="two"><Parameters source="p.ssv"/>
<References source="seen.csv"/></Experiment><Experiment name="three"/>
<Experiment name="four"><References source="seen.hdf5" type="application/hdf5"/></Experiment></Experiments>"""


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("times", "kind"), [('startTime="0" stopTime="1"', ""), ("", '<TransientSimulation stopTime="1"/>')]
)
def test_an_experiment_pairs_inputs_and_results_of_any_name(fmus_3, tmp_path, times, kind):
    """Times as the draft's text has them, and as its schema."""
    content = members(fmus_3["controller"])
    for name, other in (("out", "experiments/seen"), ("in", "given")):
        content[f"{FOLDER}{other}.csv"] = content.pop(f"{FOLDER}PDController_{name}.csv")
    content[f"{FOLDER}experiments/a.exp"] = EXPERIMENT.format(times=times, kind=kind).encode()
    manifest = re.sub(rb"<Related .*/>", b"", content[f"{FOLDER}fmi-ls-manifest.xml"])
    related = (
        b'<Related type="application/x-ma-hs-experiments" source="experiments/a.exp" role="experiment/validation"/>'
    )
    content[f"{FOLDER}fmi-ls-manifest.xml"] = manifest.replace(b"</fmiR", related + b"</fmiR")
    pack_zip(tmp_path / "good.fmu", content)
    report = inspect_file(tmp_path / "good.fmu")
    assert (report.problems, report.compared) == ([], ["seen.csv"])
    assert [note.partition("experiment ")[2] for note in report.notes] == [
        "'two': not compared: it sets the parameters of 'p.ssv'",
        "'three': not compared: it has no reference results",
        f"'four': not compared: expected a .csv file of the FMU, got {FOLDER}experiments/seen.hdf5",
    ]
    content[f"{FOLDER}given.csv"] = content[f"{FOLDER}given.csv"].replace(b" ", b"1 ")  # other inputs
    pack_zip(tmp_path / "wrong.fmu", content)
    assert any(problem.startswith("seen.csv: ") for problem in compare(tmp_path / "wrong.fmu").problems)
    content[f"{FOLDER}experiments/a.exp"] = b"<Experiments"
    pack_zip(tmp_path / "broken.fmu", content)
    (problem,) = compare(tmp_path / "broken.fmu").problems
    assert problem.rule.number == "RUN003"
