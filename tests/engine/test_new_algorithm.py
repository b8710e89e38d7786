"""A master algorithm is a file of its own and a row of the registry: commands, packages and runs know it then."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from vdfmu.base.errors import UsageError
from vdfmu.engine.algorithms import ALGORITHMS, Algorithm
from vdfmu.engine.run import simulate

TOY = '''
from vdfmu.engine.masters.sampled import SampledStepper


class Halving(SampledStepper):
    """Makes two steps of half the length of each."""

    def advance(self, time, step, stop):
        super().advance(time, 0.5 * step, stop)
        super().advance(time + 0.5 * step, 0.5 * step, stop)


def halving(coupling):
    return Halving(coupling.exchange)
'''
ROW = 'ALGORITHMS["halving"] = Algorithm("toy_algorithm:halving")'


@pytest.fixture
def toy(tmp_path, monkeypatch):
    """Return the folder with the file of the toy."""
    (tmp_path / "toy_algorithm.py").write_text(TOY)
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


@pytest.fixture
def chain(pack):
    """Return a package in which one component reads another, and so sees its steps."""
    components = ["r Ramp y:output", "g Gain u:input y:output"]
    return pack(components, ["r.y -> g.u"])


def test_a_new_algorithm_is_one_row_of_the_registry(toy, chain, monkeypatch):
    with pytest.raises(UsageError, match="unknown algorithm 'halving'; there are gauss-seidel, "):
        simulate(chain, step=0.1, stop=1.0, algorithm="halving")
    monkeypatch.setitem(ALGORITHMS, "halving", Algorithm("toy_algorithm:halving"))
    halved = simulate(chain, step=0.1, stop=1.0, algorithm="halving", isolate=False)
    fine = simulate(chain, step=0.05, stop=1.0, algorithm="jacobi", isolate=False)
    coarse = simulate(chain, step=0.1, stop=1.0, algorithm="jacobi", isolate=False)
    assert halved.summary["algorithm"] == "halving"
    for name in ("r.y", "g.y"):
        np.testing.assert_allclose(halved[name][1:], fine[name][2::2], rtol=1e-14)
    assert np.abs(halved["g.y"] - coarse["g.y"]).max() > 0.01


@pytest.mark.heavy
def test_commands_and_scenarios_know_it(toy, tmp_path):
    code = f"import sys\nfrom vdfmu.engine.algorithms import ALGORITHMS, Algorithm\n{ROW}\n" + (
        "from vdfmu.cli.commands import app\napp(sys.argv[1:], standalone_mode=False)"
    )

    def command(*arguments):
        return subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, cwd=tmp_path)

    assert "halving" in command("run", "--help").stdout
    wrong = command("run", "planar_tracking", "--master", "halve")
    assert "extrapolated, iterative or halving" in wrong.stderr + str(wrong.stdout)
    out = command("run", "planar_tracking", "--master", "halving", "--stop", "0.02", "--quiet")
    assert out.returncode == 0, out.stderr
