"""What cannot be traced, and methods that are wrong: each error has file, line, reason and fix."""

import inspect
import math
import os
import re
from contextlib import suppress
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from scipy import special

from vdfmu.base.errors import UnitError
from vdfmu.compiler.unit.evaluate import Plain, Traced, evaluation
from vdfmu.compiler.unit.interface import Interface
from vdfmu.unit import Choice, Derivative, Input, Output, State, Unit, where

HERE = Path(os.path.relpath(__file__)) if Path(__file__).is_relative_to(Path.cwd()) else Path(__file__)


class Bad(Unit):
    """Base of units that cannot be traced."""

    u = Input("1", 3)
    y = Output("1")


def branch(self):
    self.y = 0.0
    if self.u[0] > 0.0:  # here
        self.y = 1.0


def converging(self):
    root = 1.0
    while abs(root * root - self.u[1]) > 1e-6:  # here
        root = 0.5 * (root + self.u[1] / root)
        if root > 1e6:
            break
    self.y = root


def solved(self):
    """Call numpy's solver on ordinary arrays, which numpy does not hand on to symbols."""
    a, b = self.u[0], self.u[1]
    self.y = np.linalg.solve(np.array([[1.0 + a * a, b], [b, 1.0]]), np.array([a, b]))[0]  # here


def eigenvalues(self):
    self.y = np.linalg.eigvalsh(np.outer(self.u, self.u))[2]  # here


def of_scipy(self):
    self.y = special.expit(self.u)[0]  # here


def of_math(self):
    self.y = math.sin(self.u[0])  # here


def largest(self):
    self.y = max(self.u[0], 0.0)  # here


def equal(self):
    self.y = where(self.u[0] == 0.0, 1.0, 0.0)  # here


def spacing(self):
    self.y = np.spacing(self.u[0])  # here


def interpolated(self):
    self.y = np.interp(self.u[0], [0.0, 1.0], [0.0, 2.0])  # here


def cast(self):
    values = np.zeros(2)
    values[0] = self.u[0]  # here
    self.y = values[0]


UNTRACEABLE = {  # the words of the refusal, and what Python gives, if that is known
    branch: ("a condition on a value is not known", 1.0),
    converging: ("a condition on a value is not known", 2.0),
    solved: ("Cannot cast ufunc 'solve1?' input 0 from dtype", 15.5 / 14.75),
    of_scipy: ("ufunc 'expit' not supported for the input types", None),
    of_math: ("has no value while equations are traced", None),
    largest: ("a condition on a value is not known", 0.5),
    equal: ("a condition on a value is not known", 0.0),
    eigenvalues: ("eigvalsh of numpy does not accept symbols: ", None),
    spacing: ("np.spacing does not accept symbols: ufunc 'spacing' not supported", None),
    interpolated: ("of vdfmu.unit, interpolate for tables", None),
    cast: (r"zeros\(shape, \*like\) for an array that receives it", 0.5),
}


def bad(method, **more):
    return type("Wrong", (Bad,), {"outputs": method, "__module__": __name__, **more})


def line_here(function):
    """Return the line of a function that is marked."""
    lines, first = inspect.getsourcelines(function)
    (line,) = (first + i for i, text in enumerate(lines) if text.rstrip().endswith("# here"))
    return line


@pytest.mark.parametrize("method", UNTRACEABLE)
def test_what_cannot_be_traced_says_where_why_and_the_fix(method):
    reason, expected = UNTRACEABLE[method]
    words = (
        rf"^{HERE}, line {line_here(method)}: outputs\(\) of Wrong cannot be traced: .*{reason}.*"
        r' Write it with .* of vdfmu\.unit; or write backend = "python" in the class'
    )
    with pytest.raises(UnitError, match=words) as raised:
        Traced(Interface(bad(method), None))
    assert str(raised.value).count("Write it with") == 1
    # the one word is enough: the same methods in Python
    evaluated = evaluation(Interface(bad(method, backend="python"), None))
    assert isinstance(evaluated, Plain)
    evaluated.group("u")[:] = [0.5, 4.0, 0.0]
    evaluated.outputs()
    if expected is not None:
        # Newton's last correction is below 1e-6, the error its square
        assert evaluated.group("y").tolist() == [pytest.approx(expected, abs=1e-6)]


def _asked(value):
    """Return whether a value is above 0, or True for what cannot say."""
    try:
        return bool(value > 0.0)  # here
    except:  # noqa: E722
        return True


def excepted(self):
    """Catch the refusal of a branch, of which the first line is the one to be told."""
    try:
        self.y = 1.0 / self.u[0] if self.u[0] > 0.0 else 0.0  # here
    except Exception:
        self.y = 3.0


def suppressed(self):
    self.y = 0.0
    with suppress(Exception):
        self.y = float(self.u[0])  # here


def everything(self):
    """Catch whatever comes, in a function, then go on to another error."""
    if _asked(self.u[0]):
        raise ValueError("seen on symbols alone")
    self.y = 0.0


def types(self):
    """Catch what numpy says of objects that it does not know."""
    a = self.u[0]
    try:
        self.y = np.linalg.solve(np.array([[1.0 + a * a]]), np.array([a]))[0]  # here
    except Exception:
        self.y = 0.0


def attributes(self):
    """Catch what Python says of them."""
    try:
        self.y = 1.0 if self.u[0].is_integer() else 0.0  # here
    except AttributeError:
        self.y = 2.0


def kept(self):
    """Catch the refusal of an attribute."""
    self.y = self.u[0]
    with suppress(BaseException):
        self.before = self.u[0]  # here


@pytest.mark.parametrize(("method", "reason"), [
    (excepted, "a condition on a value is not known"),
    (suppressed, "has no value while equations are traced"),
    (everything, "a condition on a value is not known"),
    (types, "UFuncTypeError: Cannot cast ufunc"),
    (attributes, "AttributeError: 'Symbol' object has no attribute 'is_integer'"),
    (kept, "outputs() sets before, which Wrong does not declare"),
])  # fmt: skip
def test_what_is_refused_cannot_be_caught(method, reason):
    line = line_here(_asked if method is everything else method)
    with pytest.raises(UnitError, match=rf"line {line}: outputs\(\) of Wrong .*{re.escape(reason)}") as raised:
        Traced(Interface(bad(method), None))
    assert not isinstance(raised.value.__cause__, ValueError)


def forked(self):
    """Catch errors around a choice, of which each value is traced."""
    try:
        self.y = 1.0 if self.mode == "a" else 2.0
    except Exception:
        self.y = 3.0


def handled(self):
    """Catch an error that comes on floats too."""
    try:
        self.y = {}["missing"]
    except KeyError:
        self.y = 2.0 * self.u[0]


def test_what_is_not_refused_may_be_caught():
    unit = Traced(Interface(bad(forked, mode=Choice("a", "b")), None))
    for mode, expected in ((0, 1.0), (1, 2.0)):
        unit.group("mode")[:] = mode
        unit.outputs()
        assert unit.group("y") == expected
    unit = Traced(Interface(bad(handled), None))
    unit.group("u")[:] = 3.0
    unit.outputs()
    assert unit.group("y") == 6.0


def writes(self):
    self.y = 0.0
    self.u = [1.0, 2.0, 3.0]


def shapes(self):
    self.y = self.u


def reads(self):
    self.y = self.y + 1.0


def raises(self):
    raise KeyError("no such thing")


def endless(self):
    self.outputs()


def no_number(self):
    self.y = None


def remembers(self):
    """Keep a value in an attribute, which a trace would not have."""
    self.y = self.before
    self.before = self.u[0]


class Silent(Bad):
    """Sets nothing."""


class Counts(Bad):
    """Counts its calls in a list."""

    count: ClassVar[list[int]] = []

    def outputs(self) -> None:
        self.count.append(1)
        self.y = float(len(self.count) % 2)


class Early(Unit):
    """Reads a state before the start sets it."""

    x = State("m")
    x_dot = Derivative(x)

    def start(self) -> None:
        self.x = self.x + 1.0

    def derivatives(self) -> None:
        self.x_dot = 0.0


REMEMBERS = bad(remembers, before=0.0)
WAY = "Keep a value for the next call in a Sampled state, and within a call in a local variable"


@pytest.mark.parametrize(("unit", "words"), [
    (bad(writes), r"outputs\(\) of Wrong fails: outputs\(\) must not set u, an input\."),
    (bad(shapes), r"outputs\(\) of Wrong fails: Wrong\.y: expected shape \(\), got \(3,\)\."),
    (Silent, r"outputs\(\) of Silent never sets y\."),
    (bad(reads), r"outputs\(\) of Wrong fails: y is read before it is set\."),
    (bad(raises), r"outputs\(\) of Wrong fails: KeyError: 'no such thing'\."),
    (bad(endless), r"outputs\(\) of Wrong fails: it calls itself endlessly\."),
    (bad(no_number), r"outputs\(\) of Wrong fails: Wrong\.y: expected numbers, got None\."),
    (REMEMBERS, rf"outputs\(\) of Wrong fails: outputs\(\) sets before, which Wrong does not declare\. {WAY}\."),
    (Counts, rf"outputs\(\) of Counts gives y = [01]\.0, then [01]\.0 for the same values\. {WAY}\. For noise use an "
             r"input or vdfmu\.unit\.normal\."),
    (Early, r"start\(\) of Early fails: x is a state and gets its first value by start\(\)\."),
])  # fmt: skip
def test_a_method_that_is_wrong_is_named_with_its_line(unit, words):
    with pytest.raises(UnitError, match=rf"^({HERE}|{__file__}), line \d+: {words}$"):
        Traced(Interface(unit, None))


@pytest.mark.parametrize(("method", "attribute"), [(remembers, {"before": 0.0}), (Counts.outputs, {"count": []})])
def test_a_unit_in_python_may_have_attributes_of_its_own(method, attribute):
    evaluation(Interface(bad(method, backend="python", **attribute), None)).outputs()
