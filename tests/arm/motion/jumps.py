"""Jumps of a motion's derivatives, and what rounding makes of them."""

import math

import numpy as np


def jumps(motion):
    """Largest jump of each derivative at a knot, from rest at the start and to rest at the end, (5,)."""
    h = np.diff(motion.knots)
    before = np.array(
        [
            [sum(math.perm(k, order) * c[k] * dt ** (k - order) for k in range(order, 6)) for order in range(5)]
            for c, dt in zip(motion.coefficients, h, strict=True)
        ]
    )
    after = np.array([[math.factorial(order) * c[order] for order in range(5)] for c in motion.coefficients])
    still = np.zeros((1, 5, motion.n))
    change = np.concatenate([after, still]) - np.concatenate([still, before])
    change[[0, -1], 0] = 0.0  # of the position there is nothing to compare with
    return np.abs(change).max(axis=(0, 2))


def rounding(motion):
    """Return what roundings of the positions make of the derivatives, differences over the shortest interval, (5,)."""
    # The differences of order 4 in six points have factors of up to some hundred.
    size = np.abs(motion.coefficients[:, 0]).max() + 1.0
    return 1000.0 * np.finfo(float).eps * size / np.diff(motion.knots).min() ** np.arange(5.0)
