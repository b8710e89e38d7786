"""The pictures show the data: curves, units, legends; and the files depend on nothing else."""

import dataclasses
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
from vdfmu.base import style
from vdfmu.base.errors import VdfmuError
from vdfmu.engine.results.recorded import Signal
from vdfmu.engine.results.results import Results
from vdfmu.study.report import plots
from vdfmu.study.report.captions import paper_table
from vdfmu.study.report.pictures import PICTURES, SIGNALS, picture_key, write_pictures
from vdfmu.system.scenario import load_scenario

ONE, TWO, MIXED, SIX = (("revolute",), ("revolute",) * 2, ("revolute", "prismatic", "revolute"), ("revolute",) * 6)


def curves(axes) -> list[np.ndarray]:
    return [np.asarray(line.get_ydata()) for line in axes.lines]


def caption(figure: Figure) -> str:
    return figure.texts[-1].get_text().replace("\n", " ")


def every_figure(made, types: tuple[str, ...]) -> list[Figure]:
    results, scenario = made.results(len(types)), made.scenario(types)
    draws = (plots.draw_torques, plots.draw_errors, plots.draw_moving_positions, plots.draw_moving_torques)
    return [draw(results, scenario) for draw in draws]


def chunks(png: bytes) -> list[bytes]:
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    found, place = [], 8
    while place < len(png):
        length, kind = struct.unpack(">I4s", png[place : place + 8])
        found.append(kind)
        place += length + 12
    return found


def test_torques_are_link_side_and_the_feedforward_is_dashed_on_top(made, types):
    results, scenario = made.results(len(types)), made.scenario(types)
    panels = plots.draw_torques(results, scenario).axes
    assert len(panels) == len(types)
    for i, axes in enumerate(panels):
        control, feedforward = axes.lines
        ell = scenario.robot.ell[i]
        np.testing.assert_array_equal(control.get_ydata(), ell * results[f"controller.tau[{i + 1}]"])
        np.testing.assert_array_equal(feedforward.get_ydata(), ell * results[f"feedforward.tau_m[{i + 1}]"])
        assert feedforward.is_dashed() and not control.is_dashed()
        assert feedforward.get_linewidth() < control.get_linewidth()
        assert axes.get_ylabel() == ("Force [N]" if types[i] == "prismatic" else "Torque [N.m]")
        assert f"Joint {i + 1}" in axes.get_title(loc="left")


def test_errors_have_one_panel_a_unit(made, types):
    results, scenario = made.results(len(types)), made.scenario(types)
    panels = plots.draw_errors(results, scenario).axes
    groups = [kind for kind in ("revolute", "prismatic") if kind in types]
    assert len(panels) == 2 * len(groups)
    error = results["trajectory.q_d"] - results["plant.q"]
    compensation = scenario.robot.ell * (results["controller.tau"] - results["feedforward.tau_m"])
    for column, kind in enumerate(groups):
        joints = [i for i, t in enumerate(types) if t == kind]
        factor, unit, torque = (1e3, "mm", "N]") if kind == "prismatic" else (180.0 / np.pi, "deg", "N.m]")
        positions, torques = panels[column], panels[len(groups) + column]
        # one product of two doubles more or less: 2 units in the last place of values up to 0.1
        np.testing.assert_allclose(curves(positions), factor * error[:, joints].T, rtol=0, atol=1e-15)
        np.testing.assert_allclose(curves(torques), compensation[:, joints].T, rtol=0, atol=1e-13)
        assert unit.lstrip("m") in positions.get_ylabel() and torques.get_ylabel().endswith(torque)


def test_a_joint_has_one_look_in_all_panels_and_many_joints_differ(made):
    figure = plots.draw_errors(made.results(6), made.scenario(SIX))
    looks = [[(line.get_color(), line.get_linestyle()) for line in axes.lines] for axes in figure.axes]
    legend = figure.axes[0].get_legend()
    entries = [(line.get_color(), line.get_linestyle()) for line in legend.get_lines()]
    assert looks[0] == looks[1] == entries
    assert len(set(entries)) == 6
    assert [text.get_text() for text in legend.get_texts()] == [f"Joint {i}" for i in range(1, 7)]
    looks = {(style.joint_look(i)["color"], style.joint_look(i)["linestyle"]) for i in range(28)}
    assert len(looks) == 28
    assert len(plots.draw_moving_torques(made.results(2, at_rest=True), made.scenario(TWO)).axes) == 3


def test_two_joint_figures_show_the_joints_that_move(made):
    results, scenario = made.results(3), made.scenario(MIXED)  # joint 3 rests; joint 2 is prismatic
    angles, lengths, angle_errors, length_errors = plots.draw_moving_positions(results, scenario).axes
    for axes, factor, i in ((angles, 180.0 / np.pi, 1), (lengths, 1e3, 2)):
        actual, desired = axes.lines
        np.testing.assert_array_equal(actual.get_ydata(), factor * results[f"plant.q[{i}]"])
        np.testing.assert_array_equal(desired.get_ydata(), factor * results[f"trajectory.q_d[{i}]"])
        assert desired.is_dashed()
    assert [len(axes.lines) for axes in (angle_errors, length_errors)] == [1, 1]

    *torques, torque_errors, force_errors = plots.draw_moving_torques(results, scenario).axes
    assert [axes.get_title(loc="left") for axes in torques] == ["(a) Joint 1", "(b) Joint 2"]
    ell = scenario.robot.ell
    np.testing.assert_array_equal(curves(torques[1])[0], ell[1] * results["controller.tau[2]"])
    expected = ell[0] * results["controller.tau[1]"] - ell[0] * results["feedforward.tau_m[1]"]
    np.testing.assert_array_equal(curves(torque_errors)[0], expected)
    assert len(force_errors.lines) == 1


@pytest.mark.parametrize("kinds", [SIX, TWO, MIXED])
def test_no_letter_is_on_two_panels_of_a_figure(made, kinds):
    for figure in every_figure(made, kinds):
        titles = [axes.get_title(loc="left") for axes in figure.axes]
        assert [title[:4] for title in titles] == [f"({'abcdefghi'[k]}) " for k in range(len(titles))]
        for title in titles:  # a panel that speaks of another one speaks of one of its own unit
            for letter in re.findall(r"of (\([a-z]\))", title):
                (other,) = (t for t in titles if t.startswith(letter))
                assert other.partition(",")[2] == title.partition(",")[2]


def test_captions_say_which_run_it_is(made):
    results, scenario = made.results(6), made.scenario(SIX, "Table 4; more")
    scenario = dataclasses.replace(scenario, plant_factors={"mass": np.float64(1.02), "f_c": np.arange(6.0)})
    results.summary = {"algorithm": "jacobi", "step": 0.002, "settings": {"controller.K_p[1]": "1500"}}
    text = caption(plots.draw_torques(results, scenario))
    for part in (
        "As figure 10 of the paper",
        "Scenario tracking",
        "robot chain_6",
        "master jacobi",
        "step 2 ms",
        "mass x 1.02, f_c joint by joint",
        "controller.K_p[1] = 1500",
    ):
        assert part in text
    assert "paper" not in caption(plots.draw_torques(results, made.scenario(SIX)))
    assert "master gauss-seidel, step 1 ms" in caption(plots.draw_errors(made.results(6), scenario))


@pytest.mark.parametrize(
    ("settings", "end"),
    [
        *(({"feedforward.mode": mode}, "feedforward vdc.") for mode in ("vdc", "1", 1.0)),
        *(({"feedforward.mode": mode}, "feedforward inverse.") for mode in ("inverse", "0")),
        ({f"controller.K_p[{i}]": str(i) for i in range(1, 5)}, "K_p[4] = 4."),
        ({f"controller.K_p[{i}]": str(i) for i in range(1, 6)}, "K_p[4] = 4 and 1 more."),
    ],
)
def test_captions_show_the_mode_and_a_few_settings(made, settings, end):
    results, scenario = made.results(2), made.scenario(TWO)
    assert "feedforward inverse." in caption(plots.draw_errors(results, scenario))
    results.summary = {"settings": settings}
    assert end in caption(plots.draw_errors(results, scenario))


@pytest.mark.heavy
def test_many_settings_leave_room_for_the_panels(made, tmp_path: Path):
    results, scenario = made.results(2), made.scenario(TWO)
    results.summary = {"settings": {f"plant.inertia[{i},1,1]": "0.123456789" for i in range(1, 105)}}
    assert "and 100 more." in caption(plots.draw_torques(results, scenario))
    assert len(write_pictures(results, scenario, tmp_path)) == 3


@pytest.mark.heavy
def test_nothing_hides_data_or_leaves_the_picture(made, types):
    for figure in every_figure(made, types):
        figure.canvas.draw()
        page = figure.bbox.padded(1.0)
        boxes = [axes.get_window_extent() for axes in figure.axes]
        legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes if axes.get_legend())]
        assert legends
        for item in [*legends, *figure.texts, *(axes.title for axes in figure.axes)]:
            box = item.get_window_extent()
            assert not any(box.overlaps(panel) for panel in boxes)
            assert box.x0 >= page.x0 and box.x1 <= page.x1 and box.y0 >= page.y0 and box.y1 <= page.y1
        for legend in figure.legends:
            assert not any(legend.get_window_extent().overlaps(text.get_window_extent()) for text in figure.texts)
        for axes in figure.axes:
            assert "[" in axes.get_ylabel()


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
    assert label.endswith("N.m]")
    assert not axes.yaxis.get_offset_text().get_visible()
    assert max(len(text) for _, text in ticks) <= 7


def test_a_constant_is_not_blown_up_to_its_rounding(made):
    scenario, time = made.scenario(ONE), np.linspace(0.0, 2.0, 401)
    constant = (21.0 + 1e-14 * np.sin(np.arange(401.0))[:, None]) / scenario.robot.ell
    signals = [Signal(f"{name}[1]", "real", "", 0) for name in ("controller.tau", "feedforward.tau_m")]
    (axes,) = plots.draw_torques(Results(time, signals, {"real": constant}), scenario).axes
    low, high = axes.get_ylim()
    assert low == 0.0 and 21.0 < high < 25.0


@pytest.mark.parametrize("m", [1, 2, 2000, 2001, 10001, 30001])
def test_thinning_keeps_ends_and_peaks_and_goes_round_what_is_not_a_number(m):
    random = np.random.default_rng(5)
    time, values = np.arange(m) * 1e-3, random.normal(size=m)
    few_time, few = style.thin(time, values)
    assert len(few) <= 2002
    assert few_time[0] == time[0] and few_time[-1] == time[-1]
    assert few.max() == values.max() and few.min() == values.min()
    assert (np.diff(few_time) > 0).all()
    np.testing.assert_array_equal(values[np.searchsorted(time, few_time)], few)
    values[m // 2 : m // 2 + m // 9] = np.nan
    assert np.nanmax(style.thin(time, values)[1]) == np.nanmax(values)


@pytest.mark.heavy
@pytest.mark.parametrize("types", [MIXED, SIX], ids=len)
def test_files_are_png_of_plausible_size(made, tmp_path: Path, types):
    paths = write_pictures(made.results(len(types)), made.scenario(types), tmp_path)
    paths += write_pictures(made.results(len(types)), made.scenario(types, "Table 5"), tmp_path)
    assert len({path.name for path in paths}) == 5
    for path in paths:
        png = path.read_bytes()
        width, height = struct.unpack(">II", png[16:24])
        assert 1200 <= width <= 1500 and 400 <= height <= 1800
        assert 20_000 < len(png) < 500_000
    for path in write_pictures(made.results(len(types), points=1), made.scenario(types), tmp_path):
        assert path.stat().st_size > 10_000  # an unfinished run can be drawn


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("source", "names"),
    [
        ("", ["torques.png", "errors.png", "tool.png"]),
        ("Table 4; the maximum is a bound", ["figure_10.png", "figure_11.png", "tool.png"]),
        ("Table 5, joints 1 and 2", ["figure_13.png", "figure_14.png", "tool.png"]),
    ],
)
def test_names_follow_from_the_table_compared_with(made, tmp_path: Path, source, names):
    paths = write_pictures(made.results(2), made.scenario(TWO, source), tmp_path / "made" / "here")
    assert paths == [tmp_path / "made" / "here" / name for name in names]
    assert sorted(path.name for path in paths[0].parent.iterdir()) == sorted(names)


def test_torsion_and_the_error_of_the_tool_in_mm(made):
    results, scenario = made.results(3), made.scenario(MIXED)
    figure = plots.draw_tool(results, scenario)
    first, second, tool = figure.axes
    assert [axes.get_ylabel() for axes in (first, second)] == [r"$\kappa - q$ [mdeg]", r"$\kappa - q$ [mm]"]
    # the torsions that the run was made with, 1e-4 times 1, 2, 3; the sum with q leaves their last four digits
    np.testing.assert_allclose(first.lines[1].get_ydata(), np.rad2deg(3e-4), rtol=1e-11)
    np.testing.assert_allclose(second.lines[0].get_ydata(), 0.2, rtol=1e-11)
    jacobian = vdfmu.jacobian(scenario.robot, results["plant.q"])[:, :3]
    moved = np.einsum("mij,mj->mi", jacobian, results["trajectory.q_d"] - results["plant.q"])
    rotation = vdfmu.forward_kinematics(scenario.robot, results["plant.q"])[1]
    error = 1e3 * np.linalg.norm(np.einsum("mij,mj->mi", rotation, moved), axis=1)
    # angles of 3e-5 and a reach of less than 1 m: the rest of second order is below 1e-9 m, 1e-6 mm
    np.testing.assert_allclose(tool.lines[3].get_ydata(), error, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "tables"), [("tracking", 4), ("tracking_split", 4), ("two_joint", 5), ("slider_tracking", 0)]
)
def test_shipped_scenarios_say_which_table(name, tables):
    assert paper_table(load_scenario(name)) == tables


@pytest.mark.heavy
def test_the_same_data_give_the_same_bytes(made, tmp_path: Path):
    results, scenario = made.results(3), made.scenario(MIXED)
    paths = [tmp_path / f"{name}.png" for name in PICTURES[0]]

    def drawn() -> list[bytes]:
        for path in paths:
            plots.draw_picture(results, scenario, path)
        return [path.read_bytes() for path in paths]

    first = drawn()
    before = dict(matplotlib.rcParams)
    with matplotlib.rc_context({"font.size": 20.0, "lines.linewidth": 9.0, "savefig.dpi": 40, "axes.grid": False}):
        second = drawn()
    assert first == second
    assert dict(matplotlib.rcParams) == before
    for png in first:
        assert set(chunks(png)) == {b"IHDR", b"pHYs", b"IDAT", b"IEND"}  # no text, no time


def test_a_picture_of_the_same_numbers_is_not_drawn_again(made, tmp_path: Path, monkeypatch):
    monkeypatch.setenv("VDFMU_CACHE_DIR", str(tmp_path / "cache"))
    results, scenario = made.results(2), made.scenario(TWO)
    first = write_pictures(results, scenario, tmp_path / "first", ("png", "svg"))
    drawn: list[str] = []
    monkeypatch.setattr(plots, "draw_picture", lambda results, scenario, path: drawn.append(path.name) or path.touch())
    second = write_pictures(results, scenario, tmp_path / "second", ("png", "svg"))
    assert not drawn and len(first) == 6
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]
    results.data["real"][400, 0] = np.nextafter(results.data["real"][400, 0], 1.0)
    write_pictures(results, scenario, tmp_path / "second", ("png",))
    assert drawn == ["torques.png", "errors.png", "tool.png"]


def test_all_that_a_picture_shows_is_in_its_key(made):
    results, scenario = made.results(2), made.scenario(TWO)
    keys = [picture_key(results, scenario)]
    for column in range(results.data["real"].shape[1]):
        changed = results.data["real"].copy()
        changed[-1, column] = np.nextafter(changed[-1, column], 9.0)
        keys.append(picture_key(Results(results.time, results.signals, {"real": changed}), scenario))
    keys.append(picture_key(Results(2.0 * results.time, results.signals, results.data), scenario))
    arm = scenario.arm
    for other in (
        dataclasses.replace(scenario, robot=arm.with_parameters(ell=2.0 * arm.ell)),
        dataclasses.replace(scenario, robot=dataclasses.replace(arm, joint_types=("revolute", "prismatic"))),
        dataclasses.replace(scenario, paper={"source": "Table 4"}),
        dataclasses.replace(scenario, plant_factors={"mass": 1.1}),
    ):
        keys.append(picture_key(results, other))
    results.summary = {"settings": {"plant.mass[1]": "2"}}
    keys.append(picture_key(results, scenario))
    assert len(set(keys)) == len(keys)


@pytest.mark.parametrize("name", ["figure_10", "figure_11", "figure_13", "figure_14", "tool"])
def test_drawing_reads_only_what_is_in_the_key(made, tmp_path: Path, name):
    results, scenario = made.results(2), made.scenario(TWO)
    read: set[str] = set()

    class Watched:
        """Hands out what is in the key; the caption, which is in it too, is made of the rest."""

        time, summary, arm = results.time, results.summary, scenario.arm

        def __getitem__(self, signal: str) -> np.ndarray:
            read.add(signal)
            return results[signal]

    both = Watched()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plots, "run_caption", lambda *_: "caption")
        plots.draw_picture(both, both, tmp_path / f"{name}.svg")
    assert read <= set(SIGNALS) and (tmp_path / f"{name}.svg").stat().st_size > 10_000


def test_a_file_in_the_way_is_reported(made, tmp_path: Path):
    (tmp_path / "taken").write_text("")
    with pytest.raises(VdfmuError, match=r"cannot write .*torques\.png"):
        write_pictures(made.results(1), made.scenario(ONE), tmp_path / "taken")


@pytest.mark.heavy
def test_pyplot_is_not_needed():
    code = "import sys, vdfmu.study.report.plots; sys.exit('matplotlib.pyplot' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
