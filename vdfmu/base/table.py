"""The one style of tables on the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table


def plain_table(*headings: str, title: str = "", show_header: bool = True) -> Table:
    """Return a table with a line below its headings, whose cells are never cut off."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title=Text(title, style="bold") if title else None, title_justify="left", caption_justify="left",
        box=SIMPLE_HEAD if show_header else None, show_header=show_header, show_edge=False, padding=(0, 1, 0, 0),
        pad_edge=False,
    )  # fmt: skip
    for heading in headings:
        table.add_column(Text(heading), overflow="fold")
    return table
