"""Documentation of several versions side by side: each in a folder of its name, ``0.1``, ``0.2``, ``dev``."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

from vdfmu.base.files import write_whole
from vdfmu.base.version import __version__

_TITLE = re.compile(r"(<title>.*?vdfmu)(?=</title>)", re.DOTALL)
_NAME = re.compile(r'(<div class="md-header__topic">\s*<span class="md-ellipsis">\s*vdfmu\s*</span>)')
_HERE = '<div class="md-version"><button class="md-version__current" aria-label="Version">{}</button></div>'
_REDIRECT = '<!doctype html><title>vdfmu</title><meta http-equiv="refresh" content="0; url={0}/index.html">\n'
_REDIRECT += '<a href="{0}/index.html">vdfmu {0}</a>\n'


def version_name(changelog: str) -> str:
    """Return the folder of what is built: ``dev`` while the changelog's first version is unreleased, then ``0.1``."""
    first = re.search(r"^## .*$", changelog, re.MULTILINE)
    unreleased = first is not None and "unreleased" in first[0].lower()
    return "dev" if unreleased else ".".join(__version__.split(".")[:2])


def add_version(built: Path, folder: Path, name: str) -> Path:
    """Copy built pages into a folder of versions and let each say its version; others stay, one of that name goes."""
    target = folder / name
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(built, target)
    for page in pages_of(target):
        text = (target / page).read_text(encoding="utf-8")
        text = _TITLE.sub(rf"\g<1> {name}", text, count=1)
        text = _NAME.sub(lambda match: match[1] + _HERE.format(name), text, count=1)
        (target / page).write_text(text, encoding="utf-8")
    list_versions(folder)
    return target


def list_versions(folder: Path) -> None:
    """Write what leads to the versions of a folder: ``versions.js``, which their pages load, and ``index.html``."""
    versions = sorted((path.parent for path in folder.glob("*/index.html")), key=_age)
    pages = {path.name: pages_of(path) for path in versions}
    write_whole(folder / "versions.js", [f"var vdfmuVersions = {json.dumps(pages)}\n".encode()])
    newest = next((name for name in pages if name != "dev"), "dev")
    write_whole(folder / "index.html", [_REDIRECT.format(newest).encode()])


def pages_of(site: Path) -> list[str]:
    """Return the pages below a folder, without those of runs, which some pages have in a frame."""
    pages = sorted(site.rglob("*.html"))
    return [page.relative_to(site).as_posix() for page in pages if page.parent.name != "live"]


def _age(version: Path) -> tuple[int, ...]:
    """Return what sorts ``dev`` first, then numbers from the newest on."""
    return tuple(-int(number) for number in re.findall(r"\d+", version.name))
