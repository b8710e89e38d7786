"""The gallery of arms and scenarios, and moving arms: pictures of runs (``python docs/gallery.py``) and its page."""

from __future__ import annotations

import io
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
import vdfmu  # noqa: E402
from vdfmu.arm.robot import robot_names  # noqa: E402
from vdfmu.base.files import write_whole  # noqa: E402
from vdfmu.study.report.page import report_page  # noqa: E402
from vdfmu.study.report.shown_run import read_run  # noqa: E402
from vdfmu.system.scenario import load_scenario, scenario_names  # noqa: E402

PICTURES = ROOT / "docs" / "images" / "gallery"
_SIZE = 480, 336
"""Width and height of a picture [px]; a page shows it in half the size or more."""
_MOMENT = 0.62
"""Part of the run at which the arm is shown: in motion, with its path behind it."""
_MOVING = {"tracking": ("arm", 480, 36), "wall": ("wall", 420, 24)}
"""Scenarios whose arm moves in a page: name of the picture, its width [px] and number of frames."""
_SHOWN, _LAST = 5.0, 1200
"""Time in which a moving picture is shown [s], and time that its last frame stays [ms]."""


def gallery_page() -> str:
    """Return the page of the shipped arms and scenarios, in markdown."""
    robots = [(name, vdfmu.load_robot(name).description, f"vdfmu run reach --robot {name}") for name in robot_names()]
    scenarios = [(name, load_scenario(name).description, f"vdfmu run {name}") for name in scenario_names()]
    return "\n".join([
        "# Gallery\n",
        "All shipped arms and scenarios. The line below a picture runs it. "
        "[Arms and scenarios](../scenarios.md) has the sources of their numbers.\n",
        "## Arms\n", *_cards("robot", robots),
        "[Your own arm](../tutorials/own_arm.md) comes from a URDF, an MJCF or [a file](robot_file.md).\n",
        "## Scenarios\n", *_cards("scenario", scenarios),
        "Your own scenario is [one TOML file](scenario_file.md).",
        "",
    ])  # fmt: skip


def _cards(kind: str, rows: list[tuple[str, str, str]]) -> Iterator[str]:
    yield '<div class="gallery" markdown>\n'
    for name, description, command in rows:
        picture = f"![{name}](../images/gallery/{kind}_{name}.webp)"
        yield f"{picture} **{name}**<br>{description}<br>`{command}`\n"
    yield "</div>\n"


def _taken(folder: Path, shares: Sequence[float]) -> list[Any]:
    """Return the arm of the run in a folder at shares of its time, as pictures."""
    from PIL import Image

    from tests.study.page.browser import Browser

    page = folder / "arm.html"
    page.write_bytes(report_page([read_run(folder)], arm_alone=True))
    pictures: list[Any] = []
    with Browser(folder / "profile") as browser:
        browser.open(page, 1000, 700)
        first, last = browser.run("[0, -1].map((k) => report.player.motion.time.at(k))")
        for share in shares:
            browser.run(f"report.view.change('time', {first + share * (last - first)!r})")
            browser.settle()
            pictures.append(Image.open(io.BytesIO(browser.picture(".canvas"))).convert("RGB"))
    return pictures


def _write(path: Path, pictures: list[Any], width: int, height: int, quality: int) -> None:
    """Write a picture, or several that follow each other."""
    from PIL import Image

    first, *more = (picture.resize((width, height), Image.Resampling.LANCZOS) for picture in pictures)
    moving = {}
    if more:
        times = [round(1e3 * _SHOWN / len(pictures))] * len(more) + [_LAST]
        moving = {"save_all": True, "append_images": more, "duration": times, "loop": 0}
    content = io.BytesIO()
    first.save(content, "webp", quality=quality, method=6, **moving)
    write_whole(path, [content.getvalue()])
    print(path.name, len(content.getvalue()), "bytes")


def main() -> int:
    """Run what is shipped, and take a picture of each, and those that move; return the exit code."""
    runs = [("robot", name, "reach", name) for name in robot_names()]
    runs += [("scenario", name, name, None) for name in scenario_names()]
    PICTURES.mkdir(exist_ok=True)
    for kind, name, scenario, robot in runs:
        with tempfile.TemporaryDirectory() as folder:
            vdfmu.run(scenario, robot=robot, out=folder, reference=False)
            (picture,) = _taken(Path(folder), [_MOMENT])
            height = round(picture.width * _SIZE[1] / _SIZE[0])
            top = max(0, (picture.height - height) // 2)
            picture = picture.crop((0, top, picture.width, min(top + height, picture.height)))
            _write(PICTURES / f"{kind}_{name}.webp", [picture], *_SIZE, quality=72)
            if kind == "scenario" and name in _MOVING:
                target, width, frames = _MOVING[name]
                taken = _taken(Path(folder), [k / (frames - 1) for k in range(frames)])
                height = round(taken[0].height * width / taken[0].width)
                _write(PICTURES.parent / f"{target}.webp", taken, width, height, quality=70)
    return 0


if __name__ == "__main__":
    sys.exit(main())
