"""The arm of a run, moving: in a notebook with its player, as a page, or as a picture for slides."""

from __future__ import annotations

import base64
import gzip
import io
import os
from pathlib import Path
from typing import Any

from vdfmu.base.errors import UsageError
from vdfmu.base.files import temporary_folder, write_whole
from vdfmu.base.progress import Shown, counted, with_progress
from vdfmu.engine.results.results import Results
from vdfmu.study.report.browser import Browser
from vdfmu.study.report.page import report_page
from vdfmu.study.report.shown_run import ShownRun, read_run

_HEIGHT = 620
"""Height of the frame in a notebook before the page is there [px]."""
_WINDOW, _CANVAS = (1000, 700), 600
"""Size of the window in which pictures are taken, and the least width of the arm's picture in it [px]."""
_LAST = 1200
"""Time that the last picture stays [ms]."""
_LOADER = (
    "<script>(async () => {{ const bytes = Uint8Array.from(atob('{}'), (c) => c.charCodeAt(0)); "
    "const page = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip')); "
    "document.write(await new Response(page).text()); document.close(); "
    "addEventListener('report', () => {{ if (frameElement) frameElement.style.height = "
    "document.getElementById('arm').offsetHeight + 2 + 'px'; }}); }})()</script>"
)
"""Unpacks the page, and gives its frame the height of the arm's section."""


def animate(run: Results | str | os.PathLike[str]) -> Animation:
    """Let the arm of a run move.

    Parameters
    ----------
    run : Results or path
        Results of `vdfmu.run`, or the folder in which it or ``vdfmu run`` wrote its results.

    Returns
    -------
    Animation
        A notebook shows it, with a player; `Animation.save` writes it.

    Raises
    ------
    UsageError
        The results are not an arm's, or do not have its positions.

    Examples
    --------
    >>> vdfmu.animate(vdfmu.run("tracking"))
    >>> vdfmu.animate("results/tracking").save("arm.gif")
    """
    if isinstance(run, Results):
        shown = ShownRun("run", run, run.summary, Path(run.summary.get("package", "")))
    else:
        shown = read_run(Path(run))
    if "arm" not in shown.summary:
        raise UsageError(
            "animate: the results are not those of an arm: expected what vdfmu.run returned, or a folder that it or "
            "'vdfmu run' wrote; any other run has signals, which its plot() draws."
        )
    if "plant.q" not in shown.results:
        raise UsageError("animate: expected results with the positions of the joints, plant.q; they have none.")
    return Animation(shown)


class Animation:
    """The arm of a run, moving; made by :func:`vdfmu.animate`."""

    def __init__(self, run: ShownRun) -> None:
        self._page = report_page([run], arm_alone=True)
        self._name = f"{run.summary.get('scenario', run.name)}, {run.summary.get('robot', 'an arm')}"

    def __repr__(self) -> str:
        return f"<the arm of {self._name}: a notebook shows it, save('arm.html') or save('arm.gif') writes it>"

    def _repr_html_(self) -> str:
        page = base64.b64encode(gzip.compress(self._page, mtime=0)).decode()
        return (
            f'<iframe srcdoc="{_LOADER.format(page)}" title="The arm in 3D" '
            f'style="width: 100%; height: {_HEIGHT}px; border: 0"></iframe>'
        )

    @with_progress
    def save(
        self,
        path: str | os.PathLike[str],
        *,
        width: int = 480,
        frames: int = 36,
        seconds: float = 5.0,
        progress: Shown = None,
    ) -> Path:
        """Write the arm to a file.

        Parameters
        ----------
        path : path
            With the suffix ``.html`` a page with the player, which any browser opens. ``.gif`` and ``.webp``: pictures
            that move, for slides; they are taken in Chromium or Chrome, which must be installed.
        width : int [px], optional
            Width of the pictures.
        frames : int, optional
            Number of pictures, at equal distances from the start to the end of the run.
        seconds : float [s], optional
            Time in which they are shown.
        progress : callable or bool, optional
            Called with stage, done, total; True shows bars, on the terminal or in the notebook.

        Raises
        ------
        UsageError
            The suffix is another, an option is not positive, or there is no such browser.
        VdfmuError
            The file cannot be written.
        """
        path = Path(path)
        form = path.suffix.lower()
        if form not in (".html", ".gif", ".webp"):
            raise UsageError(f"save: {path}: expected a name that ends with .html, .gif or .webp.")
        if not (width >= 1 and frames >= 2 and seconds > 0.0):
            raise UsageError(
                f"save: expected width >= 1, frames >= 2 and seconds > 0, got {width}, {frames} and {seconds:g}."
            )
        write_whole(path, [self._page if form == ".html" else self._pictures(form[1:], width, frames, seconds)])
        return path

    def _pictures(self, form: str, width: int, frames: int, seconds: float) -> bytes:
        from PIL import Image

        taken: list[Any] = []
        with temporary_folder("vdfmu_page_") as folder:
            page = Path(folder) / "arm.html"
            page.write_bytes(self._page)
            with Browser(Path(folder) / "profile") as browser:
                browser.open(page, *_WINDOW, scale=1.0 if width <= _CANVAS else 2.0)
                first, last = browser.run("[0, -1].map((k) => report.player.motion.time.at(k))")
                for k in counted("pictures", range(frames), frames):
                    browser.run(f"report.view.change('time', {first + (last - first) * k / (frames - 1)!r})")
                    browser.settle()
                    picture = Image.open(io.BytesIO(browser.picture(".canvas"))).convert("RGB")
                    size = width, round(picture.height * width / picture.width)
                    taken.append(picture.resize(size, Image.Resampling.LANCZOS))
        if form == "gif":  # it is small if its pictures have the same colours, and even areas stay even
            colours = taken[frames // 2].quantize(256)
            taken = [picture.quantize(palette=colours, dither=Image.Dither.NONE) for picture in taken]
        file = io.BytesIO()
        times = [round(1e3 * seconds / frames)] * (frames - 1) + [_LAST]
        taken[0].save(file, form, save_all=True, append_images=taken[1:], duration=times, loop=0, quality=70, method=6)
        return file.getvalue()
