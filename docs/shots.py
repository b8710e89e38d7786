"""Take the pictures of runs, pages and figures: ``python docs/shots.py [WORD ...]``, by default those that are old.

``docs/pictures.toml`` says what each is made of, and keeps what it was made of last.
"""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
import tempfile
import tomllib
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
from tests.docs.pages import environment, read_blocks  # noqa: E402
from vdfmu.base.files import write_whole  # noqa: E402

TABLE = ROOT / "docs" / "pictures.toml"
IMAGES = ROOT / "docs" / "images"
_MADE = ("said", "recipe", "drawn", "picture")
"""What this module writes into the table."""
_PACKED = ROOT / "vdfmu" / "study" / "report" / "bundles"
_PAGES = ("study/report/page.py", "study/report/parts.py", "extras/robots/robot_page.py")
_DRAWING = ("vdfmu/extras/pictures/style.py", "vdfmu/extras/pictures/picture.py")
_NUMBER = re.compile(r"-?\d+\.?\d*(?:e[-+]?\d+)?")

Entry = dict[str, Any]


def table() -> dict[str, Entry]:
    """Return the pictures: file in docs/images to what it is made of."""
    return tomllib.loads(TABLE.read_text(encoding="utf-8"))


def _digest(*contents: bytes) -> str:
    return sha256(b"\0".join(contents)).hexdigest()[:16]


def digests(name: str, entry: Entry) -> dict[str, str]:
    """Return the digests of a recipe, of the scripts or modules that draw it, and of the picture."""
    recipe = repr(sorted((key, value) for key, value in entry.items() if key not in _MADE)).encode()
    page = str(entry.get("take", "")).partition("#")[0].endswith(".html")
    drawing = (
        [*sorted(_PACKED.glob("*.*s")), *(ROOT / "vdfmu" / each for each in _PAGES)]
        if page
        else [ROOT / each for each in _DRAWING]
    )
    picture = IMAGES / name
    return {
        "recipe": _digest(recipe),
        "drawn": _digest(*(path.read_bytes() for path in drawing)),
        "picture": _digest(picture.read_bytes()) if picture.exists() else "",
    }


def reasons(name: str, entry: Entry) -> list[str]:
    """Return why a picture is old: which of its digests have changed since it was taken."""
    words = {"recipe": "its recipe", "drawn": "what draws it", "picture": "the file"}
    now = {} if "kept" in entry else digests(name, entry)
    return [f"{words[key]} has changed" for key, value in now.items() if entry.get(key) != value]


@cache
def made(page: str, run: str, before: bool) -> tuple[Path, str, tempfile.TemporaryDirectory[str]]:
    """Run the commands of a page in a folder with the files that the page shows; return the folder and the output.

    `before`: run the page's blocks of Python above the commands first.
    """
    keeper = tempfile.TemporaryDirectory()
    folder = Path(keeper.name)
    (folder / "examples").symlink_to(ROOT / "examples")
    for kind, options, body, *_ in read_blocks(ROOT / "docs" / page):
        if title := re.search(r'title="([^"]+)"', options):
            (folder / title[1]).write_text(body, encoding="utf-8")
        elif before and kind == "python":
            subprocess.run([sys.executable, "-c", body], cwd=folder, env=environment(), check=True)
        elif before and run.strip() in body:
            break
    surroundings = environment() | {"COLUMNS": "120"}
    done = subprocess.run(
        ["bash", "-ec", run], cwd=folder, env=surroundings, text=True, check=False,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    if done.returncode > 1:  # a run that is judged failed ends by 1
        raise RuntimeError(f"{page}: {run}\n{done.stdout}")
    return folder, done.stdout, keeper


def said(entry: Entry, output: str) -> str:
    """Return the line of the output that says what the picture shows, without lengths of time and run of blanks."""
    for line in output.splitlines():
        if re.search(entry["line"], line):
            return " ".join(line.split())
    raise ValueError(f"expected a line with {entry['line']!r} in\n{output}")


def alike(kept: str, now: str) -> bool:
    """Whether two lines say the same, with numbers within 5 %: what a reader sees in a picture."""
    numbers = [[float(x) for x in _NUMBER.findall(line)] for line in (kept, now)]
    return _NUMBER.sub("0", kept) == _NUMBER.sub("0", now) and all(
        abs(a - b) <= 0.05 * max(abs(a), abs(b)) for a, b in zip(*numbers, strict=True)
    )


def _shot(entry: Entry, page: Path, fragment: str) -> bytes:
    """Return the picture of a page, or of a part of it, as PNG."""
    from tests.study.page.browser import Browser, calm

    width, height = entry.get("size", (1280, 900))
    with tempfile.TemporaryDirectory() as profile, Browser(Path(profile)) as browser:
        address = page.resolve().as_uri() + (f"#{fragment}" if fragment else "")
        browser.open(address, width, height, scale=entry.get("scale", 1.5))
        browser.run("document.querySelector('#simulate')?.scrollIntoView()")
        calm(browser)
        browser.run("scrollTo(0, 0)")
        if "show" in entry:
            browser.run(entry["show"])
        calm(browser)
        if browser.problems:
            raise RuntimeError(f"{page.name}: {browser.problems}")
        return browser.picture(entry.get("of", "")) if "of" in entry else browser.window()


def take(name: str, entry: Entry) -> Entry:
    """Make a picture; return its entry with what it was made of."""
    from PIL import Image

    folder, output, _ = made(entry["page"], entry["run"], "before" in entry)
    file, _, fragment = entry["take"].partition("#")
    if file.endswith(".html"):
        picture = Image.open(io.BytesIO(_shot(entry, folder / file, fragment))).convert("RGB")
        content = io.BytesIO()
        picture.save(content, *(("webp",) if name.endswith("webp") else ("png",)), quality=85, method=6, optimize=True)
        written = content.getvalue()
    else:
        written = (folder / file).read_bytes()
    write_whole(IMAGES / name, [written])
    return entry | {"said": said(entry, output)} | digests(name, entry)


def keep(name: str, entry: Entry) -> None:
    """Write what a picture was made of below its recipe."""
    text = TABLE.read_text(encoding="utf-8")
    head, start, rest = text.partition(f'["{name}"]\n')
    body, following, tail = rest.partition("\n[")
    lines = body.rstrip("\n").split("\n")
    lines = [line for line in lines if not line.startswith(tuple(f"{key} = " for key in _MADE))]
    lines += [f"{key} = {json.dumps(entry[key], ensure_ascii=False)}" for key in _MADE]
    write_whole(TABLE, [(head + start + "\n".join(lines) + "\n" + following + tail).encode()])


def main(words: list[str]) -> int:
    """Take the pictures with a word in their name, or those that are old; return the exit code."""
    failures = 0
    for name, entry in table().items():
        old = reasons(name, entry)
        if "kept" in entry or not (any(word in name for word in words) if words else old):
            continue
        try:
            keep(name, take(name, entry))
            print(f"{name}: {(IMAGES / name).stat().st_size} bytes", flush=True)
        except (RuntimeError, ValueError, OSError) as error:
            failures += 1
            print(f"{name}: {error}", file=sys.stderr, flush=True)
    return int(failures > 0)


if __name__ == "__main__":
    os.chdir(ROOT)
    sys.exit(main(sys.argv[1:]))
