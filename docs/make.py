"""Build the documentation: write the pages that are made from the code, then all as HTML.

``python docs/make.py --reference`` only writes the pages of `docs/reference` that are made from the code, and the
files of `ssp/tracking`.

Pictures of pages and figures that are old are taken again, by ``shots``, where Chromium is installed.

``site`` gets a folder for the version, ``site/0.1`` or ``site/dev``, and keeps those of other versions.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import shots
from gallery import gallery_page
from interface_pages import interface_page, robot_file_page
from notebook_pages import NOTEBOOKS, page
from reference_pages import command_line_page, rules_page, scenario_file_page
from versions import add_version, version_name

import vdfmu
from vdfmu.base.files import write_whole
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.package.write import system_texts
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.replace import unfolded

DOCS = Path(__file__).resolve().parent
PAGES = {
    "reference/gallery.md": gallery_page,
    "reference/interface.md": interface_page,
    "reference/robot_file.md": robot_file_page,
    "reference/command_line.md": command_line_page,
    "reference/scenario_file.md": scenario_file_page,
    "reference/rules.md": rules_page,
}
"""Page to the function that makes it. A test holds the kept pages against these functions."""

_FROM_ROOT = re.compile(r'(\b(?:href|src)=")/([^"/][^"]*)?"')
LIVE = ("tracking", "wall")
"""Scenarios whose pages readers can touch, in frames of the documentation."""

_SHIM = re.compile(r'src="https://[^"]*iframe-worker[^"]*"')


def ssp_texts() -> dict[str, bytes]:
    """Return the files of ``ssp/tracking``: what the package of the paper's tracking study has besides its FMUs."""
    return system_texts(SystemDescription(unfolded(load_scenario("tracking"))))


def main() -> int:
    """Write the pages, build them, and add them to a folder of versions; return the exit code."""
    parser = argparse.ArgumentParser(description="Build the documentation into a folder of versions, beside others.")
    parser.add_argument("--into", type=Path, default=DOCS.parent / "site", metavar="FOLDER")
    changelog = (DOCS.parent / "CHANGELOG.md").read_text(encoding="utf-8")
    parser.add_argument("--reference", action="store_true", help="only write what is made from the code")
    parser.add_argument("--name", default=version_name(changelog), help="folder of this version, %(default)s")
    arguments = parser.parse_args()
    for name, made in PAGES.items():
        write_whole(DOCS / name, [made().encode()])
    for name, text in ssp_texts().items():
        write_whole(DOCS.parent / "ssp" / "tracking" / name, [text])
    if arguments.reference:
        return 0
    if shutil.which("chromium") and shots.main([]):
        return 1
    for name in NOTEBOOKS:
        text, pictures = page(name)
        for file, content in {f"{name}.md": text.encode(), **pictures}.items():
            write_whole(DOCS / "notebooks" / file, [content])
    paths = [str(DOCS), str(DOCS.parent), os.environ.get("PYTHONPATH", "")]
    done = subprocess.run(
        [sys.executable, "-m", "zensical", "build", "--clean", "--strict"],
        cwd=DOCS.parent,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))},
        check=False,
    )
    site = DOCS.parent / "build" / "site"
    for program in (
        *site.glob("*.py"),
        *site.glob("*.toml"),
        *site.rglob("*.ipynb"),
    ):  # it copies all that it does not know
        program.unlink()
    shutil.rmtree(site / "__pycache__", ignore_errors=True)
    for built in site.rglob("*.html"):  # what search needs from disk comes with the pages, not from a network
        root = "../" * (len(built.relative_to(site).parts) - 1)
        text = _SHIM.sub(f'src="{root}js/iframe-worker.js"', built.read_text(encoding="utf-8"))
        if built.name == "404.html":  # the only one whose addresses start at the root of a server
            text = _FROM_ROOT.sub(lambda match: f'{match[1]}{match[2] or "index.html"}"', text)
            text = text.replace('"base":"/"', '"base":"."').replace('"search":"/', '"search":"')
        built.write_text(text, encoding="utf-8")
    for name in LIVE:
        with tempfile.TemporaryDirectory() as folder:
            vdfmu.run(name, out=folder, simulate=True)
            (site / "live").mkdir(parents=True, exist_ok=True)
            shutil.copy(Path(folder) / "report.html", site / "live" / f"{name}.html")
    if not done.returncode:
        print(f"Written to {add_version(site, arguments.into, arguments.name) / 'index.html'}")
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
