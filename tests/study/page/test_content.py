"""What the page of a run is made of: numbers, checks, files; without a browser."""

import base64
import gzip
import json
import re
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

import vdfmu
from tests.conftest import ran
from tests.study.page.shown import numbers
from vdfmu.base.errors import UsageError
from vdfmu.engine.results.results import Results, Signal
from vdfmu.study.report import content
from vdfmu.study.report.content import EXTREMES, FRAMES, content_of
from vdfmu.study.report.page import report_page, write_report
from vdfmu.study.report.scripts import data_element
from vdfmu.study.report.shown_run import ShownRun, newest_run, read_run
from vdfmu.study.run.scene import arm_of
from vdfmu.study.verdict import calculated_checks

LIMIT = 1_000_000
"""Bytes of a page without its data."""


DATA = re.compile('<script id="data" type="application/json">(.*)</script>')
NUMBERS = re.compile('<script id="numbers" type="text/plain">(.*)</script>')


def data_of(path: Path) -> dict:
    return json.loads(DATA.findall(path.read_text())[0])


def curves(figure: dict) -> tuple[np.ndarray, np.ndarray]:
    """Time (m,) and values (curves, m) of a packed figure."""
    t = numbers(figure["time"], "<f8")
    return t, numbers(figure["values"]).reshape(len(figure["curves"]), len(t))


def noise(rows: int, elements: int = 3) -> Results:
    values = np.random.default_rng(3).standard_normal((rows, elements))
    signals = [Signal(f"unit.y[{i + 1}]", "real", "m", i) for i in range(elements)]
    return Results(1e-3 * np.arange(rows), signals, {"real": values}, {"joints": 0})


@pytest.fixture(scope="module")
def planar(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    return folder, vdfmu.run(
        "planar_tracking", stop=0.2, out=folder, reference=False, parameters={"plant.offset[2,1]": 0.6}
    )


def test_no_peak_is_lost_and_rows_are_those_of_the_run():
    results = noise(9001)
    results.data["real"][4567, 1] = 1e3
    (figure,) = content_of(results, results.summary)["signals"]
    t, values = curves(figure)
    rows = np.rint(1e3 * t).astype(int)
    assert (np.diff(rows) > 0).all() and rows[0] == 0 and rows[-1] == 9000
    assert set(range(0, 9001, 9)) <= set(rows)  # every 9th row makes FRAMES intervals of 9000
    np.testing.assert_array_equal(values, results["unit.y"][rows].T.astype("<f4"))
    assert values[1].max() == 1e3
    blocks = -(-9001 // content.BLOCK)
    # the even rows and the last; of each curve two in each of its share of EXTREMES; first and last row of each block
    assert len(rows) <= FRAMES + 1 + 2 * EXTREMES + 2 * blocks


def test_elements_of_an_array_in_two_units_are_two_figures():
    signals = [Signal("plant.q[1]", "real", "rad", 0), Signal("plant.q[2]", "real", "m", 1)]
    results = Results(np.arange(3.0), signals, {"real": np.arange(6.0).reshape(3, 2)}, {"joints": 2})
    shown = content_of(results, results.summary)["signals"]
    assert [(signal["key"], signal["title"], signal["curves"]) for signal in shown] == [
        ("plant.q, rad", "plant.q", [["q[1]", 1, 0]]), ("plant.q, m", "plant.q", [["q[2]", 2, 0]])
    ]  # fmt: skip
    assert [curves(signal)[1].tolist() for signal in shown] == [[[0.0, 2.0, 4.0]], [[1.0, 3.0, 5.0]]]


def test_memory_does_not_grow_with_the_rows():
    results = noise(200_000, 1)
    tracemalloc.start()
    content_of(results, results.summary)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # a column of all rows takes 1.6 MB; those that are kept, 24 bytes each and their text, 0.3 MB
    assert peak < 8 * 200_000


@pytest.mark.parametrize(("kind", "angle", "unit"), [("revolute", 180.0 / np.pi, "deg"), ("prismatic", 1e3, "mm")])
def test_figures_have_degrees_or_millimetres_and_torques_on_the_link(kind, angle, unit):
    """A torque of the motor is multiplied by the reduction ratio, and by nothing else."""
    names = ("plant.q", "trajectory.q_d", "controller.tau", "feedforward.tau_m", "plant.kappa")
    signals = [Signal(f"{name}[1]", "real", "", k) for k, name in enumerate(names)]
    robot = {"types": [kind], "ell": [100.0], "gravity": [0.0, 0.0, 9.81], "shapes": []}
    robot |= {"rotation": [np.eye(3).tolist()] * 1, "offset": [[0.0] * 3], "tool_offset": [1.0, 0.0, 0.0]}
    arm = robot | {"tool_rotation": np.eye(3).tolist()}
    results = Results(np.arange(2.0), signals, {"real": np.tile([0.25, 0.5, 3.0, 2.0, 1.0], (2, 1))}, {"arm": arm})
    figures = {figure["key"].partition(".")[0]: figure for figure in content_of(results, results.summary)["figures"]}
    values = {key: (figure["unit"], *curves(figure)[1][:, 0].tolist()) for key, figure in figures.items()}
    force = {"deg": "N.m", "mm": "N"}[unit]
    assert values == {
        "position": (unit, *np.float32([0.25 * angle, 0.5 * angle])), "tracking": (unit, np.float32(0.25 * angle)),
        "torque": (force, 300.0, 200.0), "compensation": (force, 100.0), "torsion": (unit, np.float32(0.75 * angle)),
    }  # fmt: skip


def test_the_arm_has_the_values_of_the_run_and_rails_reach_as_far(planar):
    _, results = planar
    assert results.summary["arm"]["offset"] == [[0.0, 0.0, 0.0], [0.6, 0.0, 0.0]]
    arm = arm_of(vdfmu.load_robot("slider_3dof"), {})
    signals = [Signal(f"plant.q[{i + 1}]", "real", unit, i) for i, unit in enumerate(("rad", "m", "rad"))]
    q = np.array([[9.0, 0.1, 0.0], [0.0, -0.3, -5.0], [1.0, 0.2, 0.0]])
    results = Results(np.arange(3.0), signals, {"real": q}, {"joints": 3, "arm": arm})
    drawn = content_of(results, results.summary)["arm"]
    assert not {"shapes", "gravity", "ell"} & set(drawn)
    assert drawn["up"] == [0.0, 0.0, 1.0]
    lengths = np.linalg.norm([*arm["offset"], arm["tool_offset"]], axis=1)
    assert drawn["reach"] == pytest.approx(lengths.sum() + 0.3)
    boxes = [part for part in drawn["parts"] if part["shape"] == "box"]
    assert [(part["body"], part["colour"]) for part in boxes] == [(1, "light"), (2, "joint")]
    r = 0.06 * drawn["reach"] * (1.0 - 0.42 / 2.0)  # of the second of three joints
    np.testing.assert_allclose(boxes[0]["size"], [1.5 * r, 1.5 * r, 0.3 + 2.0 * r])
    # the rail begins at the joint and leads along its axis
    offset, axis = np.array(arm["offset"][1]), np.array(arm["rotation"][1])[:, 2]
    np.testing.assert_allclose(boxes[0]["offset"], offset + 0.15 * axis)


def test_arrays_come_back_bit_by_bit_and_smooth_ones_take_less_than_their_bytes():
    t = np.linspace(0.0, 10.0, 4000)
    arrays = [
        np.array([0.0, -0.0, np.nan, np.inf, -np.inf, 1e-300, 1.0]), np.sin(t).astype("<f4"),
        np.array([2**32 - 1, 0, 7], "<u4"), np.array([], "<f4"), t,
    ]  # fmt: skip
    text = data_element({"a": arrays})
    stored = gzip.decompress(base64.b64decode(NUMBERS.findall(text)[0]))
    for (first, count), array in zip(json.loads(DATA.findall(text)[0])["a"], arrays, strict=True):
        size = array.itemsize
        changes = np.frombuffer(stored, np.uint8, size * count, first).reshape(size, count).T
        bits = np.cumsum(np.ascontiguousarray(changes).view(f"<u{size}"), dtype=f"<u{size}")
        np.testing.assert_array_equal(bits.reshape(-1), array.view(bits.dtype))
    # a sine changes by less than 1 in 400 from row to row, which is below 2^15 of the 2^23 of its mantissa, so the
    # upper two of four bytes hardly change; of equal steps only the rounding is left
    assert len(data_element({"a": arrays[1]})) < 4 * 4000 * 4 / 3 * 0.6
    assert len(data_element({"a": arrays[4]})) < 8 * 4000 * 4 / 3 * 0.1


def test_the_page_of_a_folder_is_that_of_the_run_and_without_its_data_below_its_limit(planar, tmp_path):
    folder, _ = planar
    again = data_of(write_report([read_run(folder)], tmp_path / "again.html"))
    assert again == data_of(folder / "report.html")
    text = (folder / "report.html").read_text()
    assert NUMBERS.findall((tmp_path / "again.html").read_text()) == NUMBERS.findall(text)
    data = sum(len(kind.findall(text)[0]) for kind in (DATA, NUMBERS))
    assert len(text.encode()) - data < LIMIT
    before = text.split("<script")[0]
    assert all(address.startswith(("data:", "#")) for address in re.findall(r"""(?:src|href)=["']([^"']*)""", before))


def test_names_of_a_run_cannot_break_the_page(tmp_path):
    results = noise(5)
    evil = '</script><script>alert("x")</script>'
    results.summary["scenario"] = evil
    renamed = results.renamed(lambda name: name.replace("unit", evil))
    text = report_page([ShownRun("run", renamed, renamed.summary, tmp_path / "none.ssp")]).decode()
    assert evil not in text
    assert text.count("</script>") == 4  # data, its numbers, libraries, our own


def test_the_command_writes_one_page_of_its_folders_and_says_which_has_no_run(planar, tmp_path, monkeypatch):
    pytest.importorskip("vdfmu.extras.compare")
    folder, _ = planar
    ran("report", folder, folder, "--no-simulate", "--out", tmp_path / "both.html")
    assert [run["name"] for run in data_of(tmp_path / "both.html")["runs"]] == [
        f"{folder.name} (1)",
        f"{folder.name} (2)",
    ]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "results").symlink_to(folder.parent)
    assert newest_run(Path("results")).resolve() == folder.resolve()
    with pytest.raises(UsageError, match="expected the folder of a run.*'vdfmu run' writes one"):
        read_run(tmp_path)
    with pytest.raises(UsageError, match="must hold results of a run"):
        newest_run(tmp_path)


def test_checks_pass_and_fail_by_their_limits_and_a_chaotic_loop_by_statistics():
    summary = {
        "reference": {"sampled": {"name": "sampled", "max_position_difference_rad": 1e-8}},
        "max_position_error_deg": [1e-3], "position_units": ["deg"],
    }  # fmt: skip
    (check,) = calculated_checks(summary)
    assert check.state == "good" and check.key == "reference"
    # a thousandth of 1e-3 degrees is 1.745e-8 rad
    summary["reference"]["sampled"]["max_position_difference_rad"] = 1.8e-8
    (check,) = calculated_checks(summary)
    assert check.state == "failed" and "differ by 1.8e-8 rad at most; limit 1.75e-8" in check.text
    # an arm that has hardly moved, with errors of 1e-7 degrees: the reference is solved to 1e-11 rad
    summary["max_position_error_deg"] = [1e-7]
    for apart, state in ((9e-12, "good"), (1.1e-11, "failed")):
        summary["reference"]["sampled"]["max_position_difference_rad"] = apart
        (check,) = calculated_checks(summary)
        assert check.state == state and "the absolute tolerance" in check.source
    sampled = {"name": "sampled", "max_position_difference_rad": 1.0, "rms_position_difference": 0.01,
               "rms_torque_difference": 0.02}  # fmt: skip
    summary = {"reference": {"sampled": sampled}, "separation": {}, "max_position_error_deg": [1.0],
               "position_units": ["deg"]}  # fmt: skip
    (check,) = calculated_checks(summary)
    assert check.state == "good" and "2 %" in check.text
    sampled["rms_torque_difference"] = 0.06
    (check,) = calculated_checks(summary)
    assert check.state == "failed"
