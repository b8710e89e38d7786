"""Times at which a trajectory begins and ends, with their rounding."""

import numpy as np


def rounded_ends(draws=500, seed=11):
    """Yield T, t_start and times of both ends that differ by rounding: the nearest floats, multiples, sums of steps."""
    random = np.random.default_rng(seed)
    for _ in range(draws):
        step = 10.0 ** random.integers(-4, -1)
        first, count = random.integers(0, 3000), random.integers(1, 3000)
        T, t_start = count * step, first * step
        pairs = [(t_start, t_start + T), (t_start, (first + count) * step)]
        pairs += [(np.nextafter(a, side), np.nextafter(b, side)) for a, b in pairs for side in (-1.0, 1e9)]
        sums = np.add.accumulate(np.full(first + count, step))
        pairs.append((sums[first - 1] if first else 0.0, sums[-1]))
        yield T, t_start, pairs
