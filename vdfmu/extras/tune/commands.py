"""``vdfmu tune``."""

from __future__ import annotations

from typing import Annotated, Unpack

from vdfmu.base.option import Option
from vdfmu.base.text import amount
from vdfmu.cli.app import RUNS, meets_code
from vdfmu.cli.options import ScenarioArgument
from vdfmu.cli.studies import say_answer
from vdfmu.cli.terminal import say_notes, say_written, table, tell
from vdfmu.extras.tune.options import TuneOptions


@meets_code(RUNS)
def tune(
    scenario: ScenarioArgument = "tracking",
    *,
    vary: Annotated[
        list[str],
        Option(
            "Parameter to search: 'controller.K_p'. Repeatable.",
            metavar="TARGET[=FORM]",
            more="FORM is lin(a, b) or log(a, b), with a star for factors; default *log(0.1, 10). Elements vary "
            "independently.",
        ),
    ],
    cost: Annotated[
        str,
        Option(
            "Cost: 'worst(rms(trajectory.q_d - plant.q))'.",
            metavar="EXPR",
            more="If the expression has several elements, each is divided by its value at the start of the search. The "
            "cost is the mean of these ratios, none of which may exceed 1.",
        ),
    ],
    **options: Unpack[TuneOptions],
) -> None:
    """Find the values with the lowest cost. After Ctrl-C, run it again to resume."""
    from vdfmu.extras.tune.search import tune as run_tune
    from vdfmu.study.sweeps.ledger import table_in
    from vdfmu.study.sweeps.sweep import Sweep

    tuned = run_tune(scenario, vary, cost, **options)
    study = Sweep(tuned.folder)
    say_answer(study)
    say_notes(tuned.notes)
    units = study.facts["units"] | {"phase": "rad", "delay": "s"}
    shown = table("", "before", "after", "")
    for name, before, after in tuned.table():
        shown.add_row(name, f"{before:.4g}", f"{after:.4g}", units.get(name.partition("[")[0], ""))
    tell(shown, (tuned.folder / "tuned.toml").read_text().rstrip())
    tell(f"{amount(tuned.evaluations, 'evaluation')}, {amount(tuned.failed, 'failed run')}.")
    page = study.report()
    say_written(tuned.folder / "tuned.toml", tuned.folder / "tune.json", table_in(tuned.folder), page)


COMMANDS = {
    "Run": [
        (
            tune,
            "vdfmu tune tracking --vary controller.K_p --vary controller.K_v --cost 'rms(trajectory.q_d - plant.q)' "
            "--spread 'plant.mass=*normal(1, 0.05)' --spread-points 3 --margin 0.5 --method local --evaluations 30",
        )
    ]
}
"""By group: commands and their examples."""
