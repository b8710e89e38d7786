"""The frame of a page, of an FMU, a package, a run or a parameter study, that needs no other file and no network."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from hashlib import sha256
from html import escape

from vdfmu.base.files import PAGE_MARK

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
    what: str,
    body: str,
    width: int,
    head: str = "",
    *,
    tab: str = "",
    lead: str = "",
    scripts: Sequence[str] = (),
) -> bytes:
    """Return a page of a width [rem] with its title, a line on what it is about, and HTML, also for its head.

    `tab` is the title of the browser's tab if it is another one, `lead` HTML below the title. `scripts`: the module
    that the page runs, then the scripts that the module adds. A browser runs no other script of the page.
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
<style>{_STYLE}body {{ max-width: {width}rem; }}
</style>{head}
</head>
<body>
<main>
<h1>{escape(title)}</h1>
{lead}<p class="what">{escape(what)}</p>
{body}
</main>
{module}</body>
</html>
""".encode("utf-8", "backslashreplace")


def _policy(scripts: Sequence[str]) -> str:
    """Return the Content-Security-Policy: no request to a network, no script but these (CSP 3, 6.7.2.3).

    With scripts, WebAssembly runs too, and so do workers that the page makes.
    """
    digests = (base64.b64encode(sha256(text.encode()).digest()).decode() for text in scripts)
    sources = "".join(f"'sha256-{digest}' " for digest in digests)
    allowed = f"script-src {sources}'wasm-unsafe-eval'; worker-src blob:; " if scripts else ""
    content = f"default-src 'none'; {allowed}style-src 'unsafe-inline'; img-src data:"
    return f'<meta http-equiv="Content-Security-Policy" content="{content}">'


def table(heads: Sequence[str], rows: Iterable[Sequence[str]], classes: Sequence[str]) -> str:
    """Return a table of cells that are HTML; `classes` are those of the columns."""
    lines = ["<table>", "<tr>" + "".join(f"<th>{head}</th>" for head in heads) + "</tr>"]
    tags = [f'<td class="{name}">' if name else "<td>" for name in classes]
    for row in rows:
        cells = (f"{tag}{cell}</td>" for tag, cell in zip(tags, row, strict=True))
        lines.append(f"<tr>{''.join(cells)}</tr>")
    return "\n".join([*lines, "</table>"])
