"""``vdfmu sweep indices``."""

from __future__ import annotations

from typing import Annotated

from vdfmu.base.option import Option
from vdfmu.cli.app import LOOKS, meets_code
from vdfmu.cli.options import JsonOption
from vdfmu.cli.studies import StudyArgument, app
from vdfmu.cli.terminal import console, say, say_json, table

ByOption = Annotated[str | None, Option("Measure or column (default the first).", metavar="NAME",
    more="If the measure has several elements, the largest is used.")]  # fmt: skip


@app.command(example="vdfmu sweep indices results/sweep_tracking --by error")
@meets_code(LOOKS)
def indices(study: StudyArgument, by: ByOption = None, as_json: JsonOption = False) -> None:
    """Print Sobol or Morris indices of a study. The study needs --sample saltelli or morris."""
    from vdfmu.study.sweeps.sweep import Sweep

    sensitivity = Sweep(study).indices(by)
    if as_json:
        say_json({name: row for name, row in sensitivity.rows()})
        return
    rows = [(name, *(row.get(index, "") for index in sensitivity.values)) for name, row in sensitivity.rows()]
    console.print(table("axis", *sensitivity.values, rows=rows))
    say(f"± the half-width of the {100 * sensitivity.confidence:.0f} % confidence interval, by bootstrap.")
