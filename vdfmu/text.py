"""Text of others, such as messages of units and names in files, made safe to show."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

_ACTING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
"""What a terminal acts on: controls but tab and newline, directions of writing, halves of characters."""


def shown(text: str, acting: re.Pattern[str] = _ACTING) -> str:
    r"""Return a text with what a terminal would act on, or what `acting` finds, written out: an escape as ``\x1b``."""
    return acting.sub(lambda found: ascii(found[0])[1:-1], text)


def error_text(error: object) -> str:
    """Return what an error says, with what was added to it on its way."""
    notes = getattr(error, "__notes__", [])
    return ". ".join([*filter(None, [str(error).removesuffix(".")]), *notes]) if notes else str(error)


def matching(names: Iterable[str], patterns: Iterable[str]) -> list[str]:
    """Return the names that one of the patterns, with ``*`` for any text, fits."""
    whole = [re.compile(".*".join(map(re.escape, pattern.split("*")))) for pattern in patterns]
    return [name for name in names if any(pattern.fullmatch(name) for pattern in whole)]


def close_to(name: str, known: Iterable[str]) -> str:
    """Return known names that are close to a wrong one, as the end of a message."""
    close = difflib.get_close_matches(name, list(known), n=3)
    return f"; did you mean {', '.join(close)}?" if close else ""
