"""Progress bars, on a terminal and in a notebook, and the one place through which text goes there."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Self

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from vdfmu.text import shown

if TYPE_CHECKING:
    from rich.progress import TaskID


class Terminal(Console):
    """Text to the terminal: what it would act on is shown, but for rich's own."""

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as rich does."""
        super().print(*(shown(item) if isinstance(item, str) else item for item in objects), **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Render as rich does."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=shown(segment.text))


errors = Terminal(stderr=True, highlight=False)


class Bars:
    """Progress bars, one a stage, and lines above them."""

    def __init__(self) -> None:
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            ProgressColumn,
            Task,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )
        from rich.text import Text

        class Rate(ProgressColumn):
            """Steps in a second."""

            def render(self, task: Task) -> Text:
                rate = task.finished_speed or task.speed
                return Text(f"{rate:.3g}/s" if rate else "")

        self._progress = Progress(
            TextColumn("{task.description:20}"), BarColumn(20), TextColumn("{task.percentage:3.0f} %"),
            MofNCompleteColumn(), Rate(), TimeElapsedColumn(), TimeRemainingColumn(), console=errors, transient=False,
            disable=not (errors.is_terminal or errors.is_jupyter),
        )  # fmt: skip
        self._tasks: dict[str, TaskID] = {}

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def update(self, stage: str, done: int, total: int) -> None:
        """Show how far a stage is."""
        if stage not in self._tasks:
            self._tasks[stage] = self._progress.add_task(stage)
        self._progress.update(self._tasks[stage], completed=done, total=total)

    def say(self, text: str) -> None:
        """Print a line above the bars."""
        self._progress.console.print(text, markup=False, soft_wrap=True)
