"""The words of the documentation: sentences, tables and pages keep to the limits of plain prose.

The limits come from the best documentation of the field: mean sentence 13 to 17 words, nine of ten below 28, semicolons
in 0 to 3 % of sentences, facts and no prose in tables.
"""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
WRITTEN = ROOT.joinpath(".gitignore").read_text(encoding="utf-8").split()
SKIPPED = ("docs/listing/*", "docs/reference/*", *(pattern for pattern in WRITTEN if pattern.startswith("docs/")))
PAGES = [
    page for page in sorted((ROOT / "docs").rglob("*.md")) if not any(page.relative_to(ROOT).match(s) for s in SKIPPED)
]
LIMITS = {"mean": 16.0, "ninth of ten": 27, "over 30, %": 6.0, "semicolons, %": 3.0, "in tables, %": 20.0}


def split(text):
    text = re.sub(r"^---\n.*?\n---\n", "", text, flags=re.DOTALL)
    text = re.sub(r"^[ \t]*(```|~~~).*?^[ \t]*\1[ \t]*$", "\n\n", text, flags=re.DOTALL | re.MULTILINE)
    rows = re.findall(r"^\s*\|(.*)\|\s*$", text, re.MULTILINE)
    cells = [cell.strip() for row in rows if not re.fullmatch(r"[\s|:-]+", row) for cell in row.split("|")]
    text = re.sub(r"^\s*\|.*$|^#+\s.*$", "\n", text, flags=re.MULTILINE)
    text = re.sub(r"<!--.*?-->|<[^>\n]+>|\$\$.*?\$\$|!\[[^\]]*\]\([^)]*\)", "", text, flags=re.DOTALL)
    text = re.sub(r"`([^`]*)`", r"\1", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text))
    sentences = []
    for part in re.split(r"\n\s*\n|\n(?=\s*(?:[-*+]|\d+\.)\s)", text):
        flat = re.sub(r"^(?:[-*+]|\d+\.)\s+", "", " ".join(part.split())).replace("*", "")
        for sentence in re.split(r"(?<=[.!?])[\"')]?\s+(?=[\"'(]?[A-Z0-9])", re.sub(r"\b(Eq|no)\.", r"\1", flat)):
            count = len(re.findall(r"[A-Za-z][A-Za-z'\-]*", sentence))
            if count >= 3 and re.search(r"[.!?:][\"')]?$", sentence):
                sentences.append((count, sentence))
    return sentences, cells


def measured(texts):
    parts = [split(text) for text in texts]
    sentences = [sentence for prose, _ in parts for sentence in prose]
    counts = sorted(count for count, _ in sentences)
    words, inside = sum(counts), sum(len(cell.split()) for _, cells in parts for cell in cells)
    share = 100.0 / len(counts)
    values = (
        words / len(counts), counts[int(0.9 * len(counts))], share * sum(count > 30 for count in counts),
        share * sum(";" in sentence for _, sentence in sentences), 100.0 * inside / (inside + words),
    )  # fmt: skip
    return dict(zip(LIMITS, values, strict=True))


PHRASES = {
    "what as a noun": r"(?<![?])\b[Ww]hat (?!(?:is|are|do|does|if|next|else)\b[^.]*\?)\w+",
    "that of, those": r"\b(?:that of|those of|those that|those which)\b",
    "one as a noun": r"\b(?:the one|the ones|one that|ones that|this one|each one|of one's)\b",
    "of which": r"\b(?:of|for|by|from|in|to|with) which\b",
    ", which": r", which\b",
    "where for if": r"\bwhere (?:a|an|the|it|there|no|one|they)\b",
    "is no, has none": r"\b(?:is|are|has|have) (?:no|none)\b(?! longer)",
    "in place of": r"\b(?:but for|in place of|for want of|from which on|till here|hold against|held against)\b",
    "of its own": r"\bof (?:its|their|one's|yours|his|your) own\b|\bof (?:ours|yours|theirs)\b",
    "tells": r"\b(?:is|are|was) told\b|\btells?\b",
}
"""Phrases that other packages of the field use less than once in 1,000 words."""


def test_the_documentation_keeps_the_limits():
    groups = {"docs": PAGES} | {name: [ROOT / name] for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")}
    for name, pages in groups.items():
        values = measured([page.read_text(encoding="utf-8") for page in pages])
        assert {limit: value for limit, value in values.items() if value > LIMITS[limit]} == {}, name
    assert len(PAGES) <= 32


def texts_of(files):
    """Return docstrings and messages: all longer texts in files of Python."""
    nodes = (node for file in files for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
    texts = (node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str))
    return "\n".join(text for text in texts if " " in text and len(text) > 25)


def test_docstrings_and_messages_use_the_words_of_the_field():
    text = texts_of((ROOT / "vdfmu").rglob("*.py"))
    rates = {name: 1000 * len(re.findall(phrase, text)) / len(text.split()) for name, phrase in PHRASES.items()}
    assert {name: rate for name, rate in rates.items() if rate > 1.0} == {}
    assert all(re.search(phrase, "The sum of what it has, of which it tells, is that of one that is no sum of its own, "
                         "where it is in place of the one, which") for phrase in PHRASES.values())  # fmt: skip


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_is_short_and_its_cells_are_facts(page):
    sentences, cells = split(page.read_text(encoding="utf-8"))
    assert sum(count for count, _ in sentences) <= 1500
    assert [cell for cell in cells if len(cell.split()) > 20] == []


def test_a_long_sentence_and_prose_in_a_table_are_seen():
    text = (
        f"One two three. {'Word ' * 31}end; it is. Four five six.\n\n| a | b |\n| --- | --- |\n| {'fact ' * 80} | x |\n"
    )
    values = measured([text])
    assert all(values[name] > LIMITS[name] for name in ("over 30, %", "semicolons, %", "in tables, %"))
    assert values["mean"] == pytest.approx((3 + 34 + 3) / 3)
