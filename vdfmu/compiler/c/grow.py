"""The C of a long arm from the C of shorter ones: the same text, with numbers that grow with the joints.

Loops over the joints have one text for any number of joints. Places in vectors, limits of the loops and sizes are whole
numbers in it that change by the same amount for each joint more. So what shorter arms have in common says what a long
one has, and no trace of the long one is needed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

_NUMBER = re.compile(r"(?<![\d.])(?<![\d.]e)(?<![\d.]e[-+])(-?\d+)(?!\d|\.(?!0\b)|e[-+\d])")
"""A whole number, which may be written ``12.0``; the digits of others, as ``0.5`` and ``1e-05``, must be the same."""


def grown(shorter: Mapping[int, Mapping[str, str]], joints: int) -> dict[str, str] | None:
    """Return file name to text for a number of joints.

    Parameters
    ----------
    shorter : mapping of int to mapping
        At least two smaller numbers of joints to the files there. Two decide how each number grows, others check it.
    joints : int
        The number asked for: whole steps from the first, as the first two are apart.

    Returns
    -------
    dict or None
        None where the texts differ in more than numbers, a number does not grow evenly, or one that is times an index
        grows: places in a matrix of joints, which others that grow with the square may follow.
    """
    counts, (first, *others) = list(shorter), shorter.values()
    if any(other.keys() != first.keys() for other in others):
        return None
    found = {name: _grown([files[name] for files in shorter.values()], counts, joints) for name in first}
    return {name: text for name, text in found.items() if text is not None} if all(found.values()) else None


def _grown(texts: list[str], counts: list[int], joints: int) -> str | None:
    words, *others = map(_NUMBER.split, texts)
    if any(other[::2] != words[::2] for other in others):
        return None
    numbers = np.array([list(map(float, text[1::2])) for text in (words, *others)])
    steps = (np.array([*counts, joints]) - counts[0]) / (counts[1] - counts[0])
    if (steps % 1.0).any():  # joints repeat after some
        return None
    growth = numbers[1] - numbers[0]
    if any(words[2 * k + 2].startswith(" * i") for k in np.flatnonzero(growth)):
        return None
    if not np.array_equal(numbers, numbers[0] + np.outer(steps[:-1], growth)):
        return None
    for k in np.flatnonzero(growth):
        words[2 * k + 1] = str(int(numbers[0][k] + steps[-1] * growth[k]))
    return "".join(words)
