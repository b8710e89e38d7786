"""`connect` and `load`: a system of FMUs as one object to run, check, judge, vary and write."""

from __future__ import annotations

import os
import shutil
import tempfile
import threading
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from html import escape
from multiprocessing import process, util
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from vdfmu.base.errors import UsageError
from vdfmu.base.extras import module_of_extra
from vdfmu.base.files import require_ours, storing
from vdfmu.base.option import checks_types, pick, with_options
from vdfmu.base.text import amount
from vdfmu.engine.options import RowOptions, SimulateOptions, SimulatorOptions
from vdfmu.engine.package.archive import stamp_of
from vdfmu.engine.package.join import JOINED, join
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.package.system import Connections, FlatSystem
from vdfmu.engine.plan.check import Checked, check_system
from vdfmu.engine.results.results import Results
from vdfmu.engine.run import Simulator, simulate
from vdfmu.study.options import JudgingOptions, LoopOptions, ScenarioOptions, SweepOptions

if TYPE_CHECKING:  # connecting and running FMUs must not import what builds, judges and checks them
    from vdfmu.arm.robot import Robot
    from vdfmu.engine.inspect.inspection import Report
    from vdfmu.study.analysis.loops import SystemMargins
    from vdfmu.study.judgement import Judgement
    from vdfmu.study.sweeps.sweep import Sweep
    from vdfmu.system.scenario import Scenario

Part = str | os.PathLike[str] | type
"""An FMU, a unit's file, the name of a shipped unit, or a class of Unit."""

_PLAIN = (str, int, float, type(None))
"""Types of options that can be compared."""
_LOOK = "<style>.vdfmu svg.system { background: var(--back); } .vdfmu .keys span { margin-right: 1em; }</style>"
"""Style of a diagram in a notebook, whose background may be light although the desktop is dark."""
_KIND = {False: "co-simulation", True: "model exchange"}


class System:
    """FMUs and the connections between them.

    `connect` and `load` return a system, for which all FMUs are read and all connections checked.

    Attributes
    ----------
    path : Path
        The package (SSP) that is run.
    name : str
    components : mapping of str to str
        Component to the version, kind and file of its FMU.
    connections : list of str
        ``a.y -> b.u``, and ``a.q -> b.q (6)`` for vectors.
    inputs, outputs, parameters : list of str
        ``component.variable``: unconnected inputs, outputs, and parameters.
    notes : list of str
        Remarks of the check, such as inputs that keep their start values.
    """

    def __init__(
        self, path: Path, options: Mapping[str, Any] | None = None, keep: Any = None, scenario: Scenario | None = None
    ) -> None:
        self.path, self._keep = path, keep  # keep: a temporary folder that exists as long as the system
        self._scenario = scenario
        self._loaded, self._simulator, self._loaded_as = ExitStack(), None, None
        self._read_as: tuple[Any, FlatSystem] | None = None
        """Package as it was read last, with its stamp."""
        self._lock, self._process = threading.Lock(), os.getpid()
        util.Finalize(self, self._loaded.close, exitpriority=0)  # even at the end of multiprocessing's child processes
        self._options = {key: value for key, value in (options or {}).items() if value}
        checked = self._checked
        self.name = checked.system.name
        self.components = {
            name: f"FMI {each.version.name} {_KIND[each.exchange]}, {Path(each.source).name}"
            for name, each in checked.descriptions.items()
        }
        pairs = ((".".join(link.start), ".".join(link.end)) for link in checked.links)
        groups = Counter((_whole(start), _whole(end)) if "[" in start and "[" in end else (start, end)
                         for start, end in pairs)  # fmt: skip
        self.connections = [f"{a} -> {b}" + (f" ({n})" if n > 1 else "") for (a, b), n in groups.items()]
        self.notes = [str(note) for note in checked.notes]
        fed = {link.end for link in checked.links}
        named = {
            kind: [f"{name}.{v.name}" for name, each in checked.descriptions.items() for v in each.named(kind)
                   if (name, v.name) not in fed]
            for kind in ("input", "output", "parameter")
        }  # fmt: skip
        self.inputs, self.outputs, self.parameters = named.values()

    @property
    def _checked(self) -> Checked:
        flat = self._read()
        algorithm = self._options.get("algorithm") or flat.experiment.algorithm
        return check_system(flat, algorithm=algorithm)

    def _read(self) -> FlatSystem:
        """Return the package, read again if it has changed."""
        stamp = stamp_of(self.path)
        if self._read_as is None or self._read_as[0] != stamp:
            self._read_as = stamp, load_ssp(self.path)
        return self._read_as[1]

    def __repr__(self) -> str:
        sizes = amount(len(self.components), "component"), amount(len(self.connections), "connection")
        lines = [f"System {self.name!r}: {', '.join(sizes)}"]
        lines += [f"  {name}: {text}" for name, text in self.components.items()]
        lines += [f"  {text}" for text in _shortened(self.connections)]
        free = Counter(map(_whole, self.inputs))
        texts = [f"{_whole(name)} ({n})" if (n := free.pop(_whole(name), 0)) > 1 else name * n for name in self.inputs]
        texts = [text for text in texts if text]
        lines += [f"  free inputs: {', '.join(_shortened(texts)) or 'none'}"]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        return f"{self._diagram()}<pre>{escape(repr(self))}</pre>"

    def _diagram(self, results: Results | None = None) -> str:
        """Return the diagram for a notebook; empty without CasADi."""
        try:
            from vdfmu.system.package.drawing import system_diagram  # takes long to import
        except ImportError:
            return ""
        held = () if results is None else results.summary.get("held", ())
        return f'{_LOOK}<div class="vdfmu">{system_diagram(self.path, held)}</div>'

    @with_options
    def run(self, *, reference: bool = False, **options: Unpack[SimulateOptions]) -> Results:
        """Run the system. FMUs that were built on this machine stay loaded for the next run.

        The summary of a scenario's run contains the verdict of :func:`vdfmu.run`. It is made when the summary is first
        read, so that a loop over thousands of runs does not wait for it.

        Parameters
        ----------
        reference : bool
            Whether the verdict also solves the scipy references of a scenario.
        **options
            :class:`vdfmu.engine.options.SimulateOptions`.

        Raises
        ------
        UsageError, SspError, CosimError
            See :func:`vdfmu.engine.run.simulate`.
        """
        results = self._simulate(self._with(options))
        if self._scenario is not None:
            chosen = {**pick(ScenarioOptions, options), "out": False, "reference": reference}
            results.judge_by(partial(self._judge_run, self._scenario, chosen))
        results.draw_by(self._diagram)
        return results

    def _simulate(self, options: dict[str, Any]) -> Results:
        """Run the package; FMUs that were built here stay loaded for runs that differ only in values and rows."""
        rows: Any = {name: options.get(name) for name in RowOptions.__annotations__}
        loading: Any = {name: value for name, value in options.items() if name not in rows and name != "parameters"}
        plain = all(isinstance(value, _PLAIN) for name, value in loading.items() if name != "log")
        # a pool finally kills its workers, which then cannot remove their folders
        here = os.getpid() == self._process and not process.current_process().daemon
        if "inputs" in loading or not plain or not here or not self._lock.acquire(False):
            return simulate(self.path, **options)
        try:
            simulator = self._load(loading)
            parameters = options.get("parameters")
            if parameters and not simulator.sizes.isdisjoint(parameters):
                return simulate(self.path, **options)
            results = simulator.run_with(rows, parameters)
            if not simulator.rest():
                self._unload()
            return results
        finally:
            self._lock.release()

    def _load(self, options: Any) -> Simulator:
        loaded_as = stamp_of(self.path), options
        if self._simulator is None or self._loaded_as != loaded_as:
            self._unload()
            self._simulator = self._loaded.enter_context(Simulator(self._read(), **options))
            self._loaded_as = loaded_as
        return self._simulator

    def _unload(self) -> None:
        self._simulator = None
        self._loaded.close()

    def _judge_run(self, scenario: Scenario, options: Any, results: Results) -> None:
        from vdfmu.study.run.conclude import judge_results  # takes long to import

        judge_results(results, scenario, self.path, **options)  # a method, so that the package lives as long as results

    @with_options
    def instance(self, **options: Unpack[SimulatorOptions]) -> Simulator:
        """Return the system as a `vdfmu.engine.run.Simulator`, for many runs or steps by hand, in a ``with`` block."""
        simulator = Simulator(self.path, **self._with(options))
        simulator.owner = self._keep
        return simulator

    @checks_types
    def check(self, run: bool = True) -> Report:
        """Check FMUs and system against the rules of FMI and SSP; see `vdfmu check`. With `run`, ten steps are made."""
        from vdfmu.engine.inspect.inspection import inspect_file  # takes long to import

        return inspect_file(self.path, run)

    @with_options
    def margins(
        self, opened: Sequence[str] = (), at: Sequence[float] = (), **options: Unpack[LoopOptions]
    ) -> SystemMargins:
        """Return the stability margins of the loops, see `vdfmu.study.analysis.loops.margins_along`."""
        from vdfmu.study.analysis.loops import margins_along  # takes long to import

        return margins_along(self._scenario or self.path, opened, at, **options)

    @with_options
    def judge(self, wanted: float = 0.01, **options: Unpack[JudgingOptions]) -> Judgement:
        """Judge whether the coupling error is at most `wanted`, see :func:`vdfmu.study.judgement.judge`."""
        from vdfmu.study.judgement import judge  # takes long to import

        return judge(self.path, wanted, **self._with(options))

    @with_options
    def sweep(self, vary: Mapping[str, Any] | Sequence[str], **options: Unpack[SweepOptions]) -> Sweep:
        """Run the system at many points, see :func:`vdfmu.sweep`. `parameters` are the same at all points."""
        from vdfmu.study.sweeps.sweep import sweep  # takes long to import

        study = sweep(self.path, vary, **self._with(options))
        if self._keep is not None:  # the package is deleted with the system
            self.write(study.folder / self.path.name)
        return study

    @checks_types
    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the system as a package (SSP); return its path."""
        path = Path(path)
        if path.suffix.lower() != ".ssp":
            raise UsageError(f"path must end in .ssp, got {path}. Write {path.parent / (path.stem or 'system')}.ssp.")
        require_ours(path)
        with storing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(self.path, path)
        return path

    @checks_types
    def container(self, path: str | os.PathLike[str], step: float | None = None) -> Path:
        """Write the system as one FMU, see `vdfmu.extras.container.write_container`; the default is its own `step`."""
        chosen = step if step is not None else load_ssp(self.path).experiment.step
        if chosen is None:
            raise UsageError("step must be given in s for a system without a step, got none. Give step=1e-3.")
        return module_of_extra("containers", "container", "container").write_container(self.path, path, step=chosen)

    def _with(self, options: Mapping[str, Any]) -> dict[str, Any]:
        """Return the options of the system, replaced by those of a call."""
        return {**self._options, **{key: value for key, value in options.items() if value is not None}}


def _whole(name: str) -> str:
    return name.partition("[")[0]


def _shortened(texts: Sequence[str]) -> list[str]:
    return list(texts) if len(texts) <= 12 else [*texts[:11], f"and {len(texts) - 11} more"]


@checks_types
def connect(
    components: Mapping[str, Part], connections: Connections = (), *, robot: Robot | str | None = None,
    fmi: str = "2.0", stop: float | None = None, step: float | None = None, algorithm: str | None = None,
    parameters: Mapping[str, Any] | None = None, name: str = JOINED,
) -> System:  # fmt: skip
    """Connect FMUs.

    Parameters
    ----------
    components : mapping of name to FMU
        FMUs of any tool, for co-simulation or model exchange. Units (classes, files, shipped names) are built first.
    connections : mapping of output to input or inputs, or sequence of such pairs
        ``"a.y": "b.u"``. A name without an index means the whole vector, ``"arm.tau[1]"`` one element.
    robot : Robot, str, optional
        Robot for units that need one.
    fmi : "2.0" or "3.0", optional
        FMI version of units that are built.
    stop, step : float, optional [s]
        Default stop time and communication step of runs; without them those of the FMUs.
    algorithm : str, optional
        Default master algorithm.
    parameters : mapping of ``component.variable`` to value, optional
        Parameters and start values, in the units of the FMUs.
    name : str, optional
        Name of the system.

    Returns
    -------
    System

    Raises
    ------
    UsageError
        For names that do not exist; it lists all faults.
    SspError
        For FMUs that cannot be read, and connections that do not fit in type or unit of measurement. A signal of
        unit 1 connects to any unit, with a note.

    Examples
    --------
    >>> system = vdfmu.connect({"source": "source.fmu", "filter": LowPass}, {"source.y": "filter.u"})
    >>> results = system.run(stop=1.0, step=1e-3, parameters={"filter.T": 0.05})
    """
    folder = tempfile.TemporaryDirectory(prefix="vdfmu_")
    fmus: dict[str, str | os.PathLike[str]] = {}
    for each, part in components.items():
        if isinstance(part, str | os.PathLike) and Path(part).suffix.lower() == ".fmu":
            fmus[each] = part
            continue
        from vdfmu.arm.fmus import build  # takes long to import

        fmus[each] = build(part, Path(folder.name, each, f"{each}.fmu"), robot=robot, fmi=fmi)  # pyright: ignore[reportArgumentType]
    path = Path(folder.name, f"{name}.ssp")
    package = join(
        fmus, connections, path, name=name, stop=stop, step=step, algorithm=algorithm, parameters=parameters
    )  # fmt: skip
    return System(package, keep=folder)


@checks_types
def load(source: Scenario | str | os.PathLike[str], connections: Connections = ()) -> System:
    """Load a system: a package (``.ssp``), one FMU (``.fmu``), or a scenario by name or file.

    Parameters
    ----------
    source : Scenario, str or path
    connections : mapping of output to input or inputs, or sequence of such pairs
        For a scenario: additional connections, ``"plant.q": "controller.q"``, which replace those to the same inputs.

    Returns
    -------
    System

    Raises
    ------
    UsageError, SspError, ModelError
        If it does not exist or cannot be read.
    """
    ending = Path(source).suffix.lower() if isinstance(source, str | os.PathLike) else ""
    if ending == ".fmu":
        return load_fmu(source, connections)  # pyright: ignore[reportArgumentType]
    if ending == ".ssp":
        if connections:
            raise UsageError(f"connections are only for scenarios; the package {source} has its own. Omit them.")
        return System(Path(source))  # pyright: ignore[reportArgumentType]
    from vdfmu.study.analysis.arm_space import packaged  # takes long to import
    from vdfmu.study.run.prepare import scenario_of
    from vdfmu.system.scenario.replace import unfolded, with_units

    scenario = unfolded(scenario_of(source)) if isinstance(source, str | os.PathLike) else source
    if connections:
        scenario = with_units(scenario, {}, connections)
    with ExitStack() as stack:
        package, options = stack.enter_context(packaged(scenario))
        return System(package, options, keep=stack.pop_all(), scenario=scenario)


def load_fmu(fmu: str | os.PathLike[str], connections: Connections = (), algorithm: str | None = None) -> System:
    """Load one FMU as a system of the same name; see `load` and `connect`."""
    word = "".join(c if c.isalnum() and c.isascii() else "_" for c in Path(fmu).stem).lstrip("0123456789")
    name = word or "fmu"
    return connect({name: fmu}, connections, name=name, algorithm=algorithm)
