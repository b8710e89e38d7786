"""The options of runs of scenarios and of studies of them, in addition to `vdfmu.engine.options`; each once."""

# Types are written out, not quoted: the command line reads them; quoted ones are imported for the checker only.
import os
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypedDict

from vdfmu.base.option import Option, read_settings
from vdfmu.base.standards import BACKENDS, FMI_VERSIONS, PYTHON_FMI
from vdfmu.engine.options import (
    TEXTS,
    CouplingOptions,
    InputOptions,
    LogOptions,
    ObserverOptions,
    PictureOptions,
    ProgressOptions,
    ResultOptions,
    SpanOptions,
    master_option,
)

if TYPE_CHECKING:
    from vdfmu.arm.robot import Robot


def known_robots() -> Iterable[str]:
    """Return the names of robots."""
    from vdfmu.arm.robot import robot_names

    return robot_names()


SAMPLES = ("grid", "lhs", "sobol", "random", "saltelli", "morris")
"""Ways to draw the points of a study; the last two for indices of sensitivity."""
METHODS = ("both", "global", "local")
"""Searches of a tuning: differential evolution with a half of the budget, then COBYQA; or one of them."""
ENGINES = ("fmu", "batch")
"""Who runs the points of a study: FMUs, or one program of all units."""


# A table: an option in some lines.
# fmt: off
class RobotOptions(TypedDict, total=False):
    """Parts of a scenario, and its FMUs."""

    robot: Annotated["Robot | str | os.PathLike[str] | None", Option(
        "Robot instead of the scenario's: a name or the path of a TOML file.", "Robot, str or path",
        typed=str | None, names=known_robots)]
    settings: Annotated[Mapping[str, Any] | None, Option(
        "Set a parameter or input; without an index, all elements, to one value or to one each: 0.3,-0.5.",
        "mapping of str to value",
        'Such as ``{"controller.K_p[1]": 3000}``: a value, or a list or array with one for each.', flag="--set",
        metavar="COMPONENT.VARIABLE=VALUE", typed=TEXTS, read=read_settings)]
    backend: Annotated[str | None, Option(
        "Kind of FMU; default native where its compiler is installed.", choices=BACKENDS)]


class ScenarioOptions(RobotOptions, SpanOptions, CouplingOptions, InputOptions, total=False):
    """Changes of a scenario, in a run or in all runs of a study."""

    tolerance: Annotated[float | None, Option("Relative tolerance for the units' solvers.")]
    master: Annotated[str | None, master_option]
    units: Annotated[Mapping[str, Any] | None, Option(
        "Unit instead of a component's: my_unit.py, my_units.py:Name, or an FMU of any tool.",
        "mapping of str to unit", "Also a class, or the name of a unit of the package. Values of the scenario that "
        "it has no parameter for are left out, and connections to signals that it lacks; inputs that the other did not "
        "have are joined to outputs of their names, by terminals; with notes in the log, and ``left_out`` and "
        "``joined`` in the summary.", flag="--unit", metavar="COMPONENT=UNIT", typed=TEXTS,
        read=partial( read_settings, option="--unit", form="COMPONENT=UNIT, such as controller=my_unit.py" ))]


class ScenarioRunOptions(ScenarioOptions, ResultOptions, PictureOptions, LogOptions, ObserverOptions, total=False):
    """Options of `vdfmu.run`."""

    out: Annotated["str | os.PathLike[str] | Literal[False] | None", Option(
        "Folder of the results; default results/SCENARIO.", "path or False", "Files of an earlier run in it are "
        "replaced once this one is complete. False writes nothing: results and summary are in what is returned.",
        typed=Path | None)]
    reference: Annotated[bool, Option("Solve the references and compare, which takes longer than the run itself.",
        default=True, flag="--reference/--no-reference")]
    fmi_version: Annotated[str, Option("Version of FMI: 2.0, or 3.0 for native FMUs.",
        default=PYTHON_FMI.name, flag="--fmi", choices=tuple(FMI_VERSIONS))]
    simulate: Annotated[bool | None, Option("Let report.html run the scenario again, with sliders.",
        more="Its units are compiled for WebAssembly for that, once for each structure; default on the command line, "
        "but not in Python.", flag="--simulate/--no-simulate")]


class SeedOptions(TypedDict, total=False):
    """What is drawn by chance."""

    seed: Annotated[int, Option("Seed of all that is drawn.", default=0)]


class WorkerOptions(ProgressOptions, total=False):
    """How the runs of a study are done."""

    workers: Annotated[int | None, Option("Processes; default one a processor.")]
    time_limit: Annotated[float | None, Option("Seconds that a run has; default 600.", "float [s]")]
    scheduler: Annotated[str | None, Option("Address of a Dask scheduler, whose workers are taken instead.",
        metavar="ADDRESS")]
    overwrite: Annotated[bool, Option("Replace another study in the folder.", default=False)]


class PlanOptions(SeedOptions, ScenarioOptions, total=False):
    """Options of the plan of a sweep."""

    sample: Annotated[str | os.PathLike[str], Option(
        "grid, lhs, sobol, random, saltelli, morris, or a CSV file: a line of targets, then points.", "str or path",
        "How the axes' values are combined; see :func:`vdfmu.study.sweeps.axes.draw`.", "grid", typed=str,
        choices=SAMPLES, metavar="METHOD|FILE.csv")]
    points: Annotated[int | None, Option("Number of points, but of a grid or file.",
        more="Of ``saltelli`` and ``morris`` that of base points or trajectories.")]
    measure: Annotated[Mapping[str, Any] | Sequence[str] | None, Option(
        "Measure of a run, such as 'error=rms(trajectory.q_d - plant.q)'.",
        'mapping of str to str or callable, or sequence of "NAME=EXPRESSION"', "See "
        ":mod:`vdfmu.study.sweeps.measures`; or a function of the :class:`vdfmu.Results`. Default for the loop of "
        "trajectory, controller and plant: RMS and peak position error and peak torque of each joint.",
        metavar="NAME=EXPRESSION", typed=TEXTS)]
    record: Annotated[Sequence[str], Option("Signals to record whole, such as 'plant.q[*]'.", "sequence of str",
        "A list a point.", (), metavar="SIGNAL", typed=TEXTS)]
    engine: Annotated[str | None, Option(
        "batch runs several points at once. Default batch where all units are ours.", choices=ENGINES,
        more="Engine of the points: the FMUs, or one program of all units, by default where there are points enough, "
        "see :mod:`vdfmu.study.batch`.")]


class SweepOptions(PlanOptions, WorkerOptions, total=False):
    """Options of `vdfmu.sweep`."""

    chunk: Annotated[int | None, Option("Points that a worker takes at a time; default by time.",
        more="A file has as many; by default what takes some seconds, at most 50, or 56 that are run side by side.")]
    out: Annotated[str | os.PathLike[str] | None, Option("Folder; default results/sweep_SCENARIO.", "path",
        typed=Path | None)]
    retry: Annotated[bool, Option("Run points that failed again.", default=False)]


class ProblemOptions(SeedOptions, ScenarioOptions, total=False):
    """Options of what is tuned."""

    limit: Annotated[Sequence[str] | Mapping[str, Any], Option(
        "Limit that holds for every robot, such as 'peak(controller.tau) < 2.5'.",
        "sequence of str, or mapping", "Or, in a mapping, a function of the results by its name, which must not be "
        "positive.", (), metavar="EXPRESSION<NUMBER", typed=TEXTS)]
    together: Annotated[bool, Option("Vary all elements of a parameter by one factor.", default=False)]
    spread: Annotated[Mapping[str, Any] | Sequence[str], Option(
        "Uncertain parameter, as in a sweep: 'plant.mass[3]=*normal(1, 0.1)'.", 'mapping, or sequence of "TARGET=FORM"',
        default=(), metavar="TARGET=FORM", typed=TEXTS)]
    spread_points: Annotated[int, Option("Number of robots of the spread.", more="They are a Latin hypercube of it.",
        default=8)]
    combine: Annotated[str, Option("Mean or worst of the robots' costs.", default="mean", choices=("mean", "worst"))]
    margin: Annotated[float | str | None, Option(
        "Modulus margin that every joint's loop has at least, or same: that of the start.",
        more="It is the smallest min abs(1 + L) of the nominal robot over the run, as `vdfmu margins` has it.",
        typed=str | None)]
    engine: Annotated[str, Option("batch runs several robots at once.", choices=ENGINES,
        more="They are those of the robots of several values. See :func:`vdfmu.sweep`.", default="fmu")]


class TuneOptions(ProblemOptions, WorkerOptions, total=False):
    """Options of `vdfmu.tune`."""

    method: Annotated[str, Option("Global search, then local, or one of them.",
        more="Differential evolution over the whole range, then COBYQA from the best, or one of them.",
        default="both", choices=METHODS)]
    evaluations: Annotated[int, Option("Evaluations; each runs all robots.", default=300)]
    out: Annotated[str | os.PathLike[str] | None, Option("Folder; default results/tune_SCENARIO.", "path",
        typed=Path | None)]
