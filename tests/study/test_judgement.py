"""`judge`: against closed forms, sampled laws, and systems that it must not decide."""

import re
from dataclasses import replace
from html import unescape

import numpy as np
import pytest

import vdfmu
from benchmarks.judge_units import Step
from tests.conftest import heavy, invoked, ran, refused
from vdfmu.arm.units import find_unit
from vdfmu.base.errors import UsageError
from vdfmu.base.files import data_path
from vdfmu.engine.algorithms import ALGORITHMS, Algorithm
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.results.verdict import checks_of
from vdfmu.study.coupling_error import KINDS, OPEN, RIGHT, WRONG, differences, error_of, kind_of, verdict_of
from vdfmu.study.judgement import judge
from vdfmu.study.report.sheets import facts
from vdfmu.study.run.summary_keys import read_summary
from vdfmu.unit import Derivative, Input, Output, Parameter, State, Unit, where

Lag = find_unit(data_path("examples") / "units" / "low_pass.py")


class Gain(Unit):
    """Proportional law ``y = K (r - u)``."""

    u = Input("1", text="signal")
    K = Parameter("1", text="gain", start=2.0)
    y = Output("1", text="law")

    def outputs(self) -> None:
        """Law."""
        self.y = self.K * (1.0 - self.u)


class Switch(Unit):
    """Full heat below 0.5."""

    u = Input("1", text="signal")
    y = Output("1", text="heat")

    def outputs(self) -> None:
        """Switch."""
        self.y = where(self.u < 0.5, 1.0, 0.0)


class Fast(Unit):
    """A signal that is above the rate of steps of 20 ms: a tone, or pulses if `duty` is not 0."""

    y = Output("1", text="signal")
    f = Parameter("1", text="frequency", start=400.0)
    duty = Parameter("1", text="share of a period", start=0.2)

    def outputs(self) -> None:
        """Tone, or pulses."""
        turns = self.f * self.t
        pulse = where(turns - np.floor(turns + 1e-9) < self.duty, 1.0, 0.0)
        self.y = where(self.duty > 0.0, pulse, np.cos(2.0 * np.pi * turns))


class Rated(Unit):
    """A lag with its rate as a second output."""

    u, y = Input("1", text="signal"), State("1", text="lag")
    y_dot, rate = Derivative(y), Output("1", text="rate")

    def derivatives(self) -> None:
        """Lag of 0.1 s."""
        self.y_dot = 10.0 * (self.u - self.y)

    def outputs(self) -> None:
        """Rate."""
        self.rate = 10.0 * (self.u - self.y)


@pytest.fixture(scope="module")
def lags() -> vdfmu.System:
    return vdfmu.connect(
        {"a": Lag, "b": Lag, "c": Lag}, {"a.y": "b.u", "b.y": "c.u"}, stop=1.0, parameters={"a.u": 1.0}
    )


def require_estimates(lags, step, algorithm):
    """Raise unless the estimates of a judgement are the errors to the closed form."""
    judged = lags.judge(0.01, step=step, algorithm=algorithm)
    results = lags.run(step=step, algorithm=algorithm)
    x = results.time / 0.1
    exact = {"b.y": 1.0 - np.exp(-x) * (1.0 + x), "c.y": 1.0 - np.exp(-x) * (1.0 + x + 0.5 * x * x)}
    true = {name: np.abs(results[name] - y).max() / np.ptp(y) for name, y in exact.items()}
    estimated = {signal.name: signal.error for signal in judged.signals}
    for name, error in true.items():  # the rule promises a factor of 2
        assert 0.5 < estimated[name] / error < 2.0
    assert judged.signal == max(true, key=true.__getitem__)
    if judged.verdict == RIGHT:
        assert max(true.values()) <= 0.01
    if judged.verdict == WRONG:
        assert max(true.values()) > 0.01


@pytest.mark.few(2)
@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi", "extrapolated", "iterative"])
@pytest.mark.parametrize("step", [0.05, 0.02, 0.005])
def test_the_estimate_is_the_error_of_a_closed_form(lags, algorithm, step):
    require_estimates(lags, step, algorithm)


def test_the_step_that_it_advises_is_right(lags):
    judged = lags.judge(0.001, step=0.05)
    assert judged.verdict == WRONG
    assert str(judged).startswith(
        "Not right: about 16 % of the range of c.y (step 50 ms; allowed 0.1 %). Iterative, or"
    )
    advised = float(str(judged).partition("a step of ")[2].split()[0]) * 1e-3
    assert lags.judge(0.001, step=advised).verdict == RIGHT


def test_a_period_that_is_declared_is_kept(tmp_path):
    """The law keeps its step, so nothing is left; as continuous it is off by its delay."""
    system = vdfmu.connect({"law": Gain, "plant": Lag}, {"law.y": "plant.u", "plant.y": "law.u"}, stop=0.5)
    continuous = system.judge(0.001, step=0.005, algorithm="jacobi", sampled=False)
    assert continuous.verdict == WRONG
    package = system.write(tmp_path / "loop.ssp")
    flat = load_ssp(package)
    parts = tuple(replace(each, step=0.005) if each.name == "law" else each for each in flat.components)
    sampled = judge(replace(flat, components=parts), 0.001, step=0.005, algorithm="gauss-seidel")
    assert "Kept periods: law 5 ms." in sampled.text
    assert sampled.error < 1e-5  # held inputs over whole steps of the plant: exact but for its solver's 1e-6


def test_two_equal_verdicts_of_a_law_without_a_period_are_the_verdict():
    """A continuous master says that it is continuous, and a step is a period."""
    system = vdfmu.connect({"law": Gain, "plant": Lag}, {"law.y": "plant.u", "plant.y": "law.u"}, stop=0.5)

    def readings(wanted):
        return [system.judge(wanted, step=1e-3, sampled=sampled) for sampled in (True, False, None)]

    held, continuous, both = readings(0.1)
    assert [held.verdict, continuous.verdict, both.verdict] == [RIGHT] * 3
    assert held.error < 1e-5 < continuous.error == both.error  # the period is kept; the worse counts
    same = "The verdict is the same with law sampled every 1 ms or continuous; the other error is"
    assert both.text == f"{continuous} {same} {100 * held.error:.2g} %."
    held, continuous, both = readings(0.001)
    assert [held.verdict, continuous.verdict, both.verdict, both.kind] == [RIGHT, WRONG, OPEN, "period"]
    assert both.text == (
        f"Not decided: no period is declared for law. Sampled every 1 ms: {held} Continuous: {continuous} Choose "
        "--sampled or --continuous."
    )
    assert system.judge(0.1, step=1e-3, algorithm="iterative").verdict == RIGHT


@pytest.mark.few(1)
@pytest.mark.parametrize("sampled", [True, False])
def test_a_unit_declares_whether_it_is_sampled(sampled):
    """In its class, and so in its FMU, which then needs no option."""
    law = type("Law", (Gain,), {"sampled": sampled, "__module__": __name__})
    system = vdfmu.connect({"law": law, "plant": Lag}, {"law.y": "plant.u", "plant.y": "law.u"}, stop=0.5, step=1e-3)
    undeclared = vdfmu.connect({"law": Gain, "plant": Lag}, {"law.y": "plant.u", "plant.y": "law.u"}, stop=0.5)
    for algorithm in ("gauss-seidel", "jacobi"):
        judged = system.judge(0.001, algorithm=algorithm)
        assert judged.verdict == (RIGHT if sampled else WRONG)
        assert str(judged) == str(undeclared.judge(0.001, step=1e-3, algorithm=algorithm, sampled=sampled))


@pytest.mark.parametrize("name", ["planar_tracking", *heavy("tracking")])
def test_shipped_scenarios_are_decided(name):
    """Controller and feedforward are sampled at 1 kHz, plant and motion are continuous."""
    judged = vdfmu.load(name).judge(0.01, stop=0.1)
    assert judged.verdict == RIGHT
    assert judged.text.endswith("Kept periods: feedforward 1 ms, controller 1 ms.")


def test_a_signal_that_jumps_is_named_and_the_largest_error_without_jumps():
    system = vdfmu.connect({"switch": Switch, "plant": Lag}, {"switch.y": "plant.u", "plant.y": "switch.u"}, stop=0.5)
    judged = system.judge(0.01, step=0.002, sampled=False)
    assert judged.verdict == OPEN
    assert (judged.kind, judged.signal) == ("jumps", "switch.y")
    assert judged.text.startswith("Not decided: switch.y jumps at communication points")


def test_a_run_says_what_judge_says(tmp_path, lags):
    """Summary, verdict and page of a scenario; summary and exit code of a package."""
    results = vdfmu.run("planar_tracking", stop=0.1, judge=0.02, sampled=False, reference=False, out=tmp_path)
    judgement = read_summary(tmp_path / "summary.json")["judgement"]
    expected = vdfmu.load("planar_tracking").judge(0.02, stop=0.1, sampled=False)
    assert (judgement["verdict"], judgement["text"]) == (expected.verdict, expected.text)
    state = {RIGHT: "good", WRONG: "failed", OPEN: "doubtful"}[expected.verdict]
    sentence, _, more = expected.text.replace("Right to", "coupling error").partition(". ")
    assert ("Coupling error", state, sentence, more) in [each[1:5] for each in checks_of(results.summary)]
    assert expected.text in unescape((tmp_path / "report.html").read_text(encoding="utf-8"))
    package = str(lags.write(tmp_path / "lags.ssp"))
    for wanted, code, said, headline in (
        ("1%", 0, RIGHT, "Good: coupling error"),
        ("1e-4", 1, WRONG, "Failed: coupling error about"),
    ):
        ran("run", package, "--judge", wanted, "--out", tmp_path / "out", code=code)
        summary = read_summary(tmp_path / "out" / "summary.json")
        assert summary["judgement"]["verdict"] == said
        assert summary["verdict"]["headline"].startswith(headline)  # the state is said once
        assert ("Coupling", summary["judgement"]["text"]) in facts(summary)


def test_the_judged_run_begins_and_ends_as_the_run_does(tmp_path, lags):
    package, out = str(lags.write(tmp_path / "lags.ssp")), tmp_path / "out"
    result = invoked("run", package, "--start", "1", "--stop", "2", "--judge", "5", "--out", out)
    assert result.exit_code != 2, result.output
    judgement = read_summary(out / "summary.json")["judgement"]
    assert all(1.0 <= signal["time"] <= 2.0 for signal in judgement["signals"])


@pytest.mark.parametrize(
    ("options", "said"),
    [(["--judge", "200"], "must be between 0 and 100 %"), (["--sampled"], "sampled and continuous need judge"),
     (["--judge", "1", "--adaptive", "1e-3", "--algorithm", "iterative"], "got adaptive")],
)  # fmt: skip
@pytest.mark.parametrize("of", ["planar_tracking", "package"])
def test_options_of_the_judgement_are_refused_before_a_run(tmp_path, lags, of, options, said):
    source = of if of != "package" else str(lags.write(tmp_path / "lags.ssp"))
    assert said in refused("run", source, *options, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


class Lead(Unit):
    """A lag of 0.1 s with a gain, from 1 on."""

    sampled = False
    y = State("1")
    y_dot = Derivative(y)
    u, y_0, k = Input("1"), Parameter("1", start=1.0), Parameter("1")
    shown = Output("1")

    def derivatives(self) -> None:
        """Follow the input."""
        self.y_dot = 10.0 * (self.k * self.u - self.y)

    def outputs(self) -> None:
        """Show the state."""
        self.shown = self.y


@pytest.mark.few(1)
@pytest.mark.parametrize(("k", "kind"), [(3.0, "coarse"), (10.0, "growth")])
def test_a_loop_that_leaves_its_order_is_not_decided_and_its_radius_is_named(k, kind):
    """Two lags with gains k and -k: stable in continuous time, and not if they exchange every 20 ms."""
    links = {"a.shown": "b.u", "b.shown": "a.u"}
    judged = vdfmu.connect({"a": Lead, "b": Lead}, links, parameters={"a.k": -k, "b.k": k}).judge(
        0.01, stop=1.0, step=0.02
    )
    assert (judged.verdict, judged.kind) == (OPEN, kind)
    assert re.search(r"The loop at [ab]\.u", judged.text), judged.text


def test_an_algorithm_of_a_plugin_is_judged_by_the_order_that_it_declares(lags, monkeypatch):
    row = Algorithm(ALGORITHMS["jacobi"].stepper)
    monkeypatch.setitem(ALGORITHMS, "of a plugin", row)
    judged = lags.judge(0.01, step=0.02, algorithm="of a plugin")
    assert judged.kind == "order" and "declares no order. Declare declared_order" in judged.text
    monkeypatch.setitem(ALGORITHMS, "of a plugin", replace(row, declared_order=1))
    require_estimates(lags, 0.02, "of a plugin")
    assert lags.judge(0.1, step=0.02, algorithm="of a plugin").right


def test_the_rule():
    # order 1, half as large each time: differences 4 and 2 of 101, an error of 8
    seen = differences(
        [np.linspace(0.0, 100.0 + off, 8 * 2**k + 1)[:, None] for k, off in enumerate((7, 3, 1))], ["a.y"]
    )
    d1, d2 = seen.d1, seen.d2
    assert (error_of(d1[0], 1), d2[0] / d1[0], seen.row[0]) == (pytest.approx(8 / 101), pytest.approx(0.5), 8)

    def verdict(d1, d2, order, wanted):
        return verdict_of(seen._replace(d1=d1, d2=d2), order, wanted)

    assert verdict(d1, d2, 1, 0.2) == RIGHT
    assert verdict(d1, d2, 1, 0.1) == OPEN
    assert verdict(d1, d2, 1, 0.04) == WRONG
    assert verdict(d1, 0.05 * d1, 1, 0.2) == OPEN  # luck, not order
    assert verdict(d1, 0.05 * d1, 2, 0.2) == RIGHT  # an error at the first point of the longest step
    assert verdict(d1, 0.5 * d1, 2, 0.2) == OPEN
    assert verdict(d1 / 100, d1 / 2000, 1, 0.2) == RIGHT  # too small to matter
    assert verdict(np.zeros(1), np.full(1, 1e-4), 1, 0.01) == RIGHT
    # a signal near 0 in a vector counts by the vector: here 1e-9 of 1e-6 times the swing of v[1]
    assert differences([np.array([[1.0, off], [0.0, 0.0]]) for off in (1e-9, 0.0, 0.0)], ["v[1]", "v[2]"]).d1[
        1
    ] == pytest.approx(1e-3)


def test_jumps_that_no_difference_shows():
    """A step in the last quarter before a point: all runs see it there. It is 0.0048 s late, in a lag of 0.1 s."""
    system = vdfmu.connect({"step": Step, "lag": Lag}, {"step.y": "lag.u"}, stop=0.5, parameters={"step.at": 0.0952})
    judged = system.judge(0.01, step=0.02, algorithm="jacobi")
    assert judged.error < 1e-3 < 0.01 < 1.0 - np.exp(-0.048)  # largest when the late step comes
    assert judged.verdict == OPEN
    assert judged.text.startswith(
        "Not decided: step.y jumps at communication points (step 20 ms; allowed 1 %). A jump "
    )
    t = np.linspace(0.0, 1.0, 33)
    runs = [np.column_stack([t >= 0.5, np.maximum(t - 0.5, 0.0)])[:: 4 // 2**k].astype(float) for k in range(3)]
    seen = differences(runs, ["a.y", "b.y"])
    assert (seen.d1.max(), seen.d2.max(), list(seen.jumps)) == (0.0, 0.0, [1, 0])
    assert seen.late == pytest.approx(1 / 16)  # b.y changes by 1/32 of 0.5 a step; it bends at the jump of a.y
    assert [verdict_of(seen, 1, wanted) for wanted in (0.1, 0.09)] == [RIGHT, OPEN]
    assert differences(runs, ["a.y", "b.y"], ["a"]).late == 0.0  # samples at declared times


def test_signals_that_nothing_moves_show_nothing():
    system = vdfmu.connect({"a": Lag, "b": Lag}, {"a.y": "b.u"}, stop=1.0)
    assert system.judge(step=0.1).text.startswith("Not decided: no connected signal changes.")


@pytest.mark.few(1)
@pytest.mark.parametrize("values", [{"fast.f": 400.0}, {"fast.f": 200.0, "fast.duty": 0.0}])
def test_a_signal_above_the_rate_of_the_steps_is_an_alias(values):
    """Pulses at 8 / h and a tone at 4 / h have whole periods in h, h/2 and h/4, so three runs see constants.

    Of the pulses the lag takes 1 where 0.2 is their mean; of the tone 1 where it is 0. A run with 8 h / 13 does not. A
    slow tone is no alias.
    """
    system = vdfmu.connect({"fast": Fast, "lag": Lag}, {"fast.y": "lag.u"}, stop=0.96)
    judged = system.judge(0.05, step=0.02, parameters=values)
    assert judged.error < 1e-3 and (judged.verdict, judged.kind, judged.signal) == (OPEN, "alias", "lag.y")
    slow = system.judge(0.05, step=0.002, parameters={"fast.f": 1.0, "fast.duty": 0.0})
    assert slow.verdict == RIGHT and "Aliasing" not in slow.text


def test_it_says_where_no_run_can_look_for_aliases(lags):
    assert lags.judge(0.9, stop=0.07, step=0.01).text.endswith(
        "Aliasing is not tested: the run has fewer than 8 steps."
    )


def test_outputs_that_nothing_reads_are_judged():
    """Two lags in a loop, of 0.1 s, held over h: errors of the rate are larger than those of the lags by h's lead."""
    system = vdfmu.connect({"a": Rated, "b": Rated}, {"a.y": "b.u", "b.y": "a.u"}, stop=0.5, parameters={"a.y_0": 1.0})
    judged = system.judge(0.5, step=0.005, algorithm="jacobi")
    errors = {signal.name: (signal.error, signal.read) for signal in judged.signals}
    assert {name for name, (_, read) in errors.items() if read} == {"a.y", "b.y"}
    lags, rates = (max(errors[f"{c}.{v}"][0] for c in "ab") for v in ("y", "rate"))
    assert lags < rates
    assert judged.verdict == RIGHT and " Unread output " in judged.text
    between = (lags * rates) ** 0.5  # 1.5 times apart from both
    assert rates > 1.5**2 * 1.1 * lags
    judged = system.judge(between, step=0.005, algorithm="jacobi")
    assert judged.verdict == WRONG and "an output that no component reads" in judged.text


@pytest.mark.parametrize(("kind", "signal"), [
    ("growth", lambda t, h: np.exp(20.0 * t * (1.0 - h))),
    ("quantised", lambda t, h: np.floor(7.0 * np.sin(6.0 * t - h)) / 7.0),
    ("jumps", lambda t, h: np.where(np.sin(9.0 * t - h) > 0.0, 1.0, 0.0)),
    ("delay", lambda t, h: np.sin(9.0 * t - (h > 0.01) * 0.2 - (h == 0.01) * 0.4)),
    ("bistable", lambda t, h: (-1.0 if h == 0.01 else 1.0) * np.minimum(1.0, t**4)),
    ("chaos", lambda t, h: np.sin(9.0 * t) + np.sin(70.0 * h * t**3 + 5.0 * t)),
    ("fast", lambda t, h: np.random.default_rng(int(1e6 * h)).normal(size=len(t))),
    ("coarse", lambda t, h: np.sin(9.0 * t) + 8.0 * h * np.cos(31.0 * t) * np.cos(400.0 * h)),
])  # fmt: skip
def test_what_is_met_is_named(kind, signal):
    """Each by its signal at the steps h = 20, 10 and 5 ms."""
    runs = [signal(np.linspace(0.0, 1.6, 80 * 2**k + 1), 0.02 / 2**k)[:, None].astype(float) for k in range(3)]
    seen = differences(runs, ["a.y"])
    assert kind_of(runs, seen, np.ones(1, bool), np.zeros(1, bool)) == (kind, 0)
    sentence = f"Not decided: {KINDS[kind].met.format(signal='feedforward.tau_m[6]')} (step 1 ms; allowed 0.1 %)"
    assert len(sentence) <= 120


def test_the_scale_is_the_swing_of_a_signal():
    """Two rooms in kelvin: an error of 0.46 K is 31 % of a range of 1.48 K, not 0.16 % of 294 K."""
    t = np.linspace(0.0, 1.0, 33)
    runs = [(293.0 + 1.48 * t + off * t)[:: 4 // 2**k, None] for k, off in enumerate((0.46, 0.23, 0.115))]
    seen = differences(runs, ["room.T"])
    assert error_of(seen.d1[0], 1) == pytest.approx(0.46 / (1.48 + 0.115))
    assert verdict_of(seen, 1, 0.01) == WRONG
    constant = differences(
        [run * 0.0 + 293.0 + off for run, off in zip(runs, (0.3, 0.2, 0.1), strict=True)], ["room.T"]
    )
    assert constant.d1[0] == pytest.approx(0.1 / 293.1) and constant.constant[0]


def test_one_component_has_no_such_error():
    with pytest.raises(UsageError, match="judge needs connected signals, got none"):
        vdfmu.connect({"a": Lag}, stop=1.0, step=0.1).judge()
