"""Rolls repeated lines of C, whose indices advance evenly, into loops."""

from __future__ import annotations

import re
from collections.abc import Sequence

_NUMBER = re.compile(r"(?<![\w.])(?<!\* )(?<![eE][+-])(\d+)(?![\w.]| \*)")
"""A whole number that may grow from iteration to iteration like an index; factors and exponents do not."""
_INDEX = re.compile(r"\bj\b")
_MOST = 64
"""Most lines in the body of a loop."""
_LEAST = 3
"""Fewest iterations of a loop."""


def rolled(lines: Sequence[str]) -> list[str]:
    """Return lines with loops over ``j`` for lines that differ only in whole numbers, by the same amount each time.

    The order of the lines is kept.
    """
    parts = [_NUMBER.split(line) for line in lines]
    kinds: dict[tuple[str, ...], int] = {}
    texts = [kinds.setdefault(tuple(part[::2]), len(kinds)) for part in parts]
    numbers = [tuple(map(int, part[1::2])) for part in parts]
    texts = [-1 - k if _INDEX.search(lines[k]) else text for k, text in enumerate(texts)]
    made: list[str] = []
    begin = 0
    while begin < len(lines):
        period, rounds = _longest(texts, numbers, begin)
        if rounds < _LEAST:
            made.append(lines[begin])
            begin += 1
            continue
        steps = [_step(numbers, k, period) for k in range(begin, begin + period)]
        body = [_moving(parts[begin + k], steps[k]) for k in range(period)]
        head = f"for (int j = 0; j < {rounds}; j++)"
        made += [f"{head} {{", *(f"    {line}" for line in body), "}"] if period > 1 else [head, f"    {body[0]}"]
        begin += period * rounds
    return made


def _longest(texts: Sequence[int], numbers: Sequence[tuple[int, ...]], begin: int) -> tuple[int, int]:
    """Return the body of the loop from a line on that covers most lines, and its number of iterations."""
    best, best_end = (1, 1), begin
    for period in range(1, min(_MOST, (len(texts) - begin) // _LEAST) + 1):
        if texts[begin] != texts[begin + period]:
            continue
        if period % best[0] == 0 and best_end >= begin + 2 * period:
            continue  # the line that ends the loop with the shorter period ends this one too
        end = begin + period
        while end < len(texts) and texts[end] == texts[end - period] and _is_even(numbers, begin, end, period):
            end += 1
        rounds = (end - begin) // period
        if rounds >= _LEAST and period * rounds > best[0] * best[1]:
            best, best_end = (period, rounds), end
    return best


def _is_even(numbers: Sequence[tuple[int, ...]], begin: int, end: int, period: int) -> bool:
    return end - period < begin + period or _step(numbers, end - 2 * period, period) == _step(
        numbers, end - period, period
    )


def _step(numbers: Sequence[tuple[int, ...]], k: int, period: int) -> tuple[int, ...]:
    return tuple([b - a for a, b in zip(numbers[k], numbers[k + period], strict=True)])


def _moving(part: Sequence[str], step: Sequence[int]) -> str:
    """Return a line whose numbers advance with ``j``."""
    text = part[0]
    for k, change in enumerate(step):
        number = part[2 * k + 1]
        if change:
            number = f"{number} {'+' if change > 0 else '-'} {abs(change)} * j"
        text += number + part[2 * k + 2]
    return text
