"""`judge`: against closed forms, sampled laws, and systems that it must not decide."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import vdfmu
from vdfmu.arm.units import find_unit
from vdfmu.base.errors import UsageError
from vdfmu.base.files import data_path
from vdfmu.study.referee import OPEN, RIGHT, WRONG, differences, error_of, judge, verdict_of
from vdfmu.unit import Input, Output, Parameter, Unit

Lag = find_unit(data_path("examples") / "units" / "low_pass.py")


class Gain(Unit):
    """Proportional law ``y = K (r - u)``."""

    u = Input("1", text="signal")
    K = Parameter("1", text="gain", start=2.0)
    y = Output("1", text="law")

    def outputs(self) -> None:
        """Law."""
        self.y = self.K * (1.0 - self.u)


@pytest.fixture(scope="module")
def lags() -> vdfmu.System:
    return vdfmu.connect({"a": Lag, "b": Lag, "c": Lag}, {"a.y": "b.u", "b.y": "c.u"}, stop=1.0, values={"a.u": 1.0})


@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi", "extrapolated", "iterative"])
@pytest.mark.parametrize("step", [0.05, 0.02, 0.005])
def test_the_estimate_is_the_error_of_a_closed_form(lags, algorithm, step):
    judged = lags.judge(0.01, step=step, algorithm=algorithm)
    results = lags.run(step=step, algorithm=algorithm)
    x = results.time / 0.1
    exact = {"b.y": 1.0 - np.exp(-x) * (1.0 + x), "c.y": 1.0 - np.exp(-x) * (1.0 + x + 0.5 * x * x)}
    true = {name: np.abs(results[name] - y).max() / np.abs(y).max() for name, y in exact.items()}
    estimated = {signal.name: signal.error for signal in judged.signals}
    for name, error in true.items():  # the rule promises a factor of 2
        assert 0.5 < estimated[name] / error < 2.0
    assert judged.signal == max(true, key=true.__getitem__)
    if judged.verdict == RIGHT:
        assert max(true.values()) <= 0.01
    if judged.verdict == WRONG:
        assert max(true.values()) > 0.01


def test_the_step_that_it_advises_is_right(lags):
    judged = lags.judge(0.001, step=0.05)
    assert judged.verdict == WRONG
    assert str(judged).startswith("Not right: about 16 % at c.y (step 50 ms; wanted 0.1 %). Iterative, or a step of ")
    advised = float(str(judged).partition("a step of ")[2].split()[0]) * 1e-3
    assert lags.judge(0.001, step=advised).verdict == RIGHT


def test_a_period_that_is_declared_is_kept(tmp_path):
    """The law keeps its step, so nothing is left; as continuous it is off by its delay."""
    system = vdfmu.connect({"law": Gain, "plant": Lag}, {"law.y": "plant.u", "plant.y": "law.u"}, stop=0.5)
    continuous = system.judge(0.001, step=0.005, algorithm="jacobi")
    assert continuous.verdict == WRONG
    package = system.write(tmp_path / "loop.ssp")
    flat = vdfmu.load_ssp(package)
    parts = tuple(replace(each, step=0.005) if each.name == "law" else each for each in flat.components)
    sampled = judge(replace(flat, components=parts), 0.001, step=0.005, algorithm="gauss-seidel")
    assert "law samples every 5 ms, which is kept." in sampled.text
    assert sampled.error < 1e-5  # held inputs over whole steps of the plant: exact but for its solver's 1e-6


def test_a_system_that_leaves_its_order_is_not_decided():
    system = vdfmu.load("planar_tracking")
    judged = system.judge(0.01, stop=0.2, step=0.02)
    assert judged.verdict == OPEN
    assert "The loop at plant.tau" in judged.text


def test_the_rule():
    # order 1, half as large each time: differences 4 and 2 of 101, an error of 8
    d1, d2, row = differences([np.array([[0.0], [100.0 + off]]) for off in (7.0, 3.0, 1.0)])
    assert (error_of(d1[0], 1), d2[0] / d1[0], row[0]) == (pytest.approx(8 / 101), pytest.approx(0.5), 1)
    assert verdict_of(d1, d2, 1, 0.2) == RIGHT
    assert verdict_of(d1, d2, 1, 0.1) == OPEN
    assert verdict_of(d1, d2, 1, 0.04) == WRONG
    assert verdict_of(d1, 0.05 * d1, 1, 0.2) == OPEN  # luck, not order
    assert verdict_of(d1 / 100, d1 / 2000, 1, 0.2) == RIGHT  # too small to matter
    assert verdict_of(np.zeros(1), np.full(1, 1e-4), 1, 0.01) == RIGHT
    # a signal near 0 in a vector counts by the vector
    assert differences([np.array([[1.0, off]]) for off in (1e-9, 0.0, 0.0)], ["v", "v"])[0][1] == pytest.approx(1e-3)


@pytest.mark.parametrize(("options", "text"), [
    ({"wanted": 1.0}, "wanted must be an error between 0 and 1"),
    ({"meant": "both"}, "meant must be sampled or continuous"),
    ({"adaptive": 1e-3, "algorithm": "iterative"}, "judge compares fixed steps"),
])  # fmt: skip
def test_wrong_calls(lags, options, text):
    with pytest.raises(UsageError, match=text):
        lags.judge(step=0.01, **options)


def test_one_component_has_no_such_error():
    with pytest.raises(UsageError, match="judge needs connected signals, got none"):
        vdfmu.connect({"a": Lag}, stop=1.0, step=0.1).judge()
