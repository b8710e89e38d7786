"""A traced plant against its equations."""

import numpy as np

from vdfmu.arm.equations.plant import plant_derivative


def assert_traced(plant_function, robot, states):
    rate, slopes = (plant_function(robot, name) for name in ("derivatives", "jacobian"))
    F_e = np.zeros(6)
    for x, tau in states:
        expected = plant_derivative(robot, x, tau, F_e)
        # rounding of either way through some 1000 operations
        np.testing.assert_allclose(rate(x, tau, F_e), expected, rtol=0, atol=1e-12 * np.abs(expected).max())
        J = slopes(x, tau, F_e)
        for j in range(x.size):
            h = 1e-7 * np.eye(x.size)[j]
            high, low = (plant_derivative(robot, x + s * h, tau, F_e) for s in (1, -1))
            # rounding 1e-16 / 1e-7 of the rates; h^2 of third derivatives, up to 1 / eps^2 = 1e6 times the first
            atol = 1e-7 * np.abs(expected).max() + 1e-6 * np.abs(J[:, j]).max()
            np.testing.assert_allclose(J[:, j], (high - low) / 2e-7, rtol=0, atol=atol)
