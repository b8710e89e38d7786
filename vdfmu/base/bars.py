"""Output on a terminal or in a notebook: escaped text, progress bars and tables."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Self

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from vdfmu.base.errors import LOG
from vdfmu.base.text import shown

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID
    from rich.table import Table


class EscapedTerminal(Console):
    """Console that escapes control characters in text, except rich's own, and does not turn ``:x:`` into an emoji."""

    def __init__(self, **options: Any) -> None:
        super().__init__(highlight=False, emoji=False, **options)

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as rich does, but without trailing blanks in tables when the output is a pipe or a file."""
        items = [shown(item) if isinstance(item, str) else item for item in objects]
        if self.is_terminal or self.is_jupyter:
            super().print(*items, **options)
            return
        with self.capture() as said:
            super().print(*items, **options)
        self.file.write(re.sub(" +$", "", said.get(), flags=re.MULTILINE))
        self.file.flush()

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Render as rich does."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=shown(segment.text))


errors = EscapedTerminal(stderr=True)
"""Console for everything but results. ``errors.quiet`` silences it."""
_SOON = 0.5
"""Time [s] after which the moving line and a rate appear."""
_LONG, _SELDOM = ("evaluations",), 10.0
"""Stages that take minutes, and the time [s] between two lines about them where bars cannot move, as in a pipe."""


class Bars:
    """Progress bars, one per stage. With a title there is also a moving line after half a second."""

    def __init__(self, title: str = "") -> None:
        self._title = title
        self._lock = threading.RLock()
        self._timer: threading.Timer | None = None
        self._progress: Progress | None = None
        self._tasks: dict[str, TaskID] = {}
        self._began: dict[str, float] = {}
        self._said: dict[str, float] = {}

    def __enter__(self) -> Self:
        if self._title and _seen():
            self._timer = threading.Timer(_SOON, self._show)
            self._timer.daemon = True
            self._timer.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        with self._lock:
            progress, self._progress, tasks, self._tasks = self._progress, None, self._tasks, {}
            if progress is not None:
                if "" in tasks:
                    progress.remove_task(tasks[""])
                progress.stop()

    def rest(self) -> None:
        """Release the terminal for other output. Later stages begin new bars."""
        self.__exit__()
        self.__enter__()

    def _show(self) -> None:
        with self._lock:
            if self._progress is None and _seen() and (self._timer is not None or not self._title):
                self._progress = _progress()
                if self._title:
                    self._tasks[""] = self._progress.add_task(self._title, total=None)
                self._progress.start()

    def update(self, stage: str, done: int, total: int) -> None:
        """Show how far a stage is."""
        began = self._began.setdefault(stage, time.perf_counter())
        said = self._said.setdefault(stage, began)
        if stage in _LONG and not _seen() and done < total and time.perf_counter() - said > _SELDOM:
            self._said[stage] = time.perf_counter()
            errors.print(f"{stage}: {done} of {total}")
        if done >= total:
            del self._began[stage], self._said[stage]
            LOG.info("%s: %.2f s", f"{stage}, {total}" if total > 1 else stage, time.perf_counter() - began)
        with self._lock:
            self._show()
            if self._progress is None:
                return
            if stage not in self._tasks:
                self._tasks[stage] = self._progress.add_task(stage, total=None)
            steps = total if total > 1 or done else None  # a bar without a total moves
            self._progress.update(self._tasks[stage], completed=done, total=steps)


def _seen() -> bool:
    return (errors.is_terminal or errors.is_jupyter) and not errors.quiet


def _progress() -> Progress:
    """Return bars with as many columns as fit the terminal."""
    from rich import progress
    from rich.text import Text

    class Rate(progress.ProgressColumn):
        """Steps per second, once a stage has run long enough to measure them."""

        def render(self, task: progress.Task) -> Text:
            if (task.elapsed or 0.0) < _SOON:
                return Text("")
            rate = task.finished_speed or task.speed
            return Text(f"{rate:.3g}/s" if rate and task.total != 1 else "")

    class Count(progress.MofNCompleteColumn):
        """Number of steps, if there are several."""

        def render(self, task: progress.Task) -> Text:
            return super().render(task) if (task.total or 1) > 1 else Text("")

    wide = errors.width >= 80
    room = max(errors.width - (60 if wide else 26), 1)
    elapsed = progress.TimeElapsedColumn()
    return progress.Progress(
        progress.TextColumn(f"{{task.description:{min(20, room)}.{room}}}", markup=False),
        progress.BarColumn(20 if wide else 8, complete_style="cyan", finished_style="green", pulse_style="cyan"),
        progress.TaskProgressColumn("{task.percentage:3.0f} %"),
        *((Count(), Rate(), elapsed, progress.TimeRemainingColumn()) if wide else (elapsed,)),
        console=errors,
        transient=False,
        redirect_stdout=False,
    )


def plain_table(*headings: str, rows: Iterable[Sequence[str]] = (), title: str = "", show_header: bool = True) -> Table:
    """Return a table with a line below its headings. Long cells wrap."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title=Text(title, style="bold") if title else None,
        title_justify="left",
        caption_justify="left",
        box=SIMPLE_HEAD if show_header else None,
        show_header=show_header,
        show_edge=False,
        padding=(0, 1, 0, 0),
        pad_edge=False,
    )
    for heading in headings:
        table.add_column(Text(heading), overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table
