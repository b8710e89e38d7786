"""Figures are declared once: page and files show the same curves, whose units follow from their quantity."""

import re
import struct
import subprocess
import sys
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

import vdfmu
from tests.conftest import heavy
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.measure import _QUANTITIES, coherent, inches, shown_as, spaced, unit_of
from vdfmu.engine.results.results import Results, Signal
from vdfmu.extras.pictures import style
from vdfmu.extras.pictures.picture import draw
from vdfmu.study.report.content import TOOL, run_figures, tool_error, write_pictures
from vdfmu.study.run.scene import arm_of

KEYS = ("position", "tracking", "torque", "compensation", "torsion")
MIXED = ("revolute", "prismatic", "revolute")
COLUMN = 85.0 / 25.4
"""Width of a column of a paper [in]."""


def figures_of(made, types):
    """Return results, robot, and the figures of the page by key."""
    results, robot = made.results(len(types)), made.scenario(types).robot
    return results, robot, {each.key: each for each in run_figures(results, {"arm": arm_of(robot, {})})}


def every_picture(made, types, width=COLUMN) -> dict[str, Figure]:
    results, robot, figures = figures_of(made, types)
    pictures = {key: draw([figure], {"": results}, width) for key, figure in figures.items()}
    return pictures | {"tool": draw([TOOL], {"": tool_error(robot, results)}, width)}


def chunks(png: bytes) -> list[bytes]:
    """Return the types of the chunks of a PNG file."""
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    kinds, place = [], 8
    while place < len(png):
        length, kind = struct.unpack(">I4s", png[place : place + 8])
        kinds.append(kind)
        place += length + 12
    return kinds


# --- what they show --------------------------------------------------------------------------------------


@pytest.mark.parametrize("joint_type", ["revolute", "prismatic"])
def test_the_unit_of_every_quantity_is_shown_with_its_factor(joint_type):
    for quantity in _QUANTITIES:
        unit, factor = shown_as(quantity, joint_type)
        name, worth = coherent(unit)
        assert name == unit_of(quantity, joint_type)
        assert factor * worth == pytest.approx(1.0, rel=1e-15)  # one rounding of the quotient


def test_torques_are_link_side_the_feedforward_dashed_on_top_and_errors_have_one_figure_a_unit(made, types):
    results, robot, figures = figures_of(made, types)
    for kind in set(types):
        axes = draw([figures[f"torque.{kind}"]], {"": results}).axes[0]
        joints = [i for i, each in enumerate(types) if each == kind]
        for i, control, feedforward in zip(joints, axes.lines[: len(joints)], axes.lines[len(joints) :], strict=True):
            np.testing.assert_array_equal(control.get_ydata(), robot.ell[i] * results[f"controller.tau[{i + 1}]"])
            np.testing.assert_array_equal(
                feedforward.get_ydata(), robot.ell[i] * results[f"feedforward.tau_m[{i + 1}]"]
            )
            assert feedforward.is_dashed() and not control.is_dashed()
            assert feedforward.get_linewidth() < control.get_linewidth()
        assert axes.get_ylabel() == ("Control forces [N]" if kind == "prismatic" else "Control torques [N m]")
    assert figures.keys() == {f"{key}.{kind}" for key in KEYS for kind in types}


def test_torsion_and_the_error_of_the_tool_in_mm(made):
    results, robot, figures = figures_of(made, MIXED)
    torsion = [draw([figures[f"torsion.{kind}"]], {"": results}).axes[0] for kind in ("revolute", "prismatic")]
    assert [axes.get_ylabel() for axes in torsion] == ["Torsion of the drives [mdeg]", "Torsion of the drives [mm]"]
    # the torsions that the run was made with, 1e-4 times 1, 2, 3; the sum with q leaves their last four digits
    np.testing.assert_allclose(torsion[0].lines[1].get_ydata(), np.rad2deg(3e-4), rtol=1e-11)
    np.testing.assert_allclose(torsion[1].lines[0].get_ydata(), 0.2, rtol=1e-11)
    tool = np.array([line.get_ydata() for line in draw([TOOL], {"": tool_error(robot, results)}).axes[0].lines])
    jacobian = vdfmu.dynamics.jacobian(robot, results["plant.q"])[:, :3]
    moved = np.einsum("mij,mj->mi", jacobian, results["trajectory.q_d"] - results["plant.q"])
    rotation = vdfmu.dynamics.forward_kinematics(robot, results["plant.q"])[1]
    # angles of 3e-5 and a reach of less than 1 m: the rest of second order is below 1e-9 m, 1e-6 mm
    np.testing.assert_allclose(tool, 1e3 * np.einsum("mij,mj->im", rotation, moved), atol=1e-6)


def test_a_joint_has_one_look_in_all_figures_and_many_joints_differ(made):
    pictures = every_picture(made, ("revolute",) * 6)
    looks = {key: [(line.get_color(), line.get_linestyle()) for line in pictures[f"{key}.revolute"].axes[0].lines[:6]]
             for key in KEYS}  # fmt: skip
    (legend,) = pictures["torque.revolute"].axes[0].findobj(matplotlib.legend.Legend)
    entries = [(line.get_color(), line.get_linestyle()) for line in legend.get_lines()[:6]]
    assert all(look == entries for look in looks.values()) and len(set(entries)) == 6
    words = [text.get_text() for text in legend.get_texts()]
    assert words == [*(f"joint {i}" for i in range(1, 7)), r"$\ell \tau$", r"$\ell \tau_{m}$"]
    looks = {(style.joint_look(i)["color"], style.joint_look(i)["linestyle"]) for i in range(28)}
    assert len(looks) == 28


# --- that they can be read, and set in a paper -----------------------------------------------------------


@pytest.mark.heavy
@pytest.mark.parametrize("width", ["85mm", *heavy("16cm", "5in")])
def test_a_figure_has_the_width_asked_for_8_pt_and_no_title_or_caption(made, tmp_path, width):
    results, robot = made.results(3), made.scenario(MIXED).robot
    results.summary["arm"] = arm_of(robot, {})
    write_pictures(results, robot, tmp_path, ["pdf"], inches("width", width))
    box = re.search(rb"/MediaBox \[ *0 0 ([\d.]+) [\d.]+ *\]", (tmp_path / "figure_torque.pdf").read_bytes())
    assert box and float(box[1]) / 72.0 == pytest.approx(inches("width", width), abs=1e-3)  # digits of the file
    for picture in every_picture(made, MIXED, inches("width", width)).values():
        picture.canvas.draw()
        (axes,) = picture.axes
        assert not picture.texts and not picture._suptitle and axes.get_title(loc="left") == ""
        texts = [text for text in picture.findobj(matplotlib.text.Text) if text.get_text() and text.get_visible()]
        assert texts and {text.get_fontsize() for text in texts} == {8.0}


def test_legends_are_inside_and_hide_no_data(made):
    for key, picture in every_picture(made, MIXED).items():
        picture.canvas.draw()
        (axes,) = picture.axes
        panel = axes.get_window_extent()
        for legend in axes.findobj(matplotlib.legend.Legend):
            box = legend.get_window_extent()
            assert panel.x0 <= box.x0 and box.x1 <= panel.x1 and panel.y0 <= box.y0 and box.y1 <= panel.y1, key
            for line in axes.lines:
                points = axes.transData.transform(line.get_xydata())
                assert not any(box.contains(*point) for point in points), key
        page = picture.bbox.padded(0.5)
        for text in (axes.yaxis.label, axes.xaxis.label):
            box = text.get_window_extent()
            assert box.x0 >= page.x0 and box.x1 <= page.x1 and box.y0 >= page.y0 and box.y1 <= page.y1, key


@pytest.mark.parametrize(
    ("unit", "shown"), [("N.m", "N m"), ("m/s2", "m/s²"), ("kg.m2", "kg m²"), ("1/(N.m)", "1/(N m)"), ("deg", "deg")]
)
def test_units_are_as_papers_print_them(unit, shown):
    assert spaced(unit) == shown


@pytest.mark.parametrize("text", ["85", "85 km", "-85mm", "1mm", "3m", "", "nanmm"])
def test_a_width_is_a_length(text):
    with pytest.raises(UsageError, match=r"width must be a length from 20mm to 2000mm, got .*Try 85mm"):
        inches("width", text)


@pytest.mark.few(6)
@pytest.mark.parametrize("exponent", range(-14, 8))
def test_tick_labels_in_the_unit_of_the_label_are_the_values(exponent):
    @style.styled
    def draw() -> Figure:
        figure = style.new_figure("title", "caption", height=3.0)
        axes = figure.subplots()
        time = np.linspace(0.0, 1.0, 50)
        style.curve(axes, time, 3.7 * 10.0**exponent * np.sin(9.0 * time))
        style.dress(axes, "panel", "Torque", "N.m", time)
        return figure

    figure = draw()
    figure.canvas.draw()
    (axes,) = figure.axes
    label = axes.get_ylabel()
    power = 10.0 ** int(label.split("{")[1].split("}")[0]) if "{" in label else 1.0
    power *= {"[": 1.0, " ": 1.0, "M": 1e6, "k": 1e3, "m": 1e-3, "µ": 1e-6, "n": 1e-9}[label[-5]]
    assert ("{" in label) == (exponent not in range(-9, 9))  # from nN.m to MN.m
    ticks = [(tick, text.get_text()) for tick, text in zip(axes.get_yticks(), axes.get_yticklabels(), strict=True)]
    shown = [float(text.replace("\N{MINUS SIGN}", "-")) * power for _, text in ticks]
    # labels have the few digits that tell the ticks apart, which are multiples of 1, 2, 2.5 or 5
    np.testing.assert_allclose(shown, [tick for tick, _ in ticks], rtol=1e-9, atol=1e-9 * 10.0**exponent)
    assert label.endswith("N m]")
    assert not axes.yaxis.get_offset_text().get_visible()
    assert max(len(text) for _, text in ticks) <= 7


def test_a_constant_is_not_blown_up_to_its_rounding(made):
    figure = figures_of(made, ("revolute",))[2]["torque.revolute"]
    constant = (21.0 + 1e-14 * np.sin(np.arange(401.0))[:, None]) / made.scenario(("revolute",)).robot.ell
    signals = [Signal(f"{name}[1]", "real", "", 0) for name in ("controller.tau", "feedforward.tau_m")]
    (axes,) = draw([figure], {"": Results(np.linspace(0.0, 2.0, 401), signals, {"real": constant})}).axes
    low, high = axes.get_ylim()
    assert low == 0.0 and 21.0 < high < 35.0  # with the legend above


@pytest.mark.parametrize("m", [1, 2, 2000, 2001, 10001, 30001])
def test_thinning_keeps_ends_and_peaks(m):
    random = np.random.default_rng(5)
    time, values = np.arange(m) * 1e-3, random.normal(size=m)
    few_time, few = style.thin(time, values)
    assert len(few) <= 2002
    assert few_time[0] == time[0] and few_time[-1] == time[-1]
    assert few.max() == values.max() and few.min() == values.min()
    assert (np.diff(few_time) > 0).all()
    np.testing.assert_array_equal(values[np.searchsorted(time, few_time)], few)


def test_thinning_goes_round_what_is_not_a_number():
    values = np.sin(np.arange(9000.0))
    values[4000:5000] = np.nan
    _, few = style.thin(np.arange(9000.0), values)
    assert np.nanmax(few) == np.nanmax(values)


# --- files -----------------------------------------------------------------------------------------------


@pytest.mark.heavy
def test_an_unfinished_run_can_be_drawn(made, tmp_path: Path):
    results, robot = made.results(2, points=1), made.scenario(("revolute",) * 2).robot
    results.summary["arm"] = arm_of(robot, {})
    write_pictures(results, robot, tmp_path, ["png"], COLUMN)
    assert {path.name for path in tmp_path.iterdir()} == {f"figure_{key}.png" for key in (*KEYS, "tool")}


@pytest.mark.heavy
def test_the_same_data_give_the_same_bytes(made, tmp_path: Path):
    results, robot = made.results(3), made.scenario(MIXED).robot
    results.summary["arm"] = arm_of(robot, {})

    def drawn() -> dict[str, bytes]:
        write_pictures(results, robot, tmp_path, ["png", "svg", "pdf"], COLUMN)
        return {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    first = drawn()
    names = {*KEYS, *(f"{key}.prismatic" for key in KEYS), "tool"}
    assert first.keys() == {f"figure_{name}.{suffix}" for name in names for suffix in ("png", "svg", "pdf")}
    before = dict(matplotlib.rcParams)
    with matplotlib.rc_context({"font.size": 20.0, "lines.linewidth": 9.0, "savefig.dpi": 40, "axes.grid": False}):
        assert drawn() == first
    assert dict(matplotlib.rcParams) == before
    for name, picture in first.items():
        if name.endswith(".png"):
            assert set(chunks(picture)) == {b"IHDR", b"pHYs", b"IDAT", b"IEND"}  # no text, no time
            width, height = struct.unpack(">II", picture[16:24])
            assert width == int(300 * COLUMN) and height == int(0.62 * 300 * COLUMN)


def test_a_file_in_the_way_is_reported(made, tmp_path: Path):
    results, robot = made.results(1), made.scenario(("revolute",)).robot
    results.summary["arm"] = arm_of(robot, {})
    (tmp_path / "taken").write_text("")
    with pytest.raises(VdfmuError, match=r"cannot write .*figure_tracking\.png"):
        write_pictures(results, robot, tmp_path / "taken", ["png"], COLUMN)


@pytest.mark.heavy
def test_a_run_draws_only_when_asked_and_replaces_its_figures(tmp_path: Path):
    """Without pictures no run imports matplotlib, which takes longer than the run; pyplot is never needed."""
    code = """
import sys, vdfmu
options = dict(stop=0.01, reference=False, out="out")
vdfmu.run("planar_tracking", **options)
assert "matplotlib" not in sys.modules
vdfmu.run("planar_tracking", pictures=["svg"], **options)
assert "matplotlib.pyplot" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], check=True, cwd=tmp_path)
    assert {path.name for path in (tmp_path / "out").glob("figure_*")} == {f"figure_{k}.svg" for k in (*KEYS, "tool")}
    vdfmu.run("planar_tracking", stop=0.01, reference=False, out=tmp_path / "out")
    assert not list((tmp_path / "out").glob("figure_*"))
