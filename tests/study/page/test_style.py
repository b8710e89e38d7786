"""The style of the pages: sizes, radii, and classes that no two components share."""

import re
from pathlib import Path

import pytest

import vdfmu

ROOT = Path(vdfmu.__file__).parent
WEB = ROOT / "study" / "report" / "web"
SHEETS = sorted(path.name for path in WEB.glob("*.css") if path.name != "report.css")
SHARED = {"base.css", "controls.css", "layout.css", "print.css", "arm_alone.css"}
"""Elements, and places and sizes of components: they may name any component."""
CLASS = re.compile(r"\.([a-z][\w-]*)")


def selectors(text: str) -> list[str]:
    """Return the selectors of a style sheet."""
    heads = re.findall(r"([^{};]+)\{", re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL))
    return [part.strip() for head in heads if not head.strip().startswith("@") for part in split(head)]


def split(head: str) -> list[str]:
    """Return the parts of a list of selectors, without the commas within parentheses."""
    return re.findall(r"(?:\([^()]*(?:\([^()]*\)[^()]*)*\)|[^,(])+", head)


def components(name: str) -> set[str]:
    """Return the classes that begin a selector of a sheet."""
    first = (re.split(r"[ >]", selector)[0] for selector in selectors((WEB / name).read_text(encoding="utf-8")))
    return {kind for selector in first if selector.startswith(".") for kind in CLASS.findall(selector)[:1]}


@pytest.mark.parametrize("name", SHEETS)
def test_a_component_is_a_class_of_one_sheet(name):
    """A class that stands alone in one sheet would also style the part of that name in another: bars, once."""
    if name in SHARED:
        return
    used = {
        kind for selector in selectors((WEB / name).read_text(encoding="utf-8")) for kind in CLASS.findall(selector)
    }
    shared = {other: components(other) & used for other in SHEETS if other not in {name, *SHARED}}
    assert {other: both for other, both in shared.items() if both} == {}


def test_the_check_of_components_sees_a_class_of_two_sheets(monkeypatch, tmp_path):
    for name in SHEETS:
        (tmp_path / name).write_text((WEB / name).read_text(encoding="utf-8"), encoding="utf-8")
    with (tmp_path / "head.css").open("a") as file:
        file.write(".share {\n  display: flex;\n}\n")
    monkeypatch.setitem(globals(), "WEB", tmp_path)
    with pytest.raises(AssertionError, match="share"):
        test_a_component_is_a_class_of_one_sheet("simulate.css")


def test_sizes_of_text_are_six_and_corners_have_one_radius():
    texts = {name: (WEB / name).read_text(encoding="utf-8") for name in SHEETS}
    sizes = re.findall(r"--size-[a-z]+(?=:)", texts["tokens.css"])
    assert len(sizes) == 6
    for name, text in texts.items():
        used = re.findall(r"font-size: (.*);", text)
        assert {*used} <= {f"var({size})" for size in sizes}, name
        corners = {part for value in re.findall(r"border-radius: (.*);", text) for part in value.split()}
        assert corners <= {"var(--radius)", "var(--round)", "0"}, name


def test_each_class_of_a_sheet_is_on_a_page():
    """No rule is dead: a script, the study room, or the frame and the diagram write the class."""
    sources = [*WEB.glob("*.js"), *(ROOT / "study").rglob("*.py"), ROOT / "base" / "page.py"]
    sources.append(ROOT / "system" / "package" / "drawing.py")
    written = "\n".join(path.read_text(encoding="utf-8") for path in sources)
    words = {*re.findall(r"[a-z][\w-]*", written)}
    sheets = [(WEB / name).read_text(encoding="utf-8") for name in SHEETS]
    used = {kind for text in sheets for selector in selectors(text) for kind in CLASS.findall(selector)}
    numbered = {"run1", "run2"}
    assert {kind for kind in used - numbered if not kind.startswith("u-") and kind not in words} == set()
