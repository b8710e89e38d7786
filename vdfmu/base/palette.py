"""The colours of curves and values, of all pictures and pages: one place, safe for colour-blind readers."""

from __future__ import annotations

LIGHT = ("#015e9c", "#b94b01", "#088158", "#c76999", "#c88507", "#369bda", "#060809")
"""On white: close to the colours of Okabe and Ito (2008) without their yellow, but each two of them can be told apart.

Lines of 0.1 degree of the visual field differ for at least half of all readers, also in protanopia and deuteranopia,
and each has a contrast of 3 to the page (WCAG 2.1, 1.4.11): `tests/study/report/test_palette.py` calculates both.
"""
DARK = ("#5daced", "#e47c3c", "#47cda0", "#bc75a1", "#efbc44", "#99d2f6", "#eef1f0")
"""The same in the same order, on a dark page."""

NEGATIVE, POSITIVE = 0, 1
"""Places of the colours of values below and above 0."""


def style_sheet() -> str:
    """Return the colours as variables: ``--joint-1`` to as many as ``--joints``, ``--negative``, ``--positive``."""

    def variables(colours: tuple[str, ...]) -> str:
        named = {f"joint-{i}": colour for i, colour in enumerate(colours, 1)}
        named |= {"negative": colours[NEGATIVE], "positive": colours[POSITIVE]}
        named["joints"] = str(len(colours))
        return ":root{" + ";".join(f"--{name}:{colour}" for name, colour in named.items()) + "}"

    return f"{variables(LIGHT)} @media (prefers-color-scheme: dark) {{ {variables(DARK)} }}"
