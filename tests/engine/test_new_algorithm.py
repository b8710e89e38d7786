"""A master algorithm is a file of its own and a row of the registry: commands, packages and runs know it then."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import vdfmu
from tests.engine.files import assert_same_bits
from tests.engine.system_loops import system_loop
from vdfmu.base.errors import UsageError
from vdfmu.engine.algorithms import ALGORITHMS, Algorithm
from vdfmu.engine.linear.linearise import linear_system
from vdfmu.engine.results.verdict import checks_of
from vdfmu.engine.run import Results, simulate
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.program import SystemProgram
from vdfmu.system.scenario import load_scenario

TOY = '''
from vdfmu.engine.masters.sampled import SampledStepper


class Halving(SampledStepper):
    """Splits each step into two of half the length."""

    def advance(self, time, step, stop):
        super().advance(time, 0.5 * step, stop)
        super().advance(time + 0.5 * step, 0.5 * step, stop)


class Varying(SampledStepper):
    """Makes one to three steps of each."""

    def advance(self, time, step, stop):
        count = round(time / step) % 3 + 1
        for k in range(count):
            super().advance(time + k * step / count, step / count, stop)


def halving(coupling):
    return Halving(coupling.exchange)


def varying(coupling):
    return Varying(coupling.exchange)
'''
SILENT = Algorithm("toy_algorithm:halving")
HALVING = replace(SILENT, substeps=2)
ROW = 'ALGORITHMS["halving"] = Algorithm("toy_algorithm:halving")'
UNSAID = "the algorithm halving declares neither substeps nor continuous"


@pytest.fixture
def toy(tmp_path, monkeypatch):
    """Return what gives the algorithm of the toy a row."""
    (tmp_path / "toy_algorithm.py").write_text(TOY)
    monkeypatch.syspath_prepend(str(tmp_path))
    return lambda row: monkeypatch.setitem(ALGORITHMS, "halving", row)


@pytest.fixture
def chain(pack):
    """Return a package in which one component reads another, and so sees its steps."""
    components = ["r Ramp y:output", "g Gain u:input y:output"]
    return pack(components, ["r.y -> g.u"])


def run_of(package: Path, folder: Path, **options) -> tuple[Results, Results]:
    """Return the results in memory, and those read back from the file that the run wrote."""
    options = {"algorithm": "halving", "isolate": False, **options}
    results = simulate(package, stream=folder / "results.csv", **options)
    (folder / "summary.json").write_text(json.dumps(results.summary))
    return simulate(package, **options), Results.read(folder / "results.csv")


def test_a_new_algorithm_is_one_row_of_the_registry_with_one_kind_of_inputs(toy, chain):
    with pytest.raises(UsageError, match="unknown algorithm 'halving'; there are gauss-seidel, "):
        simulate(chain, step=0.1, stop=1.0, algorithm="halving")
    toy(SILENT)
    halved = simulate(chain, step=0.1, stop=1.0, algorithm="halving", isolate=False)
    fine = simulate(chain, step=0.05, stop=1.0, algorithm="jacobi", isolate=False)
    coarse = simulate(chain, step=0.1, stop=1.0, algorithm="jacobi", isolate=False)
    assert halved.summary["algorithm"] == "halving"
    for name in ("r.y", "g.y"):
        np.testing.assert_allclose(halved[name][1:], fine[name][2::2], rtol=1e-14)
    assert np.abs(halved["g.y"] - coarse["g.y"]).max() > 0.01
    for row in ({"substeps": -1}, {"substeps": 1, "continuous": True}):
        with pytest.raises(UsageError, match="substeps must be 0 or more, and 0 if it is continuous, got"):
            Algorithm("toy_algorithm:halving", **row)


@pytest.mark.few(2)
@pytest.mark.parametrize(
    "row",
    [SILENT, replace(SILENT, stepper="toy_algorithm:varying"), HALVING, replace(HALVING, ordered=True)],
    ids=["silent", "varying", "halving", "ordered"],
)
def test_inputs_read_back_as_they_were(toy, arm_package, tmp_path, row):
    toy(row)
    memory, read = run_of(arm_package(), tmp_path, stop=0.05, record=["*"])
    assert len(memory.names) == 77
    assert_same_bits(read, memory)
    # the controller's torque reaches the plant within the step, if the row is ordered
    assert ("plant.tau" in memory.summary["held"]) == (row.substeps > 0 and not row.ordered)
    assert any(UNSAID in note for note in memory.summary["notes"]) == (row.substeps == 0)


@pytest.mark.few(1)
@pytest.mark.parametrize("ordered", [False, True])
def test_the_loop_is_the_one_that_it_samples(toy, arm_package, ordered):
    """Two steps of half the length: the loop of a shipped algorithm at half the step."""
    toy(replace(HALVING, ordered=ordered))
    system = linear_system(arm_package(), 0.1, step=1e-3, algorithm="halving")
    fine = linear_system(arm_package(), 0.1, step=5e-4, algorithm="gauss-seidel" if ordered else "jacobi")
    coarse = linear_system(arm_package(), 0.1, step=1e-3, algorithm=fine.algorithm)
    mine, other, wrong = (system_loop(each, ["plant.tau"]).margins() for each in (system, fine, coarse))
    # the same matrices but for times of 0.1 s that differ by 1e-17 s: rounding
    np.testing.assert_allclose(mine.modulus, other.modulus, rtol=1e-12)
    assert np.abs(mine.modulus - wrong.modulus).max() > 0.05


@pytest.mark.heavy
def test_a_run_is_judged_by_what_the_row_declares(toy):
    """A wrong declaration fails by the reference; without any there is no verdict on the loops."""
    checks = {}
    for name, row in (("right", HALVING), ("wrong", replace(HALVING, substeps=1)), ("silent", SILENT)):
        toy(row)
        summary = vdfmu.run("planar_tracking", stop=0.05, algorithm="halving", out=False).summary
        checks[name] = {check["key"]: check["state"] for check in summary["verdict"]["checks"]}
        loops = next(each.text for each in checks_of(summary) if each.key == "stability")
        assert (UNSAID in loops) == (name == "silent")
        assert ("sampled" in summary["reference"]) == (name != "silent")
    assert (checks["right"]["reference"], checks["wrong"]["reference"]) == ("good", "failed")
    assert (checks["right"]["stability"], checks["silent"]["stability"]) == ("good", "not judged")


@pytest.mark.parametrize("row", [SILENT, HALVING])
def test_what_steps_once_refuses_it(toy, chain, xml, pack, row):
    toy(row)
    own_step = '<ssc:Annotation type="com.opensimulationplatform"><osp:StepSizeHint xmlns:osp='
    own_step += '"http://opensimulationplatform.com/SSP/OSPAnnotations" value="0.2"/></ssc:Annotation>'
    scenario = replace(load_scenario("planar_tracking"), algorithm="halving")
    with pytest.raises(UsageError, match="algorithm: expected gauss-seidel or jacobi, got halving"):
        SystemProgram(SystemDescription(scenario))
    slow = xml.component("g", "Gain", "u:input y:output", f"<ssd:Annotations>{own_step}</ssd:Annotations>")
    path = pack(["r Ramp y:output", slow], ["r.y -> g.u"], name="slow.ssp")
    with pytest.raises(UsageError, match="halving takes one step for all; use gauss-seidel or jacobi"):
        simulate(path, step=0.1, stop=1.0, algorithm="halving", isolate=False)
    with pytest.raises(UsageError, match="adaptive: halving samples"):
        simulate(chain, step=0.1, stop=1.0, algorithm="halving", adaptive=1e-3)


@pytest.mark.heavy
def test_commands_and_scenarios_know_it(toy, tmp_path):
    code = f"import sys\nfrom vdfmu.engine.algorithms import ALGORITHMS, Algorithm\n{ROW}\n" + (
        "from vdfmu.cli.commands import app\napp(sys.argv[1:], standalone_mode=False)"
    )

    def command(*arguments):
        return subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, cwd=tmp_path)

    assert "halving" in command("run", "--help").stdout
    wrong = command("run", "planar_tracking", "--algorithm", "halve")
    assert "extrapolated, iterative or halving" in wrong.stderr + str(wrong.stdout)
    out = command("run", "planar_tracking", "--algorithm", "halving", "--stop", "0.02")
    assert out.returncode == 0, out.stderr
    assert UNSAID in " ".join(out.stderr.split())
    page = (tmp_path / "results" / "planar_tracking" / "report.html").read_text()
    assert UNSAID in page and "algorithm: expected gauss-seidel or jacobi, got halving" in page
