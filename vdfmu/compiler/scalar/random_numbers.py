"""Random numbers for units: the same on every platform, as plain numbers and in traced functions.

The generator is MRG32k3a (L'Ecuyer, Operations Research 47, 1999): two recursions of order 3, with a period of 2^191.
Their products are below 2^53, so they are exact in doubles. A unit keeps the six numbers of the generator as a sampled
state::

    random = Sampled("1", 6, "state of the random numbers")

    def start(self) -> None:
        self.random = seeded(self.seed)

    def update(self) -> None:
        noise, self.random = normal(self.random, self.n)
"""

from __future__ import annotations

from typing import Any

import numpy as np

_M_1, _M_2 = 4294967087.0, 4294944443.0
_M_SEED, _A_SEED = 2147483647.0, 48271.0
"""Park and Miller's generator spreads a seed over the state."""
LARGEST_SEED = 2147483645.0
_OF_NORMAL = 12


def seeded(seed: Any) -> Any:
    """Return the state (6,) of the generator for a seed, a whole number from 0 to `LARGEST_SEED`."""
    states = [seed + 1.0]
    for _ in range(8):
        states.append((_A_SEED * states[-1]) % _M_SEED)
    return np.stack(states[3:])


def uniform(state: Any, count: int) -> tuple[Any, Any]:
    """Return numbers (count,) uniform in (0, 1), multiples of 1 / 4294967088, and the next state (6,)."""
    a, b, c, d, e, f = state
    drawn = []
    for _ in range(count):
        a, b, c = b, c, (1403580.0 * b - 810728.0 * a) % _M_1
        d, e, f = e, f, (527612.0 * f - 1370589.0 * d) % _M_2
        rest = (c - f) % _M_1
        drawn.append((rest + _M_1 * (rest <= 0.0)) / (_M_1 + 1.0))
    return np.stack(drawn) if drawn else np.zeros(0), np.stack([a, b, c, d, e, f])


def normal(state: Any, count: int) -> tuple[Any, Any]:
    """Return nearly normal numbers (count,) of mean 0 and standard deviation 1, and the next state (6,).

    Each is the sum of twelve uniform numbers minus 6, so it is at most 6, with a kurtosis of 2.9 instead of 3. A
    logarithm would differ in the last bits between platforms.
    """
    drawn, state = uniform(state, _OF_NORMAL * count)
    return drawn.reshape(count, _OF_NORMAL).sum(axis=1) - 0.5 * _OF_NORMAL, state
