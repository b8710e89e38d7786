"""The C of a long arm from the C of shorter arms: the same text, with numbers that grow with the joints.

Loops over the joints have the same text for any number of joints. Places in vectors, limits of loops and sizes are
whole numbers in it. They change by the same amount for each further joint, so a long arm needs no trace.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

_NUMBER = re.compile(r"(?<![\d.])(?<![\d.]e)(?<![\d.]e[-+])(-?\d+)(?!\d|\.(?!0\b)|e[-+\d])")
"""A whole number, also as ``12.0``. Other numbers, such as ``0.5`` and ``1e-05``, must be the same."""


def grown(shorter: Mapping[int, Mapping[str, str]], joints: int) -> dict[str, str] | None:
    """Return file name to text for a number of joints.

    `shorter` has the files of two or more smaller numbers of joints. The first two set the growth of each number, the
    rest checks it. `joints` is a multiple of their distance after the first.

    None if the texts differ in more than numbers, if a number grows unevenly, or if a factor of an index grows. Such a
    factor belongs to a matrix of joints, and places behind it may grow with the square.
    """
    counts, (first, *rest) = list(shorter), shorter.values()
    if any(files.keys() != first.keys() for files in rest):
        return None
    texts: dict[str, str] = {}
    for name in first:
        text = _grown([files[name] for files in shorter.values()], counts, joints)
        if not text:
            return None
        texts[name] = text
    return texts


def _grown(texts: list[str], counts: list[int], joints: int) -> str | None:
    words, *rest = map(_NUMBER.split, texts)
    if any(text[::2] != words[::2] for text in rest):
        return None
    numbers = np.array([list(map(float, text[1::2])) for text in (words, *rest)])
    steps = (np.array([*counts, joints]) - counts[0]) / (counts[1] - counts[0])
    if (steps % 1.0).any():  # kinds of joints repeat with this distance
        return None
    growth = numbers[1] - numbers[0]
    if any(words[2 * k + 2].startswith(" * i") for k in np.flatnonzero(growth)):
        return None
    if not np.array_equal(numbers, numbers[0] + np.outer(steps[:-1], growth)):
        return None
    for k in np.flatnonzero(growth):
        words[2 * k + 1] = str(int(numbers[0][k] + steps[-1] * growth[k]))
    return "".join(words)
