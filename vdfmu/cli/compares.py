"""``vdfmu compare``."""

from __future__ import annotations

from typing import Unpack

from vdfmu.cli.terminal import say_notes, say_written, tell
from vdfmu.study.options import CompareOptions


def compare(**options: Unpack[CompareOptions]) -> None:
    """Tune control laws alike, run them on arms, along motions, with mismatches, and say which to take when.

    What is done stays done: after Ctrl-C or a kill the same command continues where it stopped.
    """
    from vdfmu.study.compare.compare import compare as run_compare
    from vdfmu.study.compare.words import in_words

    try:
        found = run_compare(**options)
    except KeyboardInterrupt as error:
        error.add_note("What was done is kept: give the same command again to go on.")
        raise
    say_notes(found.notes)
    tell(in_words(found).rstrip())
    names = ("report.html", "summary.md", "sweep.parquet", "sweep.csv")
    say_written(*(found.folder / name for name in names), more=f"; {len(found)} cells")
