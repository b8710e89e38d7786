"""The options of a tuning, in addition to those of scenario runs, each declared once."""

# Types are not quoted, because the command line reads them.
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from vdfmu.base.option import Option
from vdfmu.engine.options import TEXTS
from vdfmu.study.options import ENGINES, ScenarioOptions, SeedOptions, WorkerOptions

METHODS = ("both", "global", "local")
"""Methods of a tuning: differential evolution with half of the budget, then COBYQA; or only one of them."""


# A table, with a few lines per option.
# fmt: off
class ProblemOptions(SeedOptions, ScenarioOptions, total=False):
    """Options of the problem that is tuned."""

    limit: Annotated[Sequence[str] | Mapping[str, Any], Option(
        "Limit: 'peak(controller.tau) < 2.5'. Repeatable.",
        "sequence of str, or mapping", "It applies to every robot. In Python it can also be a mapping of names to "
        "functions of the results, whose positive values violate the limit.", (), metavar="EXPR<NUMBER", typed=TEXTS)]
    together: Annotated[bool, Option("Vary all elements of a parameter by one factor.", default=False)]
    spread: Annotated[Mapping[str, Any] | Sequence[str], Option(
        "Uncertain: 'plant.mass=*normal(1, .1)'. Repeatable.", 'mapping, or sequence of "TARGET=FORM"',
        "A parameter that differs from robot to robot. TARGET and FORM are those of --vary of a sweep.", (),
        metavar="TARGET=FORM", typed=TEXTS)]
    spread_points: Annotated[int, Option("Number of robots with different parameters.",
        more="They are drawn as a Latin hypercube.", default=8)]
    combine: Annotated[str, Option("Mean or worst of the robots' costs.", default="mean", choices=("mean", "worst"))]
    margin: Annotated[float | str | None, Option(
        "Modulus margin to keep; same: that at the start.",
        more="No loop of the chosen values may have a smaller one. It is the smallest min abs(1 + L) of the nominal "
            "robot over the run, as `vdfmu linear SCENARIO` prints it.", metavar="NUMBER|same",
            typed=str | None)]
    engine: Annotated[str, Option("batch runs several robots at once.", choices=ENGINES,
        more="It runs the robots of several candidates together. See :func:`vdfmu.sweep`.", default="fmu")]


class TuneOptions(ProblemOptions, WorkerOptions, total=False):
    """Options of `vdfmu.extras.tune.tune`."""

    method: Annotated[str, Option("Global search, local search, or both.",
        more="Differential evolution over the whole range, then COBYQA from the best point, or only one of them.",
        default="both", choices=METHODS)]
    evaluations: Annotated[int, Option("Number of evaluations; each runs all robots.", default=300)]
    out: Annotated[str | os.PathLike[str] | None, Option("Folder (default results/tune_SCENARIO).", "path",
        typed=Path | None)]
