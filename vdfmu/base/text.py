"""Makes foreign text, such as messages of units and names in files, safe to show; portable JSON."""

from __future__ import annotations

import difflib
import json
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, cast

_CONTROLS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""Characters that act on a terminal: controls except tab and newline, text directions, and surrogates."""
FORBIDDEN = re.compile("[\x00-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")
"""Characters that XML excludes or that act on a terminal."""
LONGEST_NAME = 100
"""Longest name from which file names are made [characters]."""
FEW = 20
"""Largest number of messages printed per rule."""
_LONGEST_NAME, _LONGEST_LINE, _MOST_LINES = 200, 2000, 100
"""Longest word and longest line of a message [characters], and its largest number of lines."""
_LONG_NAME = re.compile(rf"\S{{{_LONGEST_NAME + 1},}}")


def shown(text: str, escaped: re.Pattern[str] = _CONTROLS) -> str:
    r"""Return a text in which control characters, or matches of `escaped`, are escapes such as ``\x1b``."""
    return escaped.sub(lambda match: ascii(match[0])[1:-1], text)


def error_text(error: object) -> str:
    """Return the message of an error with its notes, shortened by `elided`."""
    notes, text = getattr(error, "__notes__", []), message_of(error)
    return elided(". ".join([*filter(None, [text.removesuffix(".")]), *notes]) if notes else text)


def message_of(error: object) -> str:
    """Return the message of an error. Foreign ``__str__`` may fail."""
    try:
        return str(error)
    except (Exception, SystemExit) as other:
        return f"its message cannot be printed, because that raises {type(other).__name__}"


def kind_text(error: BaseException) -> str:
    """Return the type and message of an error in foreign code."""
    return f"{type(error).__name__}: {message_of(error)}"


def elided(text: str) -> str:
    """Return a message of bounded length: the middle of long words, lines and texts is left out."""
    if len(text) <= _LONGEST_NAME:
        return text
    text = _LONG_NAME.sub(lambda name: _without_middle(name[0], _LONGEST_NAME), text)
    lines = [_without_middle(line, _LONGEST_LINE) for line in text.splitlines()]
    if len(lines) > _MOST_LINES:
        lines[_MOST_LINES // 2 : -_MOST_LINES // 2] = [f"... ({len(lines) - _MOST_LINES:,} lines) ..."]
    return "\n".join(lines)


def _without_middle(text: str, most: int) -> str:
    half = most // 2
    return text if len(text) <= most else f"{text[:half]}...({len(text) - 2 * half:,} characters)...{text[-half:]}"


def first_few(texts: Sequence[str], rule_of: Callable[[str], str] = lambda text: "") -> list[str]:
    """Return at most `FEW` texts per rule, then the number of further texts per rule."""
    counts: Counter[str] = Counter()
    kept: list[str] = []
    for text in texts:
        counts[rule := rule_of(text)] += 1
        if counts[rule] <= FEW:
            kept.append(text)
    more = {rule: count - FEW for rule, count in counts.items() if count > FEW}
    return [*kept, *(f"and {count:,} more{f' [{rule}]' if rule else ''}" for rule, count in more.items())]


def amount(number: int, noun: str) -> str:
    """Return ``1 point`` or ``2 points`` from a noun in the singular."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def name_fault(name: Any, dots: bool = True) -> str:
    """Return "" for a valid name of a component or, with `dots`, of a system, else the required form.

    The names are also used as file names.
    """
    pattern = r"\w[\w .+-]*" if dots else r"\w[\w +-]*"
    if isinstance(name, str) and re.fullmatch(pattern, name) and len(name) <= LONGEST_NAME:
        return ""
    return f"a name of letters, digits, spaces and {'. ' * dots}_ + -, a letter, digit or _ first"


def matching(names: Iterable[str], patterns: Iterable[str]) -> list[str]:
    """Return the names that match any pattern. ``*`` matches any text."""
    whole = [re.compile(".*".join(map(re.escape, pattern.split("*")))) for pattern in patterns]
    return [name for name in names if any(pattern.fullmatch(name) for pattern in whole)]


def close_to(name: str, names: Iterable[str]) -> str:
    """Return the end of a message about a wrong name: similar known names."""
    close = difflib.get_close_matches(name, list(dict.fromkeys(names)), n=3)
    return f"; did you mean {', '.join(close)}?" if close else ""


def printable(text: str) -> str:
    """Return text from a file for a message: shortened, with control characters as escapes."""
    text = text if len(text) <= 70 else text[:66] + " ..."
    return shown(text, FORBIDDEN)


def nearest(name: str, names: Sequence[str]) -> str:
    """Return the suggestion for a wrong name: the closest known name, and all known names."""
    lower = [k.lower() for k in names]
    match = difflib.get_close_matches(name.lower(), lower, n=1, cutoff=0.6)
    match = match or [k for k in lower if len(name) > 1 and k.startswith(name.lower())]
    hint = next((f'Did you mean "{k}"? ' for k in names if match and k.lower() == match[0]), "")
    return f"{hint}There are: {', '.join(names)}."


def to_json(summary: Mapping[str, Any], indent: int | None = 2) -> str:
    """Return a summary as JSON. NaN and infinity become the texts "nan", "inf" and "-inf"."""
    return json.dumps(_portable(summary), indent=indent, allow_nan=False)


def _portable(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _portable(entry) for key, entry in cast("Mapping[Any, Any]", value).items()}
    if isinstance(value, list | tuple):
        return [_portable(entry) for entry in cast("list[Any]", value)]
    if getattr(value, "ndim", None) == 0:  # a number of numpy
        value = value.item()
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value
