"""A unit that fails: what the error says, and what is kept."""

import os
import signal
import tempfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from pythonfmu.builder import FmuBuilder

from vdfmu.base.errors import CosimError, UsageError
from vdfmu.engine.run import Interrupted, simulate
from vdfmu.system.package.write import cached_fmus
from vdfmu.system.scenario import load_scenario

MADE = """
import os
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Made(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.y = 0.0
        self.register_variable(Real("y", causality=Fmi2Causality.output))
        try:
            raise OSError("not told")
        except OSError:
            pass
        if "VDFMU_TEST_MADE" in os.environ:
            raise KeyError("no table")

    def do_step(self, t, h):
        return True
"""


@pytest.fixture
def fragile(pack):
    return pack(["source Ramp y:output", "arm Fragile y:output"])


def run(path, mode, **options):
    parameters = {"arm.at": 0.5, "arm.mode": mode}
    return simulate(path, stop=1.0, step=0.1, parameters=parameters, **options)


def test_an_exception_names_unit_call_time_and_the_units_own_words_and_keeps_the_rows(fragile):
    with pytest.raises(CosimError, match=r"arm failed at t = 0\.5 s in doStep: .*q\[3\] is not finite: 100 %s") as info:
        run(fragile, 0)
    error, results = info.value, info.value.results
    assert (error.unit, error.call, error.time) == ("arm", "doStep", 0.5)
    assert "status fatal" in error.reason
    np.testing.assert_array_equal(results.time, 0.1 * np.arange(6.0))
    np.testing.assert_array_equal(results["arm.y"][1:], 0.1 * np.arange(5.0) + 0.1)
    assert results.messages[-1].status == "fatal"
    assert results.summary["wall_s"] > 0.0


@pytest.mark.parametrize(("mode", "raised", "logged"), [
    (0, "ValueError: q[3] is not finite: 100 %s", ""),
    (4, "IndexError: list index out of range", "the table %s ends"),
])  # fmt: skip
def test_an_exception_has_its_type_and_its_line(fragile, fmus, mode, raised, logged):
    """Its library gives its text alone, and if the unit has logged something in this call, not even that."""
    lines = (fmus["Fragile"].parent / "vdfmu_test_fragile.py").read_text().splitlines()
    at = next(k for k, line in enumerate(lines, 1) if ("raise ValueError('q" if mode == 0 else "[][3]") in line)
    with pytest.raises(CosimError) as info:
        run(fragile, mode)
    words = f"arm failed at t = 0.5 s in doStep: {raised} (vdfmu_test_fragile.py, line {at})"
    assert str(info.value) == f"{words}{f'; it logged: {logged}' if logged else ''} (status fatal)"
    trace = info.value.results.messages[-1].text
    assert trace.startswith("Traceback (") and "in do_step" in trace and trace.endswith(raised)


def test_an_exception_while_a_unit_is_made_has_its_line(pack, fmus, tmp_path, monkeypatch):
    script = tmp_path / "vdfmu_test_made.py"
    script.write_text(MADE)
    monkeypatch.setitem(fmus, "Made", Path(FmuBuilder.build_FMU(script, dest=tmp_path / "Made.fmu")))
    path = pack(["arm Made y:output"])
    simulate(path, step=0.5, isolate=True)  # the exception that it catches is none
    monkeypatch.setenv("VDFMU_TEST_MADE", "1")
    with pytest.raises(CosimError) as info:
        simulate(path, step=0.5, isolate=True)
    at = next(k for k, line in enumerate(MADE.splitlines(), 1) if "no table" in line)
    assert (
        str(info.value) == f"arm failed at t = 0 s in instantiate: KeyError: 'no table' (vdfmu_test_made.py, line {at})"
    )


def test_a_step_that_pythonfmu_refuses_ends_the_simulation(fragile):
    """Whatever its reason: it answers fmi2Discard, and that the unit wants to end the simulation."""
    results = run(fragile, 1)
    assert results.summary["ended"] == {"component": "arm", "time": 0.5}
    assert len(results) == 6
    assert str(results.messages[-2]) == "arm: the load is 50 %s of nominal"
    assert str(results.messages[-1]) == "arm ended the simulation at t = 0.5 s"


def test_a_warning_is_logged_and_the_run_goes_on_and_a_failure_during_initialization_has_no_rows(fragile):
    seen = []
    results = run(fragile, 2, log=seen.append)
    assert len(results) == 11
    warnings = [m for m in seen if m.status == "warning"]
    assert len(warnings) == 5
    assert str(warnings[0]) == "arm: the load is 50 %s of nominal"
    assert warnings[0].time == 0.5
    assert results.messages == seen
    with pytest.raises(CosimError, match="arm failed at t = 0 s in exitInit.*: .*no start possible") as info:
        run(fragile, 3)
    assert info.value.results is None


def test_nothing_is_left_in_the_temporary_folder(fragile, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    (tmp_path / "tmp").mkdir()
    run(fragile, 2)
    with pytest.raises(CosimError):
        run(fragile, 0)
    assert list((tmp_path / "tmp").iterdir()) == []


def test_ctrl_c_ends_the_run_after_the_step_and_keeps_the_rows(fragile):
    def press(k: int, n: int) -> None:
        if k == 3:
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(Interrupted, match=r"interrupted at t = 0\.4 s") as info:
        run(fragile, 2, progress=press)
    assert len(info.value.results) == 5
    assert isinstance(info.value, KeyboardInterrupt)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.parametrize(("options", "message"), [
    ({"step": 0.3}, r"stop: expected a multiple of step = 0\.3 s, got 1 s\. The nearest is 0\.9 s"),
    ({"step": 0.0}, "step: expected a positive finite time, got 0 s"),
    ({"step": float("nan")}, "step: expected a positive finite time, got nan s"),
    ({"step": 0.1, "start": 2.0}, "stop - start: expected a positive finite time, got -1 s"),
    ({"step": 0.1, "tolerance": -1.0}, "tolerance must be positive"),
    ({"step": 0.1, "algorithm": "euler"}, "unknown algorithm 'euler'; there are gauss-seidel, jacobi"),
    ({"step": 0.1, "parameters": {"arm.att": 1.0}}, "arm has no variable 'att'; did you mean at"),
    ({"step": 0.1, "parameters": {"leg.at": 1.0}}, "no component of that name; there are source, arm"),
    ({"step": 0.1, "parameters": {"arm.y": 1.0}}, "is not settable: causality output"),
    ({"step": 0.1, "parameters": {"arm.mode": 0.5}}, "expected a whole number, got 0.5"),
    ({"step": 0.1, "parameters": {"arm.at": "soon"}}, "expected a number, got 'soon'"),
    ({"step": 0.1, "record": ["leg.*"]}, r"no output or connected input matches 'leg\.\*'"),
])  # fmt: skip
def test_wrong_options_are_usage_errors(fragile, options, message):
    with pytest.raises(UsageError, match=message):
        simulate(fragile, **options)


def test_text_is_read_as_a_value_and_messages_of_plain_fmpy_are_still_printed_after_a_run(
    fragile, arm_package, tmp_path, capfd
):
    results = simulate(fragile, step=0.1, parameters={"source.slope": "2.5", "arm.mode": "2"})
    assert results["source.y"][-1] == 2.5 * (0.9 + 0.1)
    # Fmpy's proxy for messages of native units has one receiver in a process, and our runs take it.
    fmus = cached_fmus(load_scenario("planar_tracking"), tmp_path, "native")
    simulate(arm_package(), stop=0.002)
    with pytest.raises(FMICallException):
        fmpy.simulate_fmu(str(fmus["plant"]), stop_time=0.1, start_values={"mass[1]": -1.0})
    assert "[ERROR] Plant: setReal failed: mass[1]: expected a number above 0" in capfd.readouterr().out
