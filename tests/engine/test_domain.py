"""One conversion of values: what each type accepts, to the last digit, and the message for all else."""

import math
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest

from vdfmu.base.domain import NO_LIMIT, Domain

REAL = Domain("Real", low=-10.0, high=10.0, unit="N")
BYTE = Domain("Integer", low=-128, high=127)
LONG = Domain("Integer", low=-(2**63), high=2**63 - 1)
MODE = Domain("Integer", {"off": 0, "on": 1})
FLAG = Domain("Boolean")
BEYOND = 2**53 + 1  # the first integer that no float has


@pytest.mark.parametrize(("domain", "value", "expected"), [
    (REAL, 2, 2.0), (REAL, "2.5", 2.5), (REAL, " 1e0 ", 1.0), (REAL, np.float32(0.5), 0.5), (REAL, np.array(3), 3.0),
    (REAL, Fraction(1, 4), 0.25), (REAL, Decimal("0.5"), 0.5),
    (BYTE, 7.0, 7), (BYTE, "7", 7), (BYTE, "7.0", 7), (BYTE, np.uint8(7), 7), (BYTE, np.float64(-128.0), -128),
    (LONG, BEYOND, BEYOND), (LONG, str(BEYOND), BEYOND), (LONG, np.int64(BEYOND), BEYOND), (LONG, -(2**63), -(2**63)),
    (MODE, "on", 1), (MODE, 1, 1), (MODE, 1.0, 1), (MODE, "1", 1),
    (FLAG, True, True), (FLAG, np.False_, False), (FLAG, "True", True), (FLAG, 0, False), (FLAG, 1.0, True),
    (Domain("String"), "2,5", "2,5"), (Domain("Binary"), "0aff", b"\n\xff"), (Domain("Binary"), b"x", b"x"),
    (Domain("Real", start=NO_LIMIT), math.inf, NO_LIMIT),
])  # fmt: skip
def test_a_value_of_the_type_is_converted(domain, value, expected):
    assert domain.read(value) == expected
    assert type(domain.read(value)) is type(expected)


@pytest.mark.parametrize(("domain", "value", "message"), [
    (REAL, True, "expected a number in N, got True"), (REAL, np.True_, "expected a number in N, got True"),
    (REAL, "2,5", "expected a number in N, got '2,5'"), (REAL, "1_0", "expected a number in N, got '1_0'"),
    (REAL, None, "expected a number in N, got None"), (REAL, 1j, "expected a number in N, got 1j"),
    (REAL, b"2", "expected a number in N, got b'2'"), (REAL, [1.0], "expected a number in N, got [1.0]"),
    (REAL, math.nan, "expected a finite number, got nan N"), (REAL, "inf", "expected a finite number, got inf N"),
    (REAL, 10**400, "expected a finite number, got inf N"), (REAL, 10.5, "expected at most 10 N, got 10.5 N"),
    (BYTE, 0.5, "expected a whole number, got 0.5"), (BYTE, True, "expected a whole number, got True"),
    (BYTE, 128, "expected at most 127, got 128"), (BYTE, -129, "expected at least -128, got -129"),
    (LONG, 2**63, "expected at most 9223372036854775807, got 9223372036854775808"),
    (LONG, 10**400, "expected a finite number, got inf"), (LONG, math.nan, "expected a finite number, got nan"),
    (MODE, "an", "expected off or on, got 'an'"), (MODE, 2, "expected 0 (off) or 1 (on), got 2"),
    (MODE, 0.5, "expected 0 (off) or 1 (on), got 0.5"), (FLAG, "yes", "expected true or false, got 'yes'"),
    (FLAG, 2, "expected true or false, got 2"), (Domain("String"), 5, "expected a text, got 5"),
    (Domain("Binary"), "no hex", "expected bytes, or a text of hexadecimal digits, got 'no hex'"),
    (Domain("Real", low=1e-12), 0.0, "expected a number above 0, got 0"),
])  # fmt: skip
def test_another_value_is_refused(domain, value, message):
    with pytest.raises(ValueError) as error:
        domain.read(value)
    assert str(error.value) == message
