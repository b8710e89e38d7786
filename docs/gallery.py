"""The gallery of arms and scenarios: its pictures, from runs (``python docs/gallery.py``), and its page."""

from __future__ import annotations

import io
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import vdfmu
from vdfmu.base.files import write_whole
from vdfmu.study.report.browser import Browser
from vdfmu.study.report.page import report_page
from vdfmu.study.report.shown_run import read_run

PICTURES = Path(__file__).resolve().parent / "images" / "gallery"
_SIZE = 480, 336
"""Width and height of a picture [px]; a page shows it in half the size or more."""
_MOMENT = 0.62
"""Part of the run at which the arm is shown: in motion, with its path behind it."""


def gallery_page() -> str:
    """Return the page of the shipped arms and scenarios, in markdown."""
    robots = [
        (name, vdfmu.load_robot(name).description, f"vdfmu run reach --robot {name}") for name in vdfmu.robot_names()
    ]
    scenarios = [(name, vdfmu.load_scenario(name).description, f"vdfmu run {name}") for name in vdfmu.scenario_names()]
    return "\n".join([
        "# Arms and scenarios\n",
        "Everything that is shipped, drawn by the page that each run writes. The line below a picture runs it; where "
        "the numbers of an arm are from is in [The shipped arms](arms.md).\n",
        "## Arms\n", *_cards("robot", robots),
        "An arm of yours comes [from a URDF or MJCF](importing.md), or is [written by hand](robot_file.md).\n",
        "## Scenarios\n", *_cards("scenario", scenarios),
        "A scenario of yours is [one TOML file](scenario_file.md).",
        "",
    ])  # fmt: skip


def _cards(kind: str, rows: list[tuple[str, str, str]]) -> Iterator[str]:
    yield '<div class="gallery" markdown>\n'
    for name, description, command in rows:
        picture = f"![{name}](images/gallery/{kind}_{name}.webp)"
        yield f"{picture} **{name}**<br>{description}<br>`{command}`\n"
    yield "</div>\n"


def main() -> int:
    """Run what is shipped, and take a picture of each; return the exit code."""
    from PIL import Image

    runs = [("robot", name, "reach", name) for name in vdfmu.robot_names()]
    runs += [("scenario", name, name, None) for name in vdfmu.scenario_names()]
    PICTURES.mkdir(exist_ok=True)
    for kind, name, scenario, robot in runs:
        with tempfile.TemporaryDirectory() as folder:
            vdfmu.run(scenario, robot=robot, out=folder, reference=False)
            page = Path(folder) / "arm.html"
            page.write_bytes(report_page([read_run(Path(folder))], arm_alone=True))
            with Browser(Path(folder) / "profile") as browser:
                browser.open(page, 1000, 700, scale=1.0)
                first, last = browser.run("[0, -1].map((k) => report.player.motion.time.at(k))")
                browser.run(f"report.view.change('time', {first + _MOMENT * (last - first)!r})")
                browser.settle()
                picture = Image.open(io.BytesIO(browser.picture(".canvas"))).convert("RGB")
            height = round(picture.width * _SIZE[1] / _SIZE[0])
            top = max(0, (picture.height - height) // 2)
            picture = picture.crop((0, top, picture.width, min(top + height, picture.height)))
            content = io.BytesIO()
            picture.resize(_SIZE, Image.Resampling.LANCZOS).save(content, "webp", quality=72, method=6)
            write_whole(PICTURES / f"{kind}_{name}.webp", [content.getvalue()])
            print(f"{kind}_{name}.webp", len(content.getvalue()), "bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
