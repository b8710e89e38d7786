"""Derivatives through roundings: those of the line that a rounding follows, half a step below or above it."""

import casadi as ca
import numpy as np
import pytest

from vdfmu.compiler.functions.derivatives import derivative


@pytest.mark.parametrize(("rounding", "below"), [(ca.floor, 0.5), (ca.ceil, -0.5)])
def test_the_slope_of_the_square_of_a_rounding_is_that_of_its_line(rounding, below):
    x = ca.SX.sym("x")
    function = ca.Function("square", [x], [rounding(x) ** 2], ["x"], ["y"])
    for value in (3.2, -1.7):
        expected = 2.0 * (value - below)
        np.testing.assert_allclose(
            float(derivative(function, "forward", rounded=True)(value, 1.0)), expected, rtol=1e-14
        )
        np.testing.assert_allclose(
            float(derivative(function, "reverse", rounded=True)(value, 1.0)), expected, rtol=1e-14
        )
        assert float(derivative(function, "forward")(value, 1.0)) == 0.0
