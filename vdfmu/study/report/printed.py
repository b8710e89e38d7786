"""``report.pdf``: the page of a run on two printed pages."""

from __future__ import annotations

import base64
from pathlib import Path

from vdfmu.base.files import PAGE_MARK, write_whole
from vdfmu.base.temporary import temporary_folder
from vdfmu.study.report.browser import Browser

_WIDTH = 703
"""Pixels across A4 within margins of 12 mm, as the style sheet sets them: 186 mm at 96 a 25.4 mm."""


def write_pdf(page: Path, target: Path) -> Path:
    """Print the page of a run into a file, by an installed Chromium or Chrome; for errors see :class:`Browser`."""
    with temporary_folder("vdfmu_print_") as profile, Browser(Path(profile)) as browser:
        browser.open(page, _WIDTH, 1000, motion="reduce")
        features = [{"name": "prefers-color-scheme", "value": "light"}]
        browser.call("Emulation.setEmulatedMedia", media="print", features=features)
        browser.settle()
        browser.run("report.printSheet()")
        browser.settle()
        found = browser.call("Page.printToPDF", printBackground=True, preferCSSPageSize=True)
    write_whole(target, [base64.b64decode(found["data"]), b"%" + PAGE_MARK + b"\n"])
    return target
