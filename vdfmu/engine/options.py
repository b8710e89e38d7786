"""The options of a run, each declared once for Python, the command line and the documentation.

`vdfmu.study.options` adds the options of scenarios and studies. Options in `CouplingOptions` apply to runs of all
kinds: scenarios, packages, sweeps, tuning, margins and `vdfmu.engine.run.Simulator` accept them.
"""

# Types that the command line reads are not quoted; quoted ones are imported only for the type checker.
import math
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypedDict

from vdfmu.base.errors import UsageError
from vdfmu.base.option import Option, read_settings
from vdfmu.engine.algorithms import ALGORITHMS, DEFAULT, DELAYED, choice
from vdfmu.engine.results.formats import FORMATS, SUFFIXES, choice_of_formats

if TYPE_CHECKING:
    from collections.abc import Callable

    from vdfmu.base.progress import Shown, Steps
    from vdfmu.engine.fmu.messages import LogMessage
    from vdfmu.engine.masters.observer import Observer
    from vdfmu.engine.package.system import Value
    from vdfmu.engine.plan.inputs import Inputs

STEPPERS = AUTO, FMPY, C = "auto", "fmpy", "c"
"""Loops over the steps."""
TEXTS = list[str] | None
"""Type of an option that may be repeated on the command line."""


def read_stepper(name: str) -> str:
    """Return the name of a loop over the steps; UsageError for any other."""
    if name not in STEPPERS:
        raise UsageError(f"stepper: must be {', '.join(STEPPERS[:-1])} or {STEPPERS[-1]}, got {name!r}.")
    return name


# A table, with a few lines per option.
# fmt: off
algorithm_option = Option(", ".join(ALGORITHMS) + ".", more="The first two sample the coupled signals at the "
    "communication points; the others treat them as continuous and are of second order in the step. The default is "
    f"the scenario's. For a package it is in its annotation, which can also set `adaptive`; without an annotation "
    f"it is {DEFAULT}, or, with a note, {DELAYED} if the dependencies allow no order for {DEFAULT}.",
    choices=tuple(ALGORITHMS))
parameters_option = Option("Set a parameter: controller.K_p=1500. Repeatable.", "mapping of str to value",
    "NAME is component.variable, and VALUE is in the unit of the FMU; inputs can be set too. A name without an index "
    "sets all elements, either to the same value or, as in 0.3,-0.5, to one value each. *0.8 multiplies the value of "
    "the package or scenario, or the start value if there is none. These values override those of the package or "
    "scenario.", flag="--set",
    metavar="NAME=VALUE", typed=TEXTS, read=read_settings)


class SpanOptions(TypedDict, total=False):
    """When a run ends, and its step."""

    step: Annotated[float | None, Option("Communication step in s.", "float [s]",
        "`stop` - `start` must be a multiple of it, within 1e-9 relative. With `adaptive` it is the longest step and "
        "the interval of the rows. The default is that of the scenario, or of the package's annotations by vdfmu or "
        "libcosim; if components have their own steps, the largest step that divides all of them.")]
    stop: Annotated[float | None, Option("End of the run in s.", "float [s]")]


class CouplingOptions(TypedDict, total=False):
    """How components are coupled, in runs of every kind."""

    adaptive: Annotated[float | None, Option(
        "Adapt the step to this relative coupling error.",
        more=f"Relative to the size of a coupled signal, or to its nominal value if that is larger. For "
        f"{choice(continuous=True)}.")]


class InputOptions(TypedDict, total=False):
    """External signals."""

    inputs: Annotated["Inputs", Option(
        "Signals for unconnected inputs. Repeatable.",
        "path, sequence of paths or mapping of str to (t, values)",
        "CSV files with a column time and columns such as `plant.F_e[1] [N]`, or arrays; they replace the inputs of "
        "a scenario. See "
        "`vdfmu.engine.plan.inputs.read_inputs`.",
        flag="--input", metavar="FILE.csv", typed=TEXTS)]
    input_hold: Annotated[bool | None, Option(
        "Hold inputs until their next row.", "bool", "Otherwise they are interpolated linearly.", typed=bool)]


class ObserverOptions(TypedDict, total=False):
    """Who observes a run, and when."""

    observer: Annotated["Observer | None", Option(
        "Receives rows during the run; see `vdfmu.engine.masters.observer`.", "Observer", flag=None)]
    pace: Annotated[float | None, Option("Run at this multiple of real time.", "float",
        "The summary's ``pace`` reports how late the rows were. By default a run is as fast as possible. See "
        "`vdfmu.engine.masters.observer`.", metavar="FACTOR")]


class RecordOptions(SpanOptions, ObserverOptions, total=False):
    """The range and the signals of a run that are recorded."""

    start: Annotated[float | None, Option("Start of the run in s.", "float [s]",
        "Row k is at ``start + k * step``. The defaults of start, stop and step are those of the package's default "
        "experiment; else the start is 0.")]
    record: Annotated[Sequence[str] | None, Option("Signals to record: 'plant.q[*]'. Repeatable.",
        "sequence of str", "``'*'`` records all. By default the outputs and the inputs from files or arrays are "
        "recorded, or the local variables of an FMU without outputs. A run of a scenario always records the default "
        "signals. Connected inputs have the values that the components used. Strings are not recorded.",
        metavar="SIGNAL", typed=TEXTS)]


class ProgressOptions(TypedDict, total=False):
    """Who is informed of the progress."""

    progress: Annotated["Shown", Option(
        "Called with stage, done, total; True shows bars, on the terminal or in the notebook.", "callable or bool",
        flag=None)]


class LogOptions(TypedDict, total=False):
    """Who receives messages of a run."""

    log: Annotated["Callable[[LogMessage], None] | None", Option(
        "Receives each `LogMessage` of the units. Default: the logger ``vdfmu.engine.run``.", "callable", flag=None)]


class StepperOptions(TypedDict, total=False):
    """The loop over the steps."""

    stepper: Annotated[str, Option("Loop over the steps: fmpy, c or auto.",
        more="`fmpy` steps in Python by calls of fmpy, `c` in C by the same functions; the results are "
            "bit-identical. `auto` uses C if the system allows it. ``stepper`` in the summary names the loop that was "
            "used, and the reason if it was not C.",
        default=AUTO, choices=STEPPERS, read=read_stepper)]


class IsolationOptions(TypedDict, total=False):
    """In which process components run, and its limits."""

    isolate: Annotated[bool | None, Option("Run components in a separate process.", "bool",
        "This is the default if an FMU was not built by vdfmu. Crashes, long calls and excessive memory then "
        "raise a CosimError; otherwise a component could kill or block this process. On the command line, Python "
        "code of files also runs in a separate process, unless ``--no-isolate`` is given to debug it.",
        flag="--isolate/--no-isolate")]
    memory_limit: Annotated[float | None, Option(
        "Memory in MB of isolated components (default half).", "float [MB]", "The default is half of the machine's "
        "memory.")]
    wait_limit: Annotated[float | None, Option(
        "Longest wait for a component in s (default 300).", "float [s]",
        "It applies to a step of all isolated components, and to loading, initializing and freeing each of them.")]


class LoadedOptions(CouplingOptions, InputOptions, LogOptions, StepperOptions, IsolationOptions, total=False):
    """How components run."""

    tolerance: Annotated[float | None, Option("Relative tolerance of the units' solvers.",
        more="Default: that of the scenario, or of each FMU.")]
    ignore_unmatched: Annotated[bool, Option("Ignore values without a variable of that name.",
        more="It applies to values in the package's parameter sets.", default=False)]


class AlgorithmOptions(LoadedOptions, total=False):
    """How a system is checked and coupled."""

    parameters: Annotated["Mapping[str, Value] | None", parameters_option]
    algorithm: Annotated[str | None, algorithm_option]
    convergence: Annotated[float | None, Option("Change of a coupled signal, relative as `adaptive`, at which "
        f"{choice(repeats=True)} ends its repetitions; default a hundredth of `adaptive`, else 1e-8.", flag=None)]


class SimulatorOptions(AlgorithmOptions, total=False):
    """Options of `vdfmu.engine.run.Simulator`."""


class RowOptions(RecordOptions, total=False):
    """Options of `vdfmu.engine.run.Simulator.run`."""

    progress: Annotated["Steps | bool | None", Option("Called as ``progress(k, n)`` at the start, at the end and at "
        "most 100 times in between; True shows a bar, on the terminal or in the notebook.", "callable or bool",
        flag=None)]
    stream: Annotated[Path | Sequence[Path] | None, Option(
        "CSV file that receives the rows during the run, in the form of `Results.write`, at least every two seconds.",
        "Path or two of them", "A file with another suffix of ``formats`` is written at the end of the run, also of a "
        "failed run, but not if the process is killed; see `Results.write`. The results are then mapped from disk, "
        "where they take twice the space of the file. Only their times take memory.", flag=None)]
    about: Annotated[Mapping[str, Any] | None, Option(
        "First facts of the summary, also in files with a summary.", "mapping", flag=None)]


class SimulateOptions(RowOptions, SimulatorOptions, total=False):
    """Options of `vdfmu.engine.run.simulate`."""


class ResultOptions(ProgressOptions, total=False):
    """Output of a run."""

    overwrite: Annotated[bool, Option("Also overwrite files not written by vdfmu.", default=False)]
    formats: Annotated[Sequence[str], Option("Formats of the results, separated by commas.", "sequence of str",
        f"{choice_of_formats(FORMATS)}. Plugins can add formats.", ("csv",), flag="--format",
        metavar="|".join(suffix[1:] for suffix in FORMATS), typed=str)]


class PictureOptions(TypedDict, total=False):
    """Figures of a run in files."""

    pictures: Annotated[Sequence[str], Option("Formats of figures, separated by commas.", "sequence of str",
        "By default no figures are written.", (), typed=str, choices=SUFFIXES)]
    width: Annotated[str, Option("Width of the figures: 85mm, 17cm or 3.3in.", more="The size of their text is 8 pt.",
        default="160mm", metavar="LENGTH")]
    serif: Annotated[bool, Option("Write the text of the figures with serifs.", more="For papers with a serif font.",
        default=False)]


class VariantOptions(TypedDict, total=False):
    """Which system of a package is run."""

    variant: Annotated[str, Option("SSD to run.", more="A package may have several.", default="SystemStructure.ssd",
        metavar="SSD")]


class SystemOptions(RecordOptions, VariantOptions, LoadedOptions, ResultOptions, PictureOptions, total=False):
    """Options of `vdfmu.engine.package_run.run_system`."""

    algorithm: Annotated[str | None, algorithm_option]
    parameters: Annotated[Mapping[str, Any] | None, parameters_option]
    out: Annotated[str | os.PathLike[str] | None, Option(
        "Folder of the results (default results/NAME).", "path",
        "NAME is the scenario or the FMU, PACKAGE_ssp for a package, and ``system`` for connected components. A "
        "complete run replaces the files of an earlier run.", typed=Path | None)]


class Limits:
    """Limits of components: `time` of each call, default 300 s, and `memory` [MB], default half of the machine's."""

    def __init__(self, time: float | None = None, memory: float | None = None) -> None:
        self.time = 300.0 if time is None else time
        self.memory = math.inf if memory is None else memory
        if memory is None:
            with suppress(AttributeError, ValueError, OSError):  # unknown
                self.memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**21
        if not 0.0 < self.time < math.inf:
            raise UsageError(
                f"wait_limit must be a positive, finite time in s, got {self.time:g}. The default is 300 s."
            )
        if not self.memory > 0.0:
            raise UsageError(f"memory_limit must be positive, got {self.memory:g} MB")
