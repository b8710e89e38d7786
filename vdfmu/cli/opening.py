"""How a command ends that wrote a page: the line that opens it, and ``--open``."""

from __future__ import annotations

import webbrowser
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.text import Text

from vdfmu.base.bars import errors
from vdfmu.cli.terminal import console, say_notes

OpenOption = Annotated[bool, typer.Option("--open", help="Open the page in a browser.")]


def say_verdict(summary: Mapping[str, Any]) -> None:
    """Print the verdict on a run as a sentence, and how many checks pass."""
    from vdfmu.study.report.headline import checks_line, headline

    found = headline(summary)
    text = "; ".join(dict.fromkeys(filter(None, [found.text, checks_line(summary)])))
    if text and not (errors.quiet and found.passed):
        console.print(Text(text, style="bold" if found.passed else "bold red"), soft_wrap=True)


def say_page(page: Path, opened: bool) -> None:
    """Print how to open a page, as a link where the terminal has them, and open it if that is wanted."""
    address = page.resolve().as_uri()
    if not errors.quiet and page.exists():
        console.print(Text.assemble("Open ", (str(page), f"link {address}")), soft_wrap=True)
    if opened and not webbrowser.open(address):
        say_notes([f"{page}: expected a browser to open it in, found none."])
