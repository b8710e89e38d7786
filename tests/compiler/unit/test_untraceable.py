"""What cannot be traced, and methods that are wrong: each says file, line, reason and the way out."""

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


class Branch(Bad):
    """Branches on a value."""

    def outputs(self) -> None:
        self.y = 0.0
        if self.u[0] > 0.0:  # here
            self.y = 1.0


class Converging(Bad):
    """Loops until convergence."""

    def outputs(self) -> None:
        root = 1.0
        while abs(root * root - self.u[1]) > 1e-6:  # here
            root = 0.5 * (root + self.u[1] / root)
            if root > 1e6:
                break
        self.y = root


class Solved(Bad):
    """Calls numpy's solver on ordinary arrays, which numpy does not hand on to symbols."""

    def outputs(self) -> None:
        a, b = self.u[0], self.u[1]
        self.y = np.linalg.solve(np.array([[1.0 + a * a, b], [b, 1.0]]), np.array([a, b]))[0]  # here


class Eigenvalues(Bad):
    """Calls an iteration."""

    def outputs(self) -> None:
        self.y = np.linalg.eigvalsh(np.outer(self.u, self.u))[2]  # here


class Special(Bad):
    """Calls scipy."""

    def outputs(self) -> None:
        self.y = special.expit(self.u)[0]  # here


class Mathematical(Bad):
    """Calls math instead of numpy."""

    def outputs(self) -> None:
        self.y = math.sin(self.u[0])  # here


class Largest(Bad):
    """Calls max."""

    def outputs(self) -> None:
        self.y = max(self.u[0], 0.0)  # here


class Equal(Bad):
    """Compares for equality."""

    def outputs(self) -> None:
        self.y = where(self.u[0] == 0.0, 1.0, 0.0)  # here


class Spacing(Bad):
    """Calls a function that symbols do not have."""

    def outputs(self) -> None:
        self.y = np.spacing(self.u[0])  # here


class Interpolated(Bad):
    """Interpolates by numpy."""

    def outputs(self) -> None:
        self.y = np.interp(self.u[0], [0.0, 1.0], [0.0, 2.0])  # here


class Cast(Bad):
    """Makes an array of floats."""

    def outputs(self) -> None:
        found = np.zeros(2)
        found[0] = self.u[0]  # here
        self.y = found[0]


UNTRACEABLE = {
    Branch: "a condition on a value is not known",
    Converging: "a condition on a value is not known",
    Solved: "Cannot cast ufunc 'solve1?' input 0 from dtype",
    Special: "ufunc 'expit' not supported for the input types",
    Mathematical: "has no value while equations are traced",
    Largest: "a condition on a value is not known",
    Equal: "a condition on a value is not known",
    Eigenvalues: "eigvalsh of numpy takes no symbols: ",
    Spacing: "np.spacing takes no symbols: ufunc 'spacing' not supported",
    Interpolated: "Take .* interpolate of vdfmu.unit for a table",
    Cast: r"an array to put it into is zeros\(shape, \*like\) of vdfmu\.unit",
}


@pytest.mark.parametrize("unit", UNTRACEABLE)
def test_what_cannot_be_traced_says_where_why_and_the_way_out(unit):
    lines, first = inspect.getsourcelines(unit)
    (line,) = (first + i for i, text in enumerate(lines) if text.rstrip().endswith("# here"))
    words = (
        rf"^{HERE}, line {line}: outputs\(\) of {unit.__name__} cannot be traced: .*{UNTRACEABLE[unit]}.*"
        r' Write it with .* of vdfmu\.unit; or write backend = "python" in the class'
    )
    with pytest.raises(UnitError, match=words) as raised:
        Traced(Interface(unit, None))
    assert str(raised.value).count("Write it with") == 1
    # the one word is enough: the same methods in Python
    packed = type(unit.__name__, (unit,), {"backend": "python", "__module__": unit.__module__})
    evaluated = evaluation(Interface(packed, None))
    assert isinstance(evaluated, Plain)
    evaluated.group("u")[:] = [0.5, 4.0, 0.0]
    evaluated.outputs()
    expected = {Branch: 1.0, Converging: 2.0, Solved: 15.5 / 14.75, Largest: 0.5, Equal: 0.0, Cast: 0.5}
    if unit in expected:
        # Newton's last correction is below 1e-6, the error its square
        assert evaluated.group("y").tolist() == [pytest.approx(expected[unit], abs=1e-6)]


def _asked(value):
    """Return whether a value is above 0, or True for what cannot say."""
    try:
        return bool(value > 0.0)  # here
    except:  # noqa: E722
        return True


class Excepted(Bad):
    """Catches the refusal of a branch, of which the first line is the one to be told."""

    def outputs(self) -> None:
        try:
            self.y = 1.0 / self.u[0] if self.u[0] > 0.0 else 0.0  # here
        except Exception:
            self.y = 3.0


class Suppressed(Bad):
    """Suppresses it."""

    def outputs(self) -> None:
        self.y = 0.0
        with suppress(Exception):
            self.y = float(self.u[0])  # here


class Everything(Bad):
    """Catches whatever comes, in a function, then goes on to another error."""

    def outputs(self) -> None:
        if _asked(self.u[0]):
            raise ValueError("seen on symbols alone")
        self.y = 0.0


class Types(Bad):
    """Catches what numpy says of objects that it does not know."""

    def outputs(self) -> None:
        a = self.u[0]
        try:
            self.y = np.linalg.solve(np.array([[1.0 + a * a]]), np.array([a]))[0]  # here
        except Exception:
            self.y = 0.0


class Attributes(Bad):
    """Catches what Python says of them."""

    def outputs(self) -> None:
        try:
            self.y = 1.0 if self.u[0].is_integer() else 0.0  # here
        except AttributeError:
            self.y = 2.0


class Kept(Bad):
    """Catches the refusal of an attribute."""

    def outputs(self) -> None:
        self.y = self.u[0]
        with suppress(BaseException):
            self.before = self.u[0]  # here


@pytest.mark.parametrize(
    ("unit", "reason"),
    [
        (Excepted, "a condition on a value is not known"),
        (Suppressed, "has no value while equations are traced"),
        (Everything, "a condition on a value is not known"),
        (Types, "UFuncTypeError: Cannot cast ufunc"),
        (Attributes, "AttributeError: 'Symbol' object has no attribute 'is_integer'"),
        (Kept, "outputs() sets before, which Kept does not declare"),
    ],
)
def test_what_is_refused_cannot_be_caught(unit, reason):
    lines, first = inspect.getsourcelines(_asked if unit is Everything else unit)
    (line,) = (first + i for i, text in enumerate(lines) if text.rstrip().endswith("# here"))
    with pytest.raises(
        UnitError, match=rf"line {line}: outputs\(\) of {unit.__name__} .*{re.escape(reason)}"
    ) as raised:
        Traced(Interface(unit, None))
    assert not isinstance(raised.value.__cause__, ValueError)


class Forked(Bad):
    """Catches errors around a choice, of which each value is traced."""

    mode = Choice("a", "b")

    def outputs(self) -> None:
        try:
            self.y = 1.0 if self.mode == "a" else 2.0
        except Exception:
            self.y = 3.0


class Handled(Bad):
    """Catches an error that comes on floats too."""

    def outputs(self) -> None:
        try:
            self.y = {}["missing"]
        except KeyError:
            self.y = 2.0 * self.u[0]


def test_what_is_not_refused_may_be_caught():
    for mode, expected in ((0, 1.0), (1, 2.0)):
        forked = Traced(Interface(Forked, None))
        forked.group("mode")[:] = mode
        forked.outputs()
        assert forked.group("y") == expected
    handled = Traced(Interface(Handled, None))
    handled.group("u")[:] = 3.0
    handled.outputs()
    assert handled.group("y") == 6.0


class Writes(Bad):
    """Sets what it may not."""

    def outputs(self) -> None:
        self.y = 0.0
        self.u = [1.0, 2.0, 3.0]


class Shapes(Bad):
    """Sets three numbers for one."""

    def outputs(self) -> None:
        self.y = self.u


class Silent(Bad):
    """Sets nothing."""


class Reads(Bad):
    """Reads an output before it is set."""

    def outputs(self) -> None:
        self.y = self.y + 1.0


class Raises(Bad):
    """Raises an error of its own."""

    def outputs(self) -> None:
        raise KeyError("no such thing")


class Endless(Bad):
    """Calls itself."""

    def outputs(self) -> None:
        self.outputs()


class Nothing(Bad):
    """Sets None."""

    def outputs(self) -> None:
        self.y = None


class Remembers(Bad):
    """Keeps a value in an attribute, which a trace would not have."""

    before = 0.0

    def outputs(self) -> None:
        self.y = self.before
        self.before = self.u[0]


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


@pytest.mark.parametrize(
    ("unit", "words"),
    [
        (Writes, r"line \d+: outputs\(\) of Writes fails: outputs\(\) sets u, an input, which it may not\."),
        (Shapes, r"line \d+: outputs\(\) of Shapes fails: Shapes\.y: expected shape \(\), got \(3,\)\."),
        (Silent, r"line \d+: outputs\(\) of Silent never sets y\."),
        (Reads, r"line \d+: outputs\(\) of Reads fails: y is read before it is set\."),
        (Raises, r"line \d+: outputs\(\) of Raises fails: KeyError: 'no such thing'\."),
        (Endless, r"line \d+: outputs\(\) of Endless fails: it calls itself without end\."),
        (Nothing, r"line \d+: outputs\(\) of Nothing fails: Nothing\.y: expected numbers, got None\."),
        (
            Remembers,
            r"line \d+: outputs\(\) of Remembers fails: outputs\(\) sets before, which Remembers does not declare\. "
            r"What is kept from one call to the next is a Sampled state; what is not, a local variable\.",
        ),
        (
            Counts,
            r"line \d+: outputs\(\) of Counts gives y = [01]\.0, then [01]\.0 from the same values\. What is kept "
            r"from one call to the next is a Sampled state; what is not, a local variable; noise is an input, or of "
            r"`normal` of vdfmu\.unit\.",
        ),
        (Early, r"line \d+: start\(\) of Early fails: x is a state, which has no value before start\(\) sets it\."),
    ],
)
def test_a_method_that_is_wrong_is_named_with_its_line(unit, words):
    with pytest.raises(UnitError, match=rf"^({HERE}|{__file__}), {words}$"):
        Traced(Interface(unit, None))


@pytest.mark.parametrize(("unit", "attribute"), [(Remembers, "before"), (Counts, "count")])
def test_a_unit_in_python_may_have_attributes_of_its_own(unit, attribute):
    packed = type(unit.__name__, (unit,), {"backend": "python", "__module__": unit.__module__})
    evaluated = evaluation(Interface(packed, None))
    evaluated.outputs()
    assert hasattr(packed, attribute)
