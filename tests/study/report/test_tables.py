"""Tables show the numbers of the summary, whole, and the terminal the same ones."""

import copy
import re
from typing import Any

import pytest
from rich.console import Console

from vdfmu.study.report.latex import sheet_latex, write_tables
from vdfmu.study.report.sheets import Sheet, facts, reference_sheet, sheet_table, sheets, tracking_sheet

TRACKING: dict[str, Any] = {
    "scenario": "two_joint", "robot": "manipulator_6dof", "friction": "lumped", "backend": "python",
    "algorithm": "gauss-seidel", "step": 0.001, "stop": 30.0, "tolerance": 1e-7, "steps": 30000, "wall_s": 6.774,
    "real_time_factor": 4.4287, "position_units": ["deg"] * 3, "torque_units": ["N.m"] * 3,
    "rms_position_error_deg": [4.55149e-3, 1.22387e-2, 1.59958e-8],
    "max_position_error_deg": [5.01096e-3, 1.36230e-2, 2.57374e-8],
    "rms_torque_compensation_error_nm": [1.58905e-1, 4.27694e-1, 2.83864e-7],
    "paper": {
        "source": "Table 5, joints 1 and 2", "rms_position_error_deg": [0.0456, 0.0227],
        "max_position_error_deg": [0.2, 0.2], "rms_torque_compensation_error_nm": [0.1173, 0.2981],
    },
    "reference": {
        name: {"name": full, "max_position_difference_rad": position, "max_torque_difference_nm": torque}
        for name, full, position, torque in (
            ("sampled", "sampled-delayed", 1.234e-8, 5.678e-5), ("continuous", "continuous", 3.2e-6, 2.3e-2),
        )
    },
    "warnings": ["Joint 1: K_v*step is [bold]above[/bold] 0.5."], "parameters": {"controller.K_p[1]": "1500"},
}  # fmt: skip


def shown(renderable, width: int = 80) -> str:
    console = Console(width=width, force_terminal=False)
    with console.capture() as capture:
        console.print(renderable)
    return capture.get()


def test_tracking_rows_with_and_without_a_paper_and_units_behind_the_numbers_where_joints_differ():
    sheet = tracking_sheet(TRACKING)
    assert sheet.columns[1] == "Position\nRMS\n[deg]"
    # 100 * 4.55149e-3 / 0.0456 = 9.98, 100 * 5.01096e-3 / 0.2 = 2.51, 100 * 0.158905 / 0.1173 = 135.5
    row = ("1", "0.00455", "0.0456", "10", "0.00501", "0.2", "2.5", "0.159", "0.1173", "135")
    assert sheet.rows[0] == row
    assert sheet.rows[1][3::3] == ("54", "6.8", "143")
    assert sheet.rows[2] == ("3", "1.6e-8", "-", "-", "2.57e-8", "-", "-", "2.84e-7", "-", "-")
    assert "Table 5, joints 1 and 2" in sheet.notes[1]
    sheet = tracking_sheet({**TRACKING, "paper": {}})
    assert len(sheet.columns) == 4
    assert "aper" not in shown(sheet_table(sheet))
    summary = {**TRACKING, "position_units": ["deg", "mm", "deg"], "torque_units": ["N.m", "N", "N.m"], "paper": {}}
    sheet = tracking_sheet(summary)
    assert sheet.columns == ("Joint", "Position\nRMS", "Position\nmaximum", "Torque\nRMS")
    assert sheet.rows[1] == ("2", "0.0122 mm", "0.0136 mm", "0.428 N")
    assert reference_sheet(summary).columns == ("Reference", "Position\n[rad or m]", "Torque\n[N.m or N]")


@pytest.mark.parametrize(("changed", "said"), [
    ({}, "An ideal case: the feedforward model equals the plant, and the gains are ours."),
    ({"plant_factors": {"mass": 1.02}}, "The plant differs from the model by values of our choice."),
    ({"parameters": {"plant.K_f0": "500"}}, "The plant differs from the model by values of our choice."),
])  # fmt: skip
def test_below_the_errors_stands_why_they_are_small(changed, said):
    assert tracking_sheet({**TRACKING, **changed}).notes[-1].startswith(said)
    assert "chosen" not in str(tracking_sheet({**TRACKING, **changed, "paper": {}}).notes)


def test_statistics_are_compared_where_solutions_separate_and_the_energy_residual_is_a_sum():
    summary = copy.deepcopy(TRACKING) | {"separation": {"change": 1e-9, "max_position_difference_rad": 5.9e-4}}
    for entry, k in zip(summary["reference"].values(), (1.0, 2.0), strict=True):
        entry |= {"rms_position_difference": 0.0123 * k, "rms_torque_difference": 0.0345 * k}
    sheet = reference_sheet(summary)
    assert sheet.columns == ("Reference", "Position RMS\n[%]", "Torque RMS\n[%]")
    assert sheet.rows == [("sampled-delayed", "1.23", "3.45"), ("continuous", "2.46", "6.9")]
    said = " ".join(sheet.notes)
    assert "up to 3.2e-6 rad. This is not an error: the loop is chaotic" in said
    assert "a change of 1e-09 moves the run by 5.9e-4 rad" in said
    assert ("Chaotic loop", "rotor inertias larger by 1e-09 of themselves move the run by 5.9e-4 rad or m") in facts(
        summary
    )
    assert "Chaotic loop" not in [name for name, _ in facts(TRACKING)]
    energies = {"residual": [3e-3, -1e-3], "residual_energy_abs": [4e-3, 4e-3], "exchanged": [30.0, 10.0]}
    bond = {"residual_energy_j": energies["residual"], "residual_energy_abs_j": energies["residual_energy_abs"]}
    said = dict(facts({**TRACKING, "power_bond": bond | {"exchanged_energy_j": energies["exchanged"]}}))
    assert said["Coupling energy error"].startswith(
        "0.008 J, the sum of absolute values, at tau and kappa_dot, where 40 J are exchanged"
    )
    assert said["Coupling energy error"].endswith("; net 0.002 J")
    sheet = reference_sheet(TRACKING)
    assert sheet.rows == [("sampled-delayed", "1.23e-8", "5.68e-5"), ("continuous", "3.2e-6", "0.023")]
    text = shown(sheet_table(sheet))
    assert "[rad]" in text and "[N.m]" in text and "sampled-delayed" in text
    for summary in ({**TRACKING, "reference": {}}, {k: v for k, v in TRACKING.items() if k != "reference"}):
        assert "No reference was solved." in shown(sheet_table(reference_sheet(summary)))
        assert "reference" not in "".join(sheet.title for sheet in sheets(summary))
    why = ("No reference", "tool: an FMU has no equations to solve here")
    assert why in facts({"no_reference": why[1]})


@pytest.mark.parametrize("sheet", [tracking_sheet, reference_sheet])
def test_a_terminal_of_80_columns_shows_every_number_whole_and_a_narrow_one_cuts_nothing_off(sheet):
    text = shown(sheet_table(sheet(TRACKING)))
    for row in sheet(TRACKING).rows:
        assert any(line.split() == list(row) for line in text.splitlines()), row
    for each in (text, shown(sheet_table(sheet(TRACKING)), width=40)):
        assert "\N{HORIZONTAL ELLIPSIS}" not in each


def test_tables_are_latex_of_the_same_rows(tmp_path):
    tables = sheets(TRACKING)
    text = write_tables([("", table) for table in tables], tmp_path / "t.tex").read_text()
    assert text.count(r"\begin{table}") == len(tables) == text.count(r"\end{table}")
    assert r"Joint & [deg] & paper & \% &" in text and r" & RMS &  &  & maximum &" in text and r"[N\,m]" in text
    parts = re.findall(r"midrule\n(.*?)\n\\bottomrule", sheet_latex(tables[0]), re.DOTALL)
    lines = zip(*(part.splitlines() for part in parts), strict=True)  # each part begins with the joints
    for line, row in zip(lines, tables[0].rows, strict=True):
        first, *further = (part.removesuffix(r" \\").split(" & ") for part in line)
        assert all(other[0] == first[0] for other in further)
        cells = [*first, *(cell for other in further for cell in other[1:])]
        numbers = [cell.strip("$").replace(r"\cdot 10^{", "e").rstrip("}") for cell in cells]
        assert len(cells) == len(row)
        for shown, number in zip(numbers, row, strict=True):
            assert shown == number or float(shown) == float(number)


def test_words_of_a_table_are_no_commands_of_latex():
    sheet = Sheet("T\n%", ("a_b", "c"), [("50 % & more", "-1.5"), ("\\x{y}^~#$", "1e-300")], ["two\nlines"])
    text = sheet_latex(sheet)
    assert r"\caption{T \%. two lines}" in text and r"a\_b & c \\" in text
    assert r"50 \% \& more & $-1.5$ \\" in text
    assert r"\textbackslash{}x\{y\}\textasciicircum{}\textasciitilde{}\#\$ & $1\cdot 10^{-300}$ \\" in text
