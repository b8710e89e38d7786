"""The packed scripts, styles and libraries of the pages: what `make pages` writes from the sources."""

import hashlib
import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

import vdfmu

ROOT = Path(vdfmu.__file__).resolve().parents[1]
WEB = ROOT / "vdfmu" / "study" / "report" / "web"
BUNDLES = WEB.parent / "bundles"
TOOLS = ROOT / "requirements" / "web"
PAGES = ("run.js", "sweep.js", "study.js", "robot.js", "gallery.js", "master.js")
STYLES = ("report.css", "arm_alone.css")


def sources_of(entry: str) -> set[str]:
    """Return the files that an entry imports, and those that they import, with itself."""
    imported, waiting = set(), [entry]
    while waiting:
        if (name := waiting.pop()) not in imported:
            imported.add(name)
            text = (WEB / name).read_text(encoding="utf-8")
            waiting += re.findall(r'^(?:@?import|\}|import .*) ?(?:from )?"\./(.*?)".*;$', text, re.MULTILINE)
    return imported


@pytest.mark.parametrize("entry", [*PAGES, *STYLES])
def test_a_bundle_has_the_digest_of_its_sources(entry):
    digest = hashlib.sha256()
    for name in sorted(sources_of(entry)):
        digest.update(f"{name}\n".encode() + (WEB / name).read_bytes())
    text = (BUNDLES / entry).read_text(encoding="utf-8")
    assert text.startswith(f"/* sources {digest.hexdigest()} */\n"), "'make pages' packs it"
    assert "</script" not in text and "</style" not in text and "<!--" not in text


def test_vendored_files_are_those_of_the_pinned_build():
    built = json.loads((BUNDLES / "vendor.json").read_text())
    for name, digest in built["sha256"].items():
        assert hashlib.sha256((BUNDLES / name).read_bytes()).hexdigest() == digest, f"{name}: 'make pages' writes it"
    lock = json.loads((TOOLS / "package-lock.json").read_text())["packages"]
    assert built["versions"] == {name: lock[f"node_modules/{name}"]["version"] for name in built["versions"]}
    assert lock[""]["dependencies"] == built["versions"]
    assert all("integrity" in entry and "resolved" not in entry for name, entry in lock.items() if name)
    packed = (BUNDLES / "three_uplot.min.js").read_text()
    assert packed.count("Permission is hereby granted") == 2  # both licences
    assert "</script" not in packed and "<!--" not in packed


@pytest.mark.skipif(
    not shutil.which("node") or not (TOOLS / "node_modules" / "esbuild").exists(), reason="needs node, and make pages"
)
def test_the_bundles_are_what_esbuild_packs(tmp_path):
    subprocess.run(["node", TOOLS / "build.mjs", tmp_path], check=True)
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in BUNDLES.iterdir()}
    for path in tmp_path.iterdir():
        assert path.read_bytes() == (BUNDLES / path.name).read_bytes(), f"{path.name}: 'make pages' packs it"
