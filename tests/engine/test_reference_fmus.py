"""The Reference FMUs of the Modelica Association, alone and joined, to the bits of fmpy's own simulation."""

from functools import cache
from typing import Any

import fmpy
import numpy as np
import pytest

import vdfmu
from tests.compiler.eventful import Lag
from tests.engine.reference_fmus import VERSIONS, Reference
from tests.warm import command
from vdfmu.arm.fmus import build
from vdfmu.base.errors import SspError, UsageError
from vdfmu.engine.inspect.inspection import inspect_file
from vdfmu.study.report.shown_run import read_run

GRIDS = {"BouncingBall": (3.0, 0.01), "Dahlquist": (10.0, 0.1), "Feedthrough": (2.0, 0.1), "Resource": (1.0, 1.0),
         "StateSpace": (10.0, 1.0), "Stair": (9.0, 0.2), "VanDerPol": (20.0, 0.1)}  # fmt: skip
"""Stop and step [s]; solvers make whole steps of their own in each."""
CASES = [(model, version) for version, models in VERSIONS.items() for model in models if model in GRIDS]
PASSED: dict[str, dict[str, Any]] = {
    "1.0": {"Float64_continuous": 0.1, "Int32": 2**31 - 1, "Enumeration": 2, "Boolean": True}
}
PASSED["2.0"] = PASSED["1.0"] | {"String": "grün"}
PASSED["3.0"] = PASSED["2.0"] | {"Float32_continuous": 0.5, "UInt8": 255, "Int64": 2**63 - 1, "Binary": "00ff00"}
"""Values that pass through Feedthrough."""


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reference")
    return cache(lambda model, version: Reference(model).build(version, folder))


@pytest.fixture(scope="module")
def lag(tmp_path_factory):
    return build(Lag, tmp_path_factory.mktemp("lag") / "lag.fmu")


def answer(path, stop, step, **options):
    """Return the names of the outputs and their rows by fmpy, arrays element by element."""
    rows = fmpy.simulate_fmu(str(path), stop_time=stop, output_interval=step, fmi_type="CoSimulation", **options)
    columns = {}
    for name in rows.dtype.names[1:]:
        whole = rows[name].reshape(len(rows), -1)
        columns |= {f"{name}[{k}]" if whole.shape[1] > 1 else name: row for k, row in enumerate(whole.T, 1)}
    return columns


@pytest.mark.few(3)
@pytest.mark.parametrize("stepper", ["fmpy", "c"])
@pytest.mark.parametrize("beside", ["alone", "itself", "unit"])
@pytest.mark.parametrize(("model", "version"), CASES)
def test_runs_are_those_of_fmpy(built, lag, model, version, beside, stepper):
    path, (stop, step) = built(model, version), GRIDS[model]
    passed = PASSED[version] if model == "Feedthrough" else {}
    expected = answer(path, stop, step, start_values={f"{kind}_input": value for kind, value in passed.items()})
    links = {f"m.{kind}_output": f"n.{kind}_input" for kind in passed if beside == "itself"}
    signal = {"BouncingBall": "h", "Dahlquist": "x", "Feedthrough": "Float64_continuous_output", "StateSpace": "y[2]",
              "VanDerPol": "x0"}.get(model)  # fmt: skip
    if signal and beside == "unit":
        links = {f"m.{signal}": "n.u"}
    parts = {"m": path} | {"alone": {}, "itself": {"n": path}, "unit": {"n": lag}}[beside]
    if any("String" in each or "Binary" in each for each in links) and stepper == "c":
        stepper = "auto"  # texts are passed on in Python
    values = {f"m.{kind}_input": value for kind, value in passed.items()}
    system = vdfmu.connect(parts, links, algorithm="jacobi")
    results = system.run(stop=stop, step=step, stepper=stepper, parameters=values)
    for name in ("m", "n") if beside == "itself" else ("m",):
        for signal_name, rows in expected.items():
            np.testing.assert_array_equal(results[f"{name}.{signal_name}"], rows)
    if links and beside == "itself":
        with system.instance() as simulator:
            simulator.reset(stop=stop, step=step, parameters=values)
            simulator.step()
            for kind, value in passed.items():
                got = simulator.get(f"n.{kind}_output")
                assert (got.hex() if isinstance(got, bytes) else got) == value
    if signal and beside == "unit":
        fed = np.rec.fromarrays([results.time, results[f"m.{signal}"]], dtype=[("time", float), ("u", float)])
        assert np.ptp(results["n.x"]) > 0.0
        # fmpy interpolates its input between rows
        np.testing.assert_allclose(results["n.x"], answer(lag, stop, step, input=fed)["x"], rtol=1e-12)


def test_the_command_line_says_events_of_reference_fmus(built, tmp_path):
    """A bounce is two events of the FMU: its number changes its sign at the ground and in the next internal step."""
    parts = (f"ball={built('BouncingBall', '3.0')}", f"stair={built('Stair', '3.0')}")
    done = command("run", *parts, "--stop", "5", "--step", "0.2", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "ball: 24 events, first at 0.453 s, last at 2.605 s" in done.stdout
    assert "stair: 5 events, first at 1 s, last at 5 s" in done.stdout
    folder = tmp_path / "results" / "system"
    happened = read_run(folder).summary["events"]
    assert happened["stair"]["times"] == [1.0, 2.0, 3.0, 4.0, 5.0]
    page = (folder / "report.html").read_text()
    assert "last at 2.605 s; stair: 5 events" in page and "Wires from" not in page
    assert "stair at 1, 2, 3, 4, 5 s." in page and '["stair",[1.0,2.0,3.0,4.0,5.0]]' in page.replace(" ", "")


def test_clocks_of_scheduled_execution_are_refused_by_check_and_run_alike(built):
    path = built("Clocks", "3.0")
    (problem,) = inspect_file(path).problems
    with pytest.raises(SspError) as refused:
        vdfmu.load(path)
    assert str(refused.value).endswith(str(problem))


def test_sizes_of_arrays_are_the_same_in_all_runs_of_a_simulator(built):
    system = vdfmu.load(built("StateSpace", "3.0"))
    with system.instance(parameters={"StateSpace_3.n": 2}) as simulator:
        with pytest.raises(UsageError, match=r"StateSpace_3\.n: array sizes cannot change between runs"):
            simulator.run(parameters={"StateSpace_3.n": 3}, stop=0.2, step=0.1)
