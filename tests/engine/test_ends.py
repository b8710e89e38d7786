"""How a run ends: at its stop time, at the end that a unit makes, at what is not a number, at a failure."""

import json

import numpy as np
import pytest

from tests.conftest import heavy
from tests.warm import command
from vdfmu.base.errors import CosimError
from vdfmu.engine.inspect import trial as check_run
from vdfmu.engine.run import ALGORITHMS, simulate

COUPLINGS = [{"algorithm": name} for name in ALGORITHMS] + [
    {"algorithm": name, "adaptive": 1e-4} for name in ("extrapolated", "iterative")
]


@pytest.fixture
def package(pack, strict):
    """Return a package of the strict unit and an integrator of it, x' = t."""
    return pack(
        ["unit Strict y:output", "plant Plant u:input y:output"],
        ["unit.y -> plant.u"],
        extra={"resources/Strict.fmu": strict.read_bytes()},
        experiment='<ssd:DefaultExperiment startTime="0" stopTime="0.01"/>',
    )


@pytest.mark.parametrize("options", COUPLINGS, ids=lambda o: "-".join(map(str, o.values())))
@pytest.mark.parametrize(
    ("start", "stop", "step"), [*heavy((0.0, 0.01, 0.001), (0.0, 0.3, 0.1)), (0.1, 0.4, 0.1), (-0.3, 0.3, 0.6)]
)
def test_the_last_step_ends_at_the_stop(package, options, start, stop, step):
    """Of the first two, the last step would be too long by rounding: 0.009 + 0.001 > 0.01."""
    results = simulate(package, start=start, stop=stop, step=step, **options)
    assert results.time[-1] == stop
    # where the step can be rounded to it, it is the stop; never beyond, or the unit would have refused
    assert stop - np.spacing(stop) <= results["unit.y"][-1] <= stop
    # all rows before lie on the multiples of the step
    n = len(results) - 1
    np.testing.assert_array_equal(results.time[:-1], start + step * np.arange(n))


@pytest.mark.heavy
def test_check_finds_no_fault_in_a_unit_that_keeps_its_stop_time(package, strict):
    for path, kind in ((package, "SSP"), (strict, "FMU")):
        assert check_run.run_apart(path, kind).problems == []


@pytest.mark.parametrize("options", COUPLINGS, ids=lambda o: "-".join(map(str, o.values())))
@pytest.mark.parametrize(("name", "value"), [("nan_from", "nan"), *heavy(("inf_from", "-inf"))])
def test_what_is_no_number_ends_the_run(package, options, name, value):
    with pytest.raises(CosimError, match=rf"unit failed .* doStep: y is {value} at t = 0\.[57]\d* s, exp") as info:
        simulate(package, stop=1.0, step=0.25, parameters={f"unit.{name}": 0.5}, **options)
    rows = info.value.results
    assert rows["unit.y"].tolist() == [0.0, 0.25]  # those before it, all of numbers


@pytest.mark.heavy
def test_an_output_that_nobody_reads_may_be_left_out(pack, strict):
    path = pack(["unit Strict y:output", "ramp Ramp y:output"], extra={"resources/Strict.fmu": strict.read_bytes()})
    options = {"stop": 1.0, "step": 0.25, "parameters": {"unit.nan_from": 0.5}}
    with pytest.raises(CosimError, match="No component reads it: do not record it"):
        simulate(path, **options)
    assert len(simulate(path, record=["ramp.*"], **options)) == 5


def test_check_notes_what_is_no_number(fmus):
    findings = check_run.run_apart(fmus["Dividing"])
    assert findings.problems == []
    assert any(note.startswith("y is inf at t = 0 s, inputs at their start values") for note in findings.notes)


@pytest.mark.parametrize("options", COUPLINGS, ids=lambda o: "-".join(map(str, o.values())))
@pytest.mark.parametrize("end", [*heavy(0.5), 0.6])
def test_a_unit_that_ends_the_simulation_makes_a_normal_end(package, options, end):
    results = simulate(package, stop=1.0, step=0.25, parameters={"unit.end": end}, **options)
    assert results.summary["ended"] == {"component": "unit", "time": end}
    assert results.summary["stop"] == end
    assert len(results) == results.summary["steps"] + 1
    rows = [0.0, 0.25, 0.5] if end == 0.5 else [0.0, 0.25, 0.5, end]
    assert results.time.tolist() == results["unit.y"].tolist() == rows
    (note,) = [n for n in results.summary["notes"] if "ended" in n]
    assert note.startswith(f"unit ended the simulation at t = {end:g} s")
    if "adaptive" in options:  # the others stop there, to the shortest step, 1e-11 of the run
        assert results["plant.y"][-1] == pytest.approx(end**2 / 2, abs=1e-10)
    elif end == 0.6:
        assert note.endswith("; the last row has its values at this time, and values of other units at t = 0.75 s")


@pytest.mark.heavy
def test_the_command_says_who_ended_the_simulation(package, tmp_path):
    options = ("--step", "0.25", "--stop", "1", "--set", "unit.end=0.5", "--out", tmp_path)
    done = command("run", package, *options)
    assert done.returncode == 0
    assert "unit ended the simulation at t = 0.5 s" in " ".join((done.stdout + done.stderr).split())
    assert json.loads((tmp_path / "summary.json").read_text())["ended"]["time"] == 0.5
