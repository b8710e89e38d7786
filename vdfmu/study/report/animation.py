"""The moving arm of a run, with its player: in a notebook, or as a page."""

from __future__ import annotations

import base64
import gzip
import os
from pathlib import Path

from vdfmu.base.errors import UsageError
from vdfmu.base.files import write_whole
from vdfmu.engine.results.results import Results
from vdfmu.study.report.page import report_page
from vdfmu.study.report.shown_run import ShownRun, read_run

_HEIGHT = 620
"""Height of the frame in a notebook before the page is there [px]."""
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
    >>> vdfmu.animate("results/tracking").save("arm.html")
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
        return f"<the arm of {self._name}: a notebook shows it, save('arm.html') writes it>"

    def _repr_html_(self) -> str:
        page = base64.b64encode(gzip.compress(self._page, mtime=0)).decode()
        return (
            f'<iframe srcdoc="{_LOADER.format(page)}" title="The arm in 3D" '
            f'style="width: 100%; height: {_HEIGHT}px; border: 0"></iframe>'
        )

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the page of the arm, which any browser opens, and return its path.

        Raises
        ------
        UsageError
            The name does not end with ``.html``.
        VdfmuError
            The file cannot be written.
        """
        path = Path(path)
        if path.suffix.lower() != ".html":
            raise UsageError(f"save: {path}: the name must end with .html.")
        write_whole(path, [self._page])
        return path
