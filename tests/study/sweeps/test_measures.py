"""What a run is judged by."""

import os
import subprocess
import sys
from functools import partial

import numpy as np
import pytest

from vdfmu.base.errors import UsageError
from vdfmu.engine.results.results import Results, Signal
from vdfmu.study.sweeps.digest import value_digest
from vdfmu.study.sweeps.measures import read_measures

T = np.linspace(0.0, 2.0, 201)
Q = np.column_stack([np.sin(T), 0.5 * T])
D = np.column_stack([np.cos(T), T])


@pytest.fixture(scope="module")
def results():
    names = ["plant.q[1]", "plant.q[2]", "motion.q_d[1]", "motion.q_d[2]", "inner.part.x"]
    signals = [Signal(name, "real", "rad", i) for i, name in enumerate(names)]
    return Results(T, signals, {"real": np.column_stack([Q, D, 1.0 - np.exp(-3.0 * T)])})


@pytest.mark.parametrize(("text", "value"), [
    ("rms(motion.q_d - plant.q)", np.sqrt(np.mean((D - Q) ** 2, axis=0))),
    ("peak(plant.q[1])", np.sin(T).max()),
    ("max(plant.q) - min(plant.q)", np.ptp(Q, axis=0)),
    ("worst(final(abs(plant.q)))", max(abs(np.sin(2.0)), 1.0)),
    ("sum(mean(plant.q))", Q.mean(axis=0).sum()),
    ("max(norm(plant.q))", np.linalg.norm(Q, axis=1).max()),
    ("integral(plant.q[2])", 1.0),  # the trapezoidal rule is exact for lines
    ("at(plant.q[2], 0.5)", 0.25),
    ("first(motion.q_d[1]) ** 2 + 2", 3.0),
    ("mean(plant.q[2] > 0.5)", np.mean(0.5 * T > 0.5)),
    ("degrees(final(plant.q[2]))", 180.0 / np.pi),
    ("std(plant.q)", Q.std(axis=0)),
    ("-least(final(plant.q))", -min(np.sin(2.0), 1.0)),
    ("rms(plant.q - final(plant.q))", np.sqrt(np.mean((Q - Q[-1]) ** 2, axis=0))),
])  # fmt: skip
def test_values(results, text, value):
    measured = read_measures([f"m={text}"])[0].of(results)
    names = ["m"] if np.ndim(value) == 0 else ["m[1]", "m[2]"]
    assert list(measured) == names
    np.testing.assert_allclose(list(measured.values()), np.atleast_1d(value), rtol=1e-12)  # rounding of sums of 201


def test_settling_is_when_a_signal_stays_near_its_end_and_a_function_is_called_with_the_results(results):
    settled = read_measures(["m=settling(inner.part.x, 0.05)"])[0].of(results)["m"]
    x = 1.0 - np.exp(-3.0 * T)
    inside = np.abs(x - x[-1]) <= 0.05
    assert settled == T[inside.argmax()]
    measure = read_measures({"rows": len})[0]
    assert measure.of(results) == {"rows": 201.0}


@pytest.mark.parametrize(("text", "words"), [
    ("peak(inner.part.x / norm(inner.part.x))", "several elements in norm, got inner.part.x"),
    ("worst(rms(inner.part.x))", r"several elements in worst, got rms\(inner.part.x\)"),
    ("settling(plant.q, -1)", "expected a band above 0, got -1"),
    ("9**9**9**9 * rms(plant.q[1])", "OverflowError"),  # as a whole number it has more digits than memory
])  # fmt: skip
def test_functions_refuse_signals_that_they_are_not_for(results, text, words):
    with pytest.raises(UsageError, match=words):
        read_measures([f"m={text}"])[0].of(results)


def test_signals_are_named_for_the_record():
    assert read_measures(["m=rms(a.b.c - d.e[1,2]) + peak(a.b.c)"])[0].signals == ("a.b.c", "d.e[1,2]")


REFUSED = {
    "one value for all times": ["m=plant.q", "m=abs(plant.q)"],
    "expected a signal": ["m=1 + 2"],
    "was never closed|got rms": ["m=rms(plant.q"],
    "expected a known function, got": ["m=open('x')", "m=rms(__import__('os'))"],
    r'got mini\. Did you mean "min"\? There are: rms, ': ["m=mini(a.y)"],
    r"expected a signal over time in rms, got rms\(plant.q\)": ["m=rms(rms(plant.q))"],
    "expected a number after the signal of at, got plant.q": ["m=at(plant.q, plant.q)"],
    "a shorter expression": [f"m=rms(plant.q){n * ' + 0'}" for n in (600, 3000)],
    "expected signals, numbers and functions": [
        "m=rms(plant.q.__class__())", "m=rms(plant.q[x])", "m=rms([1, 2])", "m=rms('text')",
    ],
    "expected 1 arguments of rms, got 2": ["m=rms(plant.q, 3)"],
    "expected 2 arguments of at, got 1": ["m=at(plant.q)"],
    "expected 1 to 2 arguments of settling, got 3": ["m=settling(plant.q, 1, 2)"],
    "expected NAME=EXPRESSION": ["rms(plant.q)"],
    "expected another name": ["failed=rms(plant.q)", "step=rms(plant.q)"],
}  # fmt: skip


@pytest.mark.parametrize("words", REFUSED)
def test_what_is_no_measure_is_said(words):
    for text in REFUSED[words]:
        with pytest.raises(UsageError, match=words):
            read_measures([text])


def test_a_measure_is_there_once():
    with pytest.raises(UsageError, match="measure m: expected once"):
        read_measures(["m=peak(a.b)", "m=rms(a.b)"])


class Asked:
    """A measure that is an object."""

    def __init__(self, least):
        self.least = least

    def __call__(self, results):
        """Return what it keeps."""
        return self.least

    def less(self, results):
        """Return its negative."""
        return -self.least


class Again(Asked):
    """The same values, and other code."""

    def __call__(self, results):
        """Return the double."""
        return 2.0 * self.least


def test_the_digest_of_an_object_or_a_partial_function_has_its_code_and_its_values():
    def power(results, exponent):
        return len(results) ** exponent

    def product(results, exponent):
        return len(results) * exponent

    makers = [
        lambda: Asked(1.0), lambda: Asked(2.0), lambda: Again(1.0), lambda: Asked(1.0).less, lambda: Asked(2.0).less,
        lambda: partial(power, exponent=2), lambda: partial(power, exponent=3), lambda: partial(product, exponent=2),
        lambda: partial(Asked(1.0)), lambda: np.max, lambda: np.min,
    ]  # fmt: skip
    digests = [value_digest(make()) for make in makers]
    assert len(set(digests)) == len(digests)
    assert digests == [value_digest(make()) for make in makers]


def made(source, **names):
    """Return the function `measure` of a script, with its globals."""
    exec(compile(source, "script.py", "exec"), names)
    return names["measure"]


HELPED = "def helper(x): return {scale} * x\ndef measure(results): return helper(len(results)) + K"


@pytest.mark.parametrize(("first", "second"), [
    (made(HELPED.format(scale=2), K=1), made(HELPED.format(scale=2), K=2)),
    (made(HELPED.format(scale=2), K=1), made(HELPED.format(scale=3), K=1)),
    (made("measure = lambda r, *, a=1: a"), made("measure = lambda r, *, a=2: a")),
    (made("def f(g):\n  return lambda r: g(r)\nmeasure = f(lambda r: 1)"),
     made("def f(g):\n  return lambda r: g(r)\nmeasure = f(lambda r: 2)")),
    (made("measure = lambda r: T[0](r)", T=[made("measure = len")]), made("measure = lambda r: T[0](r)", T=[max])),
    (made("class A:\n  def f(self): return 1\na = A()\nmeasure = lambda r: a.f()"),
     made("class A:\n  def f(self): return 2\na = A()\nmeasure = lambda r: a.f()")),
], ids=["global", "helper", "keyword", "closure", "list", "class"])  # fmt: skip
def test_the_digest_has_what_a_function_refers_to(first, second):
    assert value_digest(first) != value_digest(second)
    assert value_digest(first) == value_digest(first)


def test_the_digest_is_that_of_another_process(tmp_path):
    """Whatever the order of sets, and whether two equal values are one object."""
    script = tmp_path / "script.py"
    script.write_text(
        "from vdfmu.study.sweeps.digest import value_digest\nimport numpy as np\n"
        "a = [1.5, 'x']; K = {'a': a, 'b': a if SAME else [1.5, 'x']}\n"
        "def again(n): return n and again(n - 1)\n"
        "def measure(r): return again(1) if r in {'one', 'two', 'three'} else K['a'][0] * np.max(r)\n"
        "print(value_digest(measure))\n"
    )
    digests = {
        subprocess.run(
            [sys.executable, "-c", f"SAME = {same}\nexec(open({str(script)!r}).read())"], check=True,
            capture_output=True, text=True, env={**os.environ, "PYTHONHASHSEED": str(seed)},
        ).stdout
        for seed, same in ((1, True), (2, False))
    }  # fmt: skip
    assert len(digests) == 1
