"""Frame and colours of HTML pages that need no other files and no network."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Iterable, Sequence
from hashlib import sha256
from html import escape

from vdfmu.base.files import PAGE_MARK

LIGHT = ("#015e9c", "#b94b01", "#088158", "#c76999", "#c88507", "#369bda", "#060809")
"""Colours of curves and values on white: close to Okabe and Ito (2008) without yellow, with all pairs distinct.

At least half of all readers, with protanopia or deuteranopia too, can tell lines apart that are 0.1 degree of the
visual field wide, and each has a contrast of 3 to the page (WCAG 2.1, 1.4.11): `tests/study/report/test_palette.py`
calculates both.
"""
DARK = ("#5daced", "#e47c3c", "#47cda0", "#bc75a1", "#efbc44", "#99d2f6", "#eef1f0")
"""The same colours in the same order on a dark page."""
NEGATIVE, POSITIVE = 0, 1
"""Indices of the colours of values below and above 0."""
_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1f2328; margin: 2rem auto; padding: 0 1rem; }
h1 { margin-bottom: 0; } h2 { margin-top: 2.2rem; border-bottom: 1px solid #d0d7de; }
p.what { margin-top: .3rem; color: #57606a; }
table { border-collapse: collapse; font-size: 14px; margin: 1rem 0; }
th, td { text-align: left; vertical-align: top; padding: .2rem .8rem .2rem 0; border-bottom: 1px solid #eaeef2; }
td.name, td.ref, td.value { font-family: ui-monospace, monospace; } td.name, td.ref { white-space: nowrap; }
code, pre { background: #f3f4f6; border-radius: 3px; } code { padding: 0 .25em; }
pre { padding: .6rem .8rem; overflow-x: auto; font: 14px/1.45 ui-monospace, monospace; }
summary { cursor: pointer; font-weight: 600; margin: .4rem 0; }
.wide { overflow-x: auto; }
img { max-width: 100%; display: block; margin: 1rem 0; }
"""


def page(
    title: str,
    subtitle: str,
    body: str,
    width: int,
    head: str = "",
    *,
    tab: str = "",
    first: str = "",
    lead: str = "",
    scripts: Sequence[str] = (),
) -> bytes:
    """Return a page of a `width` [rem] with a title, a line about its content, and HTML for the body and the head.

    `tab` is the title of the browser's tab if different, `first` HTML above the title, `lead` HTML below it. `scripts`:
    the module that the page runs, then the scripts that this module adds. The browser refuses any other script.
    """
    module = f'<script type="module">{scripts[0]}</script>\n' if scripts else ""
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
{_policy(scripts)}
{PAGE_MARK.decode()}
<title>{escape(tab or title)}</title>
<style>@layer page {{{_STYLE}body {{ max-width: {width}rem; }} }}
</style>{head}
</head>
<body>
{first}<header>
<h1>{escape(title)}</h1>
{lead}<p class="what">{escape(subtitle)}</p>
</header>
<main>
{body}
</main>
{module}</body>
</html>
""".encode("utf-8", "backslashreplace")


def compressed(content: bytes) -> str:
    """Return content compressed for ``unzip`` in ``web/packed.js``."""
    return base64.b64encode(gzip.compress(content, 6, mtime=0)).decode()


def _policy(scripts: Sequence[str]) -> str:
    """Return the Content-Security-Policy: no network requests, and no scripts except these (CSP 3, 6.7.2.3).

    If there are scripts, the page may also run WebAssembly and workers.
    """
    digests = (base64.b64encode(sha256(text.encode()).digest()).decode() for text in scripts)
    sources = "".join(f"'sha256-{digest}' " for digest in digests)
    allowed = f"script-src {sources}'wasm-unsafe-eval'; worker-src blob:; " if scripts else ""
    content = f"default-src 'none'; {allowed}style-src 'unsafe-inline'; img-src data:"
    return f'<meta http-equiv="Content-Security-Policy" content="{content}">'


def table(heads: Sequence[str], rows: Iterable[Sequence[str]], classes: Sequence[str]) -> str:
    """Return a table with cells in HTML and a class for each column. It has no headings if all are empty."""
    cells = "".join(f"<th>{head}</th>" if head else "<td></td>" for head in heads)
    lines = ["<table>", *([f"<tr>{cells}</tr>"] if any(heads) else [])]
    tags = [f'<td class="{name}">' if name else "<td>" for name in classes]
    for row in rows:
        cells = (f"{tag}{cell}</td>" for tag, cell in zip(tags, row, strict=True))
        lines.append(f"<tr>{''.join(cells)}</tr>")
    return "\n".join([*lines, "</table>"])


def style_sheet() -> str:
    """Return the colours as CSS variables: ``--joint-1`` and so on, ``--joints``, ``--negative``, ``--positive``."""

    def variables(colours: tuple[str, ...]) -> str:
        named = {f"joint-{i}": colour for i, colour in enumerate(colours, 1)}
        named |= {"negative": colours[NEGATIVE], "positive": colours[POSITIVE], "joints": str(len(colours))}
        return ":root{" + ";".join(f"--{name}:{colour}" for name, colour in named.items()) + "}"

    return f"{variables(LIGHT)} @media (prefers-color-scheme: dark) {{ {variables(DARK)} }}"
