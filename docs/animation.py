"""Make the animation of the README: ``python docs/animation.py results/tracking/report.html``."""

from __future__ import annotations

import io
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
from tests.page.browser import Browser  # noqa: E402

FRAMES, WIDTH = 36, 480


def main(page: Path) -> None:
    """Write ``docs/images/arm.webp``."""
    frames: list[Image.Image] = []
    with tempfile.TemporaryDirectory() as profile, Browser(Path(profile)) as browser:
        browser.open(page.resolve(), 1000, 700)
        last = browser.run("report.player.motion.time.at(-1)")
        for k in range(FRAMES):
            browser.run(f"report.view.change('time', {last * k / (FRAMES - 1)})")
            browser.settle()
            picture = Image.open(io.BytesIO(browser.picture(".canvas"))).convert("RGB")
            size = WIDTH, round(picture.height * WIDTH / picture.width)
            frames.append(picture.resize(size, Image.Resampling.LANCZOS))
    frames[0].save(
        ROOT / "docs" / "images" / "arm.webp",
        save_all=True, append_images=frames[1:], duration=[140] * (FRAMES - 1) + [1200], loop=0, quality=70, method=6,
    )  # fmt: skip


if __name__ == "__main__":
    main(Path(sys.argv[1]))
