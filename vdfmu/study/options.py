"""The options of scenario runs and of studies, in addition to `vdfmu.engine.options`, each declared once."""

# Types that the command line reads are not quoted; quoted ones are imported only for the type checker.
import os
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypedDict

from vdfmu.base.errors import UsageError
from vdfmu.base.option import Option, option_of, read_settings
from vdfmu.base.standards import BACKENDS, FMI_VERSIONS, PYTHON_FMI
from vdfmu.engine.options import (
    TEXTS,
    CouplingOptions,
    InputOptions,
    IsolationOptions,
    LoadedOptions,
    LogOptions,
    ObserverOptions,
    PictureOptions,
    ProgressOptions,
    RecordOptions,
    ResultOptions,
    SimulatorOptions,
    SpanOptions,
    StepperOptions,
    VariantOptions,
    algorithm_option,
    parameters_option,
)

if TYPE_CHECKING:
    from vdfmu.arm.robot import Robot
    from vdfmu.engine.package.system import Connections


def known_robots() -> Iterable[str]:
    """Return the names of robots."""
    from vdfmu.arm.robot import robot_names

    return robot_names()


def read_percent(text: str) -> float:
    """Return 0.01 for ``1`` or ``1%``."""
    try:
        return float(text.strip().removesuffix("%")) / 100.0
    except ValueError:
        raise UsageError(f"percent must be a number, got {text!r}. Give 1 for 1 %.") from None


def read_connections(texts: Iterable[str] | None) -> list[tuple[str, str]]:
    """Return the output and the input of each text ``a.y=b.u``."""
    form = "OUTPUT=INPUT, such as a.y=b.u"
    return [pair for text in texts or () for pair in read_settings([text], "--connect", form).items()]


SAMPLES = ("grid", "lhs", "sobol", "random", "saltelli", "morris")
"""Ways to choose the points of a study; the last two are for sensitivity indices."""
ENGINES = ("fmu", "batch")
"""Engines that run the points of a study: FMUs, or one program of all units."""


# Kept as a table with a few lines per option, not one argument per line.
# fmt: off
class ValueOptions(TypedDict, total=False):
    """Values of a system, and its FMUs."""

    parameters: Annotated[Mapping[str, Any] | None, parameters_option]
    backend: Annotated[str | None, Option(
        "Kind of FMU.", more="Default: native if its compiler is installed.", choices=BACKENDS)]


class RobotOptions(ValueOptions, total=False):
    """Parts of a scenario, and its FMUs."""

    robot: Annotated["Robot | str | os.PathLike[str] | None", Option(
        "Use this robot, not the scenario's.", "Robot, str or path", "A name, or the path of a TOML file.",
        metavar="ROBOT", typed=str | None, names=known_robots)]


class LoopOptions(ValueOptions, CouplingOptions, total=False):
    """Options for margins."""

    algorithm: Annotated[str | None, algorithm_option]
    step: Annotated[float | None, option_of(SpanOptions, "step")]


class ScenarioOptions(RobotOptions, SpanOptions, CouplingOptions, InputOptions, total=False):
    """Changes of a scenario, in a run or in all runs of a study."""

    tolerance: Annotated[float | None, option_of(LoadedOptions, "tolerance")]
    algorithm: Annotated[str | None, algorithm_option]
    units: Annotated[Mapping[str, Any] | None, Option(
        "Replace COMPONENT by a unit or FMU. Repeatable.",
        "mapping of str to unit", "By my_unit.py, my_units.py:Name, an FMU of any tool, the name of a unit of the "
        "package, or a class. Values and connections of the scenario are dropped if the replacement lacks the "
        "parameter or signal. An additional input is connected to the only output that fits by name, shape and unit "
        "of measurement. If an input then has no source, the run is refused. The log notes these changes, and the "
        "summary has them as ``left_out`` and ``joined``.",
        flag="--unit", metavar="COMPONENT=UNIT", typed=TEXTS,
        read=partial( read_settings, option="--unit", form="COMPONENT=UNIT, such as controller=my_unit.py" ))]
    connections: Annotated["Connections | None", Option(
        "Connect output a.y to input b.u. Repeatable.", "mapping of output to input or inputs, or pairs of them",
        "Names are as in the diagram, ``component.signal``; vectors are connected as a whole or by element, "
        "``plant.tau[1]``. The new connection replaces the input's connection in the scenario.", flag="--connect",
        metavar="a.y=b.u", typed=TEXTS, read=read_connections)]
    unfed: Annotated[str | None, Option(
        "ok: unconnected inputs keep their start values.",
        more="Otherwise each input of a replacement needs a connection or a value, unless it replaces a plant.",
        choices=("ok",))]


class JudgeOptions(TypedDict, total=False):
    """Judgement of the coupling error."""

    judge: Annotated[float | None, Option(
        "Estimate the coupling error; fail above PERCENT.", "float",
        "In Python it is a fraction, 0.01. The runs with shorter steps take 9 times as long as the run, or 17 times "
        "if a component does not declare whether it is sampled.",
        metavar="PERCENT", typed=str, read=read_percent)]
    sampled: Annotated[bool | None, Option(
        "Treat undeclared components as sampled or not.", "bool",
        "Sampled components keep the step as their period, and continuous ones also take the shorter steps. "
        "Without this option, components that declare neither are judged in both ways.",
        flag="--sampled/--continuous")]


class ExpectOptions(TypedDict, total=False):
    """Recorded results that a run must match."""

    expect: Annotated["str | os.PathLike[str] | None", Option(
        "Recorded results that the run must match.", "path",
        "A CSV file, or another file of results. All of its signals and rows are compared; the signals of the run are "
        "interpolated at the times of the file. A name without a component refers to the only component that has it.",
        metavar="FILE", typed=Path | None)]
    within: Annotated[float | None, Option("Allowed difference from --expect (default 1e-6).", "float",
        "A fraction of each signal's range, or of the value of a constant signal.", metavar="SHARE")]


class JudgingOptions(SpanOptions, SimulatorOptions, total=False):
    """Options of `vdfmu.judge`."""

    start: Annotated[float | None, option_of(RecordOptions, "start")]
    sampled: Annotated[bool | None, option_of(JudgeOptions, "sampled")]


class ScenarioRunOptions(
    ScenarioOptions, StepperOptions, IsolationOptions, JudgeOptions, ExpectOptions, ResultOptions, PictureOptions,
    LogOptions, ObserverOptions, total=False,
):
    """Options of `vdfmu.run`."""

    out: Annotated["str | os.PathLike[str] | Literal[False] | None", Option(
        "Folder of the results (default results/NAME).", "path or False", "NAME is the scenario's name, or "
        "ROBOT_reach for the scenario reach. Files of an earlier run in the folder are replaced at the end of this "
        "run. With False nothing is written, and the returned object has results and summary.",
        typed=Path | None)]
    reference: Annotated[bool, Option("Solve the references and compare.",
        more="This takes longer than the run itself.", default=True, flag="--reference/--no-reference")]
    reference_stop: Annotated[float | None, Option("Compare with the references up to this time in s.", "float [s]",
        "The default is the stop of the run.", metavar="SECONDS")]
    limits: Annotated[Mapping[str, Any] | None, Option("Limit of the verdict: margin=0.3. Repeatable.",
        "mapping of str to float", "docs/report.md has a table of the limits, and `--verbose` prints them.",
        flag="--limit",
        metavar="NAME=VALUE", typed=TEXTS,
        read=partial(read_settings, option="--limit", form="NAME=VALUE, such as margin=0.3"))]
    record: Annotated[Sequence[str] | None, option_of(RecordOptions, "record")]
    fmi_version: Annotated[str, Option("Version of FMI; 3.0 needs native FMUs.",
        default=PYTHON_FMI.name, flag="--fmi", choices=tuple(FMI_VERSIONS))]
    simulate: Annotated[bool | None, Option("Add sliders that repeat the run in the page.",
        more="The page then contains the system as WebAssembly. This is the default on the command line, but not in "
            "Python.",
        flag="--simulate/--no-simulate")]


class SeedOptions(TypedDict, total=False):
    """Random numbers."""

    seed: Annotated[int, Option("Seed of random numbers.", default=0)]


class WorkerOptions(ProgressOptions, total=False):
    """How the runs of a study are executed."""

    workers: Annotated[int | None, Option("Processes (default: one for each processor).")]
    time_limit: Annotated[float | None, Option("Time limit of a run in s (default 600).", "float [s]")]
    scheduler: Annotated[str | None, Option("Address of a Dask scheduler, to use its workers.",
        metavar="ADDRESS")]
    overwrite: Annotated[bool, Option("Replace another study in the folder.", default=False)]


class PlanOptions(SeedOptions, ScenarioOptions, VariantOptions, total=False):
    """Options for the plan of a sweep."""

    start: Annotated[float | None, Option("Start of the runs of a package in s.", "float [s]",
        "Default: the package's default experiment; else 0.")]
    sample: Annotated[str | os.PathLike[str], Option(
        "grid, lhs, sobol, random, saltelli, morris.", "str or path",
        "How points are chosen from the axes, or a CSV file with the targets in its first line and a point in each "
        "further line. See "
        ":func:`vdfmu.study.sweeps.axes.draw`.", "grid", typed=str,
        choices=SAMPLES, metavar="METHOD|FILE.csv")]
    points: Annotated[int | None, Option("Number of points.",
        more="Not for a grid or file. For ``saltelli`` it is the number of base points, for ``morris`` that of "
            "trajectories.")]
    measure: Annotated[Mapping[str, Any] | Sequence[str] | None, Option(
        "Measure: 'error=rms(plant.q)'. Repeatable.",
        'mapping of str to str or callable, or sequence of "NAME=EXPRESSION"', "See "
        ":mod:`vdfmu.study.sweeps.measures`. It can also be a function of :class:`vdfmu.Results`. The default for a "
        "loop of trajectory, controller and plant is the RMS and peak position error and the peak torque of each "
        "joint.",
        metavar="NAME=EXPRESSION", typed=TEXTS)]
    record: Annotated[Sequence[str], Option("Signals to store in full: 'plant.q[*]'. Repeatable.", "sequence of str",
        "The table has a list for each point.", (), metavar="SIGNAL", typed=TEXTS)]
    engine: Annotated[str | None, Option(
        "batch runs several points at once.", choices=ENGINES,
        more="`fmu` runs the FMUs at each point. `batch` compiles all units into one program, which is the default if "
            "there are enough points; see :mod:`vdfmu.extras.batch`.")]


class SweepOptions(PlanOptions, WorkerOptions, total=False):
    """Options of `vdfmu.sweep`."""

    chunk: Annotated[int | None, Option("Points that a worker runs at a time.",
        more="A result file has the rows of one chunk. By default a chunk takes a few seconds and at most 50 points, "
        "or 56 with the engine `batch`.")]
    out: Annotated[str | os.PathLike[str] | None, Option("Folder (default results/sweep_SCENARIO).", "path",
        typed=Path | None)]
    retry: Annotated[bool, Option("Run failed points again.", default=False)]
