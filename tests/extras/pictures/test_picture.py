"""The picture of any system's run: which panels there are and what they show."""

from __future__ import annotations

import numpy as np
import pytest

from vdfmu.engine.results.figure import signal_figures
from vdfmu.engine.results.results import Results, Signal
from vdfmu.extras.pictures import style
from vdfmu.extras.pictures.picture import PANELS, chosen, draw, plot, write_signals

FACTS = {"system": "s", "package": "folder/s.ssp", "algorithm": "jacobi", "step": 1e-3}


def make(*signals):
    """Return results of ``(name, kind, unit)``; the values of each are of its own."""
    time = np.linspace(0.0, 1.0, 11)
    columns = {"real": [], "integer": [], "boolean": []}
    made = []
    for i, (name, kind, unit) in enumerate(signals):
        made.append(Signal(name, kind, unit, len(columns[kind])))
        columns[kind].append(i + time if kind == "real" else (np.arange(11) + i) % 2)
    data = {k: np.array(v).T.reshape(11, -1) for k, v in columns.items()}
    return Results(time, made, data, dict(FACTS))


def draw_signals(results, hidden=()):
    """Return the picture of the recorded signals."""
    return draw(chosen(list(signal_figures(results, hidden))), {"": results})


def titles(figure):
    return [axes.get_title(loc="left") for axes in figure.axes]


def test_elements_of_an_array_share_a_panel_of_one_unit_and_what_is_not_continuous_is_drawn_in_steps():
    results = make(
        ("a.q[1]", "real", "rad"), ("a.q[2]", "real", "m"), ("a.q[3]", "real", "rad"), ("a.R[1,2]", "real", "")
    )  # fmt: skip
    figure = draw_signals(results)
    assert titles(figure) == ["a.q", "a.q", "a.R"]
    colours = [[line.get_color() for line in axes.lines] for axes in figure.axes[:2]]
    assert colours == [[style.COLORS[0], style.COLORS[2]], [style.COLORS[1]]]  # by the index, in all panels
    assert [axes.get_ylabel() for axes in figure.axes] == ["[rad]", "[m]", ""]
    first = figure.axes[0]
    assert [line.get_label() for line in first.lines] == ["[1]", "[3]"]
    for line, name in zip(first.lines, ("a.q[1]", "a.q[3]"), strict=True):
        np.testing.assert_array_equal(line.get_ydata(), results[name])
    assert [text.get_text() for text in first.get_legend().get_texts()] == ["[1]", "[3]"]
    assert figure.axes[2].get_legend() is None
    figure = draw_signals(make(("a.n", "integer", ""), ("a.on", "boolean", ""), ("a.x", "real", "")))
    assert [axes.lines[0].get_drawstyle() for axes in figure.axes] == ["steps-post", "steps-post", "default"]


def test_each_component_gets_its_share_of_the_panels():
    names = [*(f"a.x{i}" for i in range(20)), "b.y", *(f"sub.c.z{i}" for i in range(3))]
    figure = draw_signals(make(*((name, "real", "") for name in names)))
    shown = titles(figure)
    assert len(shown) <= PANELS
    assert [t for t in shown if not t.startswith("a.")] == ["b.y", *(f"sub.c.z{i}" for i in range(3))]
    assert shown[:3] == ["a.x0", "a.x1", "a.x2"]
    assert len(names) - len(shown) == 12 and not figure.texts  # no caption
    figure = draw_signals(make(*((f"c{i}.x", "real", "") for i in range(PANELS + 3))))
    assert titles(figure) == [f"c{i}.x" for i in range(PANELS)]


def test_panels_come_in_the_order_asked_for_hidden_signals_have_none_and_no_signals_no_picture(tmp_path):
    results = make(("a.u", "real", ""), ("a.y", "real", ""), ("b.x[1]", "real", ""), ("b.x[2]", "real", ""))
    assert titles(plot(results, ["b.x", "a.y", "a.u"], {}, None)) == ["b.x", "a.y", "a.u"]
    assert titles(plot(results, [], {}, None)) == ["a.u", "a.y", "b.x"]
    results = make(("a.u", "real", ""), ("a.y", "real", ""))
    assert [axes.get_ylabel() for axes in draw_signals(results, {"a.u"}).axes] == ["a.y"]
    assert write_signals(Results(results.time, [], {}), tmp_path, ["png"], 6.0) == [] == [*tmp_path.iterdir()]
    many = make(*((f"a.x{i}", "real", "") for i in range(PANELS + 2)))
    assert write_signals(many, tmp_path, ["png"], 6.0) == [f"a.x{i}" for i in (PANELS, PANELS + 1)]
    assert (tmp_path / "signals.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.heavy
def test_any_name_unit_and_value_can_be_drawn(tmp_path):
    """Dollar signs are no formulas, and values at the ends of the range of numbers do not stop the picture."""
    long = "vehicle.body.suspension.frontLeft.wheel.bearing.angularVelocity.filtered"
    results = make(
        (r"a.$\bad$", "real", r"$\foo$"), ("a.$x_{$", "real", ""), (long, "real", "rad/s"),
        *((f"a.v{i}", "real", "") for i in range(5)),
    )  # fmt: skip
    results.summary["system"] = r"A $\bad$ B " + 30 * "long "
    data = results.data["real"]
    for column, values in enumerate((1e-310, 1.7e308, 5e-324, np.inf, np.nan), start=3):
        data[:, column] = np.where(results.time > 0.3, values, -1.0)
    figure = draw_signals(results)
    figure.draw_without_rendering()
    assert all(len(text) <= 2 * 38 for text in titles(figure))
    assert "$" not in figure.axes[1].get_title(loc="left").replace(r"\$", "")
    assert titles(figure)[2] == f"{long[:18]}…{long[-19:]}"
    write_signals(results, tmp_path, ["png"], 6.0)
    assert (tmp_path / "signals.png").exists()
