"""The pictures of the documentation are current: their pages show the commands, and nothing that made them changed.

``python docs/shots.py`` takes those again that are old.
"""

import importlib
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
IMAGES = ROOT / "docs" / "images"


def loaded():
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        return importlib.import_module("shots")
    finally:
        sys.path.remove(str(ROOT / "docs"))


SHOTS = loaded()
TABLE = {name: entry for name, entry in SHOTS.table().items() if "kept" not in entry}
DRAWN = {"arm.webp", "wall.webp", "arms.webp"}
"""Moving pictures, by docs/gallery.py."""


def test_every_picture_of_a_page_has_a_recipe():
    shown = {
        name
        for page in [ROOT / "README.md", *ROOT.glob("docs/**/*.md")]
        for name in re.findall(r"\((?:\.\./)?(?:docs/)?images/([^)/]+)\)", page.read_text(encoding="utf-8"))
    }
    drawings = {path.name for path in IMAGES.glob("*.svg")}
    assert shown - drawings - DRAWN == set(SHOTS.table())


@pytest.mark.parametrize("name", TABLE)
def test_a_page_shows_the_commands_of_its_picture(name):
    page = (ROOT / "docs" / TABLE[name]["page"]).read_text(encoding="utf-8")
    for line in filter(None, TABLE[name]["run"].splitlines()):
        assert line.strip() in page


@pytest.mark.heavy
@pytest.mark.parametrize("name", TABLE)
def test_no_picture_is_old(name):
    assert SHOTS.reasons(name, TABLE[name]) == [], "python docs/shots.py takes it again"


SLOW = {"decomposed.png", "kr300_arms.png", "kr300.png", "residuals.png", "tuning.png"}
"""Their commands take minutes; a claim or a test of its own holds what they print."""


@pytest.mark.heavy
@pytest.mark.parametrize("name", [name for name in TABLE if name not in SLOW])
def test_the_commands_still_say_what_a_picture_shows(name):
    entry = TABLE[name]
    _, output, _ = SHOTS.made(entry["page"], entry["run"], "before" in entry)
    assert SHOTS.alike(entry["said"], SHOTS.said(entry, output)), SHOTS.said(entry, output)


def test_a_picture_is_old_when_its_recipe_what_draws_it_or_its_file_changes():
    name = "report.webp"
    entry = TABLE[name] | SHOTS.digests(name, TABLE[name])
    assert SHOTS.reasons(name, entry) == []
    for key, word in (("recipe", "recipe"), ("drawn", "draws"), ("picture", "file")):
        (reason,) = SHOTS.reasons(name, entry | {key: "0"})
        assert word in reason
    assert len(SHOTS.reasons(name, entry | {"run": "vdfmu run tracking --step 0.002"})) == 1
