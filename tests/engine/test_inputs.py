"""Signals from CSV files and arrays for inputs that nothing is connected to."""

import math
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import heavy
from vdfmu.base.errors import UsageError
from vdfmu.engine.algorithms import ALGORITHMS
from vdfmu.engine.plan.inputs import Course, read_inputs
from vdfmu.engine.run import simulate

CONTINUOUS = ("extrapolated", "iterative")
H = 0.125  # a power of two: times are exact
ROUNDING = 1e-14  # some ten operations on numbers of order 1


@pytest.fixture
def lone(pack):
    """Pack a plant y' = u + load on its own."""
    return pack(["plant Plant u:input load:input y:output"], [])


@pytest.fixture
def file(tmp_path):
    def write(text, name="load.csv"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("isolate", [False, *heavy(True)])
@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi"])
def test_a_sampling_master_holds_the_value_of_the_start_of_a_step(lone, file, algorithm, isolate):
    path = file("time,plant.u,plant.load\n0,1,0\n1,3,2\n")
    results = simulate(lone, stop=1.0, step=H, algorithm=algorithm, inputs=path, isolate=isolate)
    t = H * np.arange(8)
    np.testing.assert_array_equal(results["plant.u"], [1.0, *(1.0 + 2.0 * t)])  # row 0: of the initialization
    np.testing.assert_array_equal(results["plant.load"], [0.0, *(2.0 * t)])
    # the sum of what was held
    np.testing.assert_allclose(results["plant.y"][1:], H * np.cumsum(1.0 + 4.0 * t), rtol=ROUNDING)
    assert [name for name in results if name.startswith("(")] == []


@pytest.mark.parametrize("isolate", [False, *heavy(True)])
@pytest.mark.parametrize("adaptive", [None, 1e-6])
@pytest.mark.parametrize("algorithm", CONTINUOUS)
def test_a_continuous_master_lets_it_run(lone, file, algorithm, adaptive, isolate):
    path = file("time,plant.u\n0,1\n0.3,3\n1,0\n")
    results = simulate(lone, stop=1.0, step=0.1, algorithm=algorithm, adaptive=adaptive, inputs=path, isolate=isolate)
    t = 0.1 * np.arange(11)
    u = np.interp(t, [0.0, 0.3, 1.0], [1.0, 3.0, 0.0])
    np.testing.assert_allclose(results["plant.u"], u, atol=ROUNDING)
    # the plant takes no derivatives: it has the mean of both ends, the integral of a line
    integral = np.concatenate([[0.0], np.cumsum(0.05 * (u[1:] + u[:-1]))])
    np.testing.assert_allclose(results["plant.y"], integral, atol=10 * ROUNDING)


@pytest.mark.parametrize("algorithm", CONTINUOUS)
def test_error_control_steps_over_no_jump_and_no_bend(lone, file, algorithm):
    """Rows at 0.31 and 0.32 between two communication points; the integral is exact only if steps end there."""
    held = simulate(
        lone, stop=1.0, step=0.5, algorithm=algorithm, adaptive=1e-3, input_hold=True,
        inputs=file("time,plant.u\n0,0\n0.31,100\n0.32,0\n"),
    )  # fmt: skip
    line = simulate(
        lone, stop=1.0, step=0.5, algorithm=algorithm, adaptive=1e-3,
        inputs=file("time,plant.u\n0,0\n0.31,0\n0.315,100\n0.32,0\n"),
    )  # fmt: skip
    # exact except for the rounding of times
    assert held["plant.y"][1:].tolist() == pytest.approx([1.0, 1.0], abs=1e-12)
    assert line["plant.y"][1:].tolist() == pytest.approx([0.5, 0.5], abs=1e-12)
    assert held.summary["communication"]["rejected"] == 0


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_held_value_changes_at_its_row(lone, file, algorithm):
    """The third row is at a time that k * step rounds otherwise: 3 * 0.1 > 0.3."""
    path = file("time,plant.u\n0,1\n0.3,5\n")
    results = simulate(lone, stop=0.5, step=0.1, algorithm=algorithm, inputs=path, input_hold=True)
    expected = 0.1 * np.cumsum([0.0, 1.0, 1.0, 1.0, 5.0, 5.0])
    np.testing.assert_allclose(results["plant.y"], expected, atol=ROUNDING)


def test_a_fed_input_is_fresh_for_its_readers_and_whole_numbers_and_booleans_are_held(pack, file):
    """As with a source in its place: gauss-seidel gives the plant the gain's output of the same step."""
    path = pack(["gain Gain u:input y:output", "plant Plant u:input y:output"], ["gain.y -> plant.u"])
    t = H * np.arange(9)
    inputs = {"gain.u": (t, t)}
    results = simulate(path, stop=1.0, step=H, algorithm="gauss-seidel", inputs=inputs, record=["*"])
    np.testing.assert_array_equal(results["plant.u"][1:], 2.0 * t[:-1])
    path = pack(["logic Logic bi:input:Boolean ii:input:Integer bo:output:Boolean io:output:Integer"], [])
    signals = file("time,logic.bi,logic.ii\ns,boolean,integer\n0,0,3\n0.5,1,8\n")
    results = simulate(path, stop=1.0, step=0.25, algorithm="jacobi", inputs=signals)
    assert results["logic.io"].tolist() == [4, 4, 4, 9, 9]
    assert results["logic.bo"].tolist() == [True, True, True, False, False]
    for text, words in (("0,0.5,3", "expected 0 or 1"), ("0,0,3.5", "expected whole numbers")):
        with pytest.raises(UsageError, match=words):
            simulate(path, stop=1.0, step=0.25, inputs=file(f"time,logic.bi,logic.ii\n{text}\n"))


def test_units_of_measurement_are_converted_or_refused(pack, file):
    path = pack(["rad Radians u:input m:input K:input"], [])
    results = simulate(path, stop=1.0, step=1.0, inputs=file("time [s],rad.m [m],rad.u\n0,2,1\n"))
    assert results["rad.m"].tolist() == [2.0, 2.0]
    results = simulate(path, stop=1.0, step=1.0, inputs=file("time [s],rad.m [mm],rad.u [deg]\n0,2,90\n"))
    assert results["rad.m"].tolist() == [0.002, 0.002]
    assert results["rad.u"].tolist() == [math.pi / 2, math.pi / 2]
    for heading, words in (
        ("rad.m [N]", "load.csv: rad.m: unit mismatch, 'N'"),
        ("rad.m [furlong]", "expected a unit of measurement such as"),
    ):
        with pytest.raises(UsageError, match=words):
            simulate(path, stop=1.0, step=1.0, inputs=file(f"time,{heading}\n0,2\n"))


def test_columns_that_name_no_free_input_are_all_refused(pack, file):
    path = pack(["a Plant u:input load:input y:output", "b Plant u:input load:input y:output"], ["a.y -> b.u"])
    with pytest.raises(UsageError) as error:
        simulate(
            path, stop=1.0, step=H, algorithm="jacobi",
            inputs=[file("time,a.lod,b.u,a.x0,a.load\n0,0,0,0,0\n"), file("time,a.load\n0,0\n", "again.csv")],
        )  # fmt: skip
    lines = str(error.value).splitlines()
    assert len(lines) == 4
    for line, words in zip(
        lines,
        ("no component has such an input; did you mean a.load", "a.y is connected to it",
         "causality parameter. Free inputs: a.u, a.load, b.load", "again.csv: a.load: is given twice"),
        strict=True,
    ):  # fmt: skip
        assert words in line


def test_of_a_results_file_the_columns_of_free_inputs_are_taken_and_hold_at_the_ends(pack, tmp_path, lone, file):
    wave = np.sin(np.arange(9))
    first = simulate(lone, stop=1.0, step=H, algorithm="iterative", inputs={"plant.u": (H * np.arange(9), wave)})
    assert first.names == ["plant.y", "plant.u"]
    first.write(tmp_path / "results.csv")
    again = simulate(lone, stop=1.0, step=H, algorithm="iterative", inputs=tmp_path / "results.csv")
    np.testing.assert_array_equal(again["plant.y"], first["plant.y"])
    feeding = "1 columns feed inputs; the other 1 do not name an unconnected input"
    assert any(feeding in note for note in again.summary["notes"])
    other = pack(["ramp Ramp y:output"], [], name="other.ssp")
    with pytest.raises(UsageError, match="no column names an unconnected input"):
        simulate(other, stop=1.0, step=H, inputs=tmp_path / "results.csv")
    results = simulate(lone, stop=1.0, step=0.25, inputs=file("time,plant.u\n0.25,1\n0.5,2\n"), algorithm="jacobi")
    assert results["plant.u"].tolist() == [1.0, 1.0, 1.0, 2.0, 2.0]
    assert any("its times are 0.25 to 0.5 s" in note for note in results.summary["notes"])
    whole = simulate(lone, stop=0.5, step=0.25, inputs=file("time,plant.u\n0,1\n0.5,2\n"))
    assert not any("its times" in note for note in whole.summary["notes"])


@pytest.mark.parametrize(("text", "words"), [
    ("", "row 1: expected 'time' as the first column, in s, got an empty file"),
    ("t,plant.u\n0,1\n", "row 1: expected 'time' as the first column, in s, got 't'"),
    ("time [ms],plant.u\n0,1\n", "got 'time [ms]'"),
    ("time\n0\n", "row 1: expected an input in each column"),
    ("time,plant.u,plant.u\n0,1,1\n", "row 1: plant.u: more than one column has this name"),
    ("time,plant.u\n", "expected rows of numbers below the names, got none"),
    ("time,plant.u\ns\n0,1\n", "row 2: expected 2 units of measurement, got 1"),
    ("time,plant.u\n0,1\n1\n", "row 3: expected 2 cells, got 1"),
    ("time,plant.u\n0,1\n\n1,fast\n", "row 4: plant.u: expected a number, got 'fast'"),
    ("time,plant.u\n0,1\n1,nan\n", "row 3: plant.u: expected a finite number, got nan"),
    ("time,plant.u\n0,1\n1,1\n1,2\n", "row 4: time: expected more than the 1 s of the row before, got 1 s"),
])  # fmt: skip
def test_a_file_of_another_form_is_refused_with_its_row(lone, file, text, words):
    path = file(text)
    with pytest.raises(UsageError) as error:
        simulate(lone, stop=1.0, step=H, inputs=path)
    assert f"{path}: " in str(error.value)
    assert words in str(error.value)


@pytest.mark.skipif(not Path("/dev/null").is_char_device(), reason="the platform has no devices in folders")
def test_a_device_is_no_file_of_inputs():
    with pytest.raises(
        UsageError, match="^/dev/null: expected a CSV file in UTF-8, but it cannot be read: it is a pipe, a device"
    ):
        read_inputs("/dev/null")


@pytest.mark.parametrize(("pair", "words"), [
    ((0.0, 1.0), "expected times (m,) and values (m,) or (m, n), got () and ()"),
    (([0.0, 1.0], [1.0]), "got (2,) and (1,)"),
    (([0.0, 0.0], [1.0, 2.0]), "element 1: time: expected more than the 0 s"),
    (([0.0, 1.0], [1.0, np.inf]), "element 1: plant.u: expected a finite number, got inf"),
    (3.0, "expected a pair of arrays of numbers"),
])  # fmt: skip
def test_arrays_of_another_form_are_refused(lone, pair, words):
    with pytest.raises(UsageError) as error:
        simulate(lone, stop=1.0, step=H, inputs={"plant.u": pair})
    assert str(error.value).startswith("inputs['plant.u']: ")
    assert words in str(error.value)


def test_an_array_has_a_column_for_each_element_and_a_line_breaks_where_it_bends(arm_package):
    (table,) = read_inputs({"arm.R": ([0.0, 1.0], np.arange(8.0).reshape(2, 2, 2))})
    assert table.names == ("arm.R[1,1]", "arm.R[1,2]", "arm.R[2,1]", "arm.R[2,2]")
    np.testing.assert_array_equal(table.values[1], [4.0, 5.0, 6.0, 7.0])
    words = r"^inputs\['plant.F_e'\]: expected 6 columns, a value for each of plant.F_e\[1\] to plant.F_e\[6\], got 5$"
    with pytest.raises(UsageError, match=words):
        simulate(arm_package("python"), stop=0.01, step=1e-3, inputs={"plant.F_e": ([0.0, 1.0], np.zeros((2, 5)))})
    t = np.arange(5.0)
    values = np.array([[0.0, 1.0, 2.0, 2.0, 2.0]]).T
    assert Course(t, values, held=False).breaks.tolist() == [0.0, 2.0]
    assert Course(t, values, held=True).breaks.tolist() == [1.0, 2.0]
    assert Course(t[:1], values[:1], held=False).breaks.tolist() == []
