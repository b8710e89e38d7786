"""Tables show the numbers of the summary, whole, and the terminal the same ones."""

import copy

import pytest
from rich.console import Console

from tests.study.report.tracking import TRACKING
from vdfmu.study.report.sheets import facts, reference_sheet, sheet_table, sheets, tracking_sheet


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
