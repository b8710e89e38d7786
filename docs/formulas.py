"""Formulas as drawings: pages need no script, no font and no network. An extension of Markdown."""

from __future__ import annotations

import re
import warnings
from html import escape, unescape
from typing import Any

from markdown import Extension, Markdown
from markdown.postprocessors import Postprocessor

with warnings.catch_warnings():  # it opens its font in a way that Python 3.11 calls deprecated
    warnings.simplefilter("ignore", DeprecationWarning)
    import ziamath

_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
_TAG = re.compile(r"\\tag\{(.*?)\}")
_SYMBOL = re.compile(r'<symbol id="([^"]*)"(?:[^>]*/>|.*?</symbol>)', re.DOTALL)
_SIZE = 17  # px of a formula's letters, beside text of 16 px


def drawn(html: str) -> str:
    """Return a page with an SVG drawing instead of every formula."""
    symbols: dict[str, str] = {}

    def draw(match: re.Match[str]) -> str:
        latex = unescape(match[2]).strip()
        tag = _TAG.search(latex)
        inline = match[1] == "span"
        formula = ziamath.Latex(_TAG.sub("", latex), size=_SIZE, color="currentColor", inline=inline)
        svg = formula.svg()
        for symbol in _SYMBOL.finditer(svg):  # a glyph is drawn once a page
            symbols[symbol[1]] = symbol[0]
        place = f"vertical-align:{formula.getyofst():.2f}px" if inline else ""
        head = f'<svg class="formula" role="img" aria-label="{escape(latex)}" style="{place}" '
        svg = _SYMBOL.sub("", svg).replace("<svg ", head, 1)
        if inline:
            return svg
        number = f'<span class="number">({tag[1]})</span>' if tag else ""
        return f'<div class="formula"><div>{svg}</div>{number}</div>'

    html = _FORMULA.sub(draw, html)
    return (f'<svg class="glyphs" aria-hidden="true">{"".join(symbols.values())}</svg>' if symbols else "") + html


class _Draw(Postprocessor):
    def run(self, text: str) -> str:
        return drawn(text)


class _Formulas(Extension):
    def extendMarkdown(self, md: Markdown) -> None:  # noqa: N802
        md.postprocessors.register(_Draw(md), "formulas", 0)  # after all others


def makeExtension(**options: Any) -> Extension:  # noqa: N802
    """Return the extension, as Markdown asks for it."""
    return _Formulas(**options)
