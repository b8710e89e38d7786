"""`Simulator`: load a system package once and run it many times."""

from __future__ import annotations

import shutil
from collections.abc import Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from vdfmu.base.errors import CosimError, UsageError
from vdfmu.base.files import no_temporary, temporary_folder
from vdfmu.base.option import checks_types, lists_options, with_options
from vdfmu.base.process import is_contained
from vdfmu.base.progress import shown_steps
from vdfmu.engine.algorithms import DEFAULT
from vdfmu.engine.fmu.messages import EventLog, LogMessage, MessageBox
from vdfmu.engine.masters.components import CONVERGENCE, Components, failure_message, report_exits, unpack_units
from vdfmu.engine.options import Limits, RowOptions, SimulatorOptions, read_stepper
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.package.system import FlatSystem, Value
from vdfmu.engine.plan.check import Checked, check_coupling, check_system, with_parameters, with_steps
from vdfmu.engine.plan.grid import Grid, count_steps
from vdfmu.engine.plan.inputs import outside, read_inputs
from vdfmu.engine.results.formats import format_of
from vdfmu.engine.results.recorder import Tap
from vdfmu.engine.results.results import Results
from vdfmu.engine.run.by_hand import ByHand
from vdfmu.engine.run.isolated import Isolated
from vdfmu.engine.run.run import Run, wanted

_PLAIN = (float, int, str)
"""Types of values that their text states to the bit; that of an array does not."""


@lists_options
class Simulator:
    """A system whose components are loaded once for many runs, and reset between them.

    Isolated components are loaded again for each run, and all components after a failed run.

    Parameters
    ----------
    system : FlatSystem, str or Path
        See :func:`vdfmu.engine.run.simulate`.
    **options
        :class:`vdfmu.engine.options.SimulatorOptions`, the options of :func:`simulate` except for `run`.

    Raises
    ------
    SspError, UsageError
        See :func:`vdfmu.engine.run.simulate`; raised here and at the beginning of the block.

    Examples
    --------
    >>> with Simulator("tracking.ssp") as simulator:
    ...     for mass in (0.5, 1.0, 1.5):
    ...         results = simulator.run(parameters={"plant.payload_mass": mass})
    ...     simulator.reset(stop=1.0)
    ...     while simulator.time < 1.0:
    ...         simulator.set("plant.F_e[3]", -10.0 * simulator.get("plant.p_O[3]"))
    ...         simulator.step()
    """

    @with_options
    def __init__(self, system: FlatSystem | str | Path, **options: Unpack[SimulatorOptions]) -> None:
        self._system = system if isinstance(system, FlatSystem) else load_ssp(system)
        experiment, tolerance = self._system.experiment, options["tolerance"]
        if options["algorithm"] is None:
            options["algorithm"] = experiment.algorithm
            if options["adaptive"] is None:
                options["adaptive"] = experiment.adaptive
        if tolerance is not None and not 0.0 < tolerance < np.inf:
            raise UsageError(f"tolerance must be positive and finite, got {tolerance}")
        check_coupling(options["algorithm"] or DEFAULT, options["adaptive"], options["convergence"])
        read_stepper(options["stepper"])
        self._options, self._limits = options, Limits(options["wait_limit"], options["memory_limit"])
        self._checked: Checked | None = None
        self._components: Components | Isolated | None = None
        self._loaded = ExitStack()
        """Context of the components: their folder, and the report of a component that ends the process."""
        self._box, self._resting = MessageBox(options["log"]), False
        self._lasts = False
        """Whether components may stay loaded after a run for later ones."""
        self._run: Run | None = None
        """The last run, if it is still needed or may be repeated."""
        self._results: Results | None = None
        """Results of the last run."""
        self._by_hand: ByHand | None = None
        self._begun: Any = None
        self._asked: tuple[Any, Checked] | None = None
        """Step and plain parameters of the last run, and the system with them."""
        self.owner: object = None
        """Object that keeps the files of the system, such as a temporary folder, as long as the simulator exists."""

    def __enter__(self) -> Simulator:
        options = self._options
        self._tables = read_inputs(options["inputs"], bool(options["input_hold"]))
        self._checked = check_system(
            self._system,
            options["parameters"],
            inputs=self._tables,
            algorithm=options["algorithm"],
            repeats=options["adaptive"] is not None,
            ignore_unmatched=options["ignore_unmatched"],
        )
        self.sizes = {
            f"{name}.{v.name}"
            for name, each in self._checked.descriptions.items()
            for v in each.named("structuralParameter")
        }
        """Parameters that are sizes of arrays."""
        self._names = {
            f"{name}.{v.name}": dict(v.items)
            for name, each in self._checked.descriptions.items()
            for v in (*each.named("output"), *each.named("input"))
            if v.items
        }
        return self

    def __exit__(self, _: object, error: BaseException | None, *__: object) -> None:
        self._checked = self._asked = None
        self._free(error)

    @with_options
    def run(
        self, *, parameters: Mapping[str, Value] | None = None, taps: Sequence[Tap] = (), **options: Unpack[RowOptions]
    ) -> Results:
        """Run the system from its start.

        Parameters
        ----------
        parameters : mapping of str to value, optional
            For this run; they override the simulator's.
        taps : sequence of Tap
            Taps that read the components at some rows; see `vdfmu.engine.results.recorder.Tap`.
        **options
            :class:`vdfmu.engine.options.RowOptions`.

        Raises
        ------
        UsageError, CosimError, Interrupted, VdfmuError
            See :func:`vdfmu.engine.run.simulate`; UsageError outside the block, too.
        """
        return self.run_with(options, parameters, taps)

    def run_with(
        self, options: RowOptions, parameters: Mapping[str, Value] | None = None, taps: Sequence[Tap] = ()
    ) -> Results:
        """Run the system like :meth:`run`, with options whose types were checked."""
        grid, stream = self.grid(options["start"], options["stop"], options["step"]), options["stream"]
        files = [stream] if isinstance(stream, Path) else list(stream or ())
        for path in files:
            format_of(path).needs()
        checked = self._prepared(grid.step, parameters)
        reach = outside(self._tables, grid.begin, grid.end) if self._tables else []
        with self._freeing():
            components = self._ready(checked, grid, reach)
            summary = {
                **(options["about"] or {}),
                "system": self._system.name,
                "algorithm": checked.algorithm,
                "adaptive": self._options["adaptive"],
                "order": list(checked.schedule.units),
                "start": grid.begin,
                "stop": grid.end,
                "step": grid.step,
                "steps": grid.n,
                "isolated": isinstance(components, Isolated),
                "held": [*checked.held],
                "notes": [*checked.notes, *reach],
                **({"names": self._names} if self._names else {}),
            }
            with shown_steps(options["progress"], "co-simulation") as progress:
                run = self._planned(components, grid, options["record"], files, taps, options["pace"] is not None)
                self._results = run.whole(summary, progress, options["observer"], options["pace"])
        return self._results

    def rest(self) -> bool:
        """Return whether components may stay loaded until the next run, during which none is called."""
        self._resting = self._components is not None and self._lasts
        return self._resting

    @checks_types
    def reset(
        self,
        *,
        start: float | None = None,
        stop: float | None = None,
        step: float | None = None,
        parameters: Mapping[str, Value] | None = None,
    ) -> None:
        """Begin a run by hand, with steps by :meth:`step`; for arguments see :meth:`run`.

        With the same arguments as before, components of FMI 2.0 restore their saved state if inputs are held over each
        step. All others are initialized again. For errors see :meth:`run`.
        """
        values = {key: repr(np.asarray(value).tolist()) for key, value in (parameters or {}).items()}  # 1 == True
        grid = self.grid(start, stop, step)
        begun = grid, values
        if self._by_hand is not None and self._begun == begun:
            with self._freeing():
                if self._by_hand.restart():
                    return
        checked = self._prepared(grid.step, parameters)
        with self._freeing():
            components = self._ready(checked, grid, again=True)
            self._by_hand, self._begun = ByHand(components, self._planned(components, grid, ())), begun

    @checks_types
    def step(self, count: int = 1) -> None:
        """Make steps by hand. UsageError beyond the stop, CosimError if a component fails or ends the run."""
        steps = self._by_hand or self._stepped
        try:
            steps.step(count)
        except (CosimError, KeyboardInterrupt) as error:
            if isinstance(error, CosimError) or isinstance(self._components, Isolated):  # an answer is outstanding
                self._free(error)
            raise

    @checks_types
    def set(self, name: str, value: Any) -> None:
        """Set an unconnected input, or a tunable parameter, ``component.variable``, for the next steps.

        Without an index `value` is for all elements: a number, or a list or array with one each.
        """
        self._stepped.set(name, value)

    @checks_types
    def get(self, name: str) -> Any:
        """Return the current value of ``component.variable``; without an index all elements of an array."""
        return self._stepped.get(name)

    @property
    def time(self) -> float:
        """Time [s] of a run by hand."""
        return self._stepped.time

    @property
    def _stepped(self) -> ByHand:
        if self._by_hand is None:
            raise UsageError("Simulator: no run by hand has begun. Call reset() in its block, again after each run().")
        return self._by_hand

    @contextmanager
    def _freeing(self) -> Generator[None]:
        """Free the components if the block fails."""
        try:
            yield
        except BaseException as error:
            self._free(error)
            raise

    def _free(self, error: BaseException | None = None) -> None:
        """Free the components and remove the unpacked FMUs; raise a failure, or report it beside an `error`."""
        components, results, box, failure = self._components, self._results, self._box, None
        self._components = self._results = self._run = self._by_hand = None
        if results is not None:
            box.time = float(results.time[-1])
        try:
            failure = None if components is None else components.close()
        finally:
            self._loaded.close()
        if failure is not None and error is not None:
            box.pending.append(failure_message(failure))
        box.flush()
        if results is not None:
            results.messages = list(box.kept)
        if failure is not None and error is None:
            failure.results = results
            raise failure

    def _prepared(self, step: float, parameters: Mapping[str, Value] | None) -> Checked:
        """Return the system with the parameters of a run."""
        if self._checked is None:
            raise UsageError("Simulator: run it within a block, 'with Simulator(...) as simulator:'.")
        plain = parameters is None or all(isinstance(value, _PLAIN) for value in parameters.values())
        asked = (step, repr(parameters)) if plain else None  # 1 == True, 0.0 == -0.0
        if asked is not None and self._asked is not None and self._asked[0] == asked:
            return self._asked[1]
        checked = with_steps(with_parameters(self._checked, parameters or {}), step)
        if parameters and self.sizes and (changed := checked.sizes.items() - self._checked.sizes.items()):
            names = ", ".join(sorted(name for name, _ in changed))
            raise UsageError(f"{names}: array sizes cannot change between runs. Pass them to the Simulator.")
        self._asked = None if asked is None else (asked, checked)
        return checked

    @property
    def checked(self) -> Checked:
        """The system with its FMUs, in a block."""
        assert self._checked is not None
        return self._checked

    def stand(self, time: float | None = None, step: float | None = None) -> Components | Isolated:
        """Run the system to a time, by default its start, and return its components with their inputs at this time.

        They stay loaded until the next run or the end of the block. For errors see :meth:`run`.
        """
        grid = self.grid(None, None, step)
        time = grid.begin if time is None else time
        if time == grid.begin:
            with self._freeing():
                self._ready(self._prepared(grid.step, None), grid)
        elif grid.begin < time < np.inf:
            self.run(stop=time, step=grid.step, record=())
        else:
            raise UsageError(f"at: expected a time of the run from {grid.begin:g} s, got {time:g} s.")
        components = self._components
        assert components is not None
        self._run = None  # the user may change what the run needs
        if time != grid.begin:
            components.bring_inputs(time)
        return components

    def _ready(
        self, checked: Checked, grid: Grid, notes: Sequence[str] = (), again: bool = False
    ) -> Components | Isolated:
        """Return the initialized components, after `notes`; with `again` isolated ones keep their process."""
        self._by_hand = None
        if isinstance(self._components, Isolated) and not again:
            self._free()
        if self._components is None:
            components = self._load(checked)
        else:
            components = self._components
            self._tell(checked)
            components.reset(checked)
        self._box.pending += [LogMessage("", grid.begin, "note", "", note) for note in notes]
        options = self._options
        components.initialize(grid.begin, grid.end, options["tolerance"], options["convergence"] or CONVERGENCE)
        return components

    def _load(self, checked: Checked) -> Components | Isolated:
        """Unpack and load the components in this process or in their own."""
        self._box.time = 0.0
        self._tell(checked)
        try:
            folder = Path(self._loaded.enter_context(temporary_folder("vdfmu-")))
        except OSError as error:
            raise no_temporary("FMUs", error) from error
        folders, foreign = unpack_units(checked, folder)
        isolate = self._options["isolate"]
        if isolate or (isolate is None and foreign and not is_contained()):
            self._components = Isolated(checked, folders, self._box, folder, self._limits)
        else:
            self._loaded.enter_context(report_exits(self._box, lambda: self._left(folder), lambda: self._resting))
            self._components = Components(checked, folders, self._box)
        once = any(each.once_per_process for each in checked.descriptions.values())
        self._lasts = not (foreign or once or isinstance(self._components, Isolated))
        self._components.load()
        return self._components

    def _left(self, folder: Path) -> str:
        """Save the rows of a process that a component ends; return a text about them."""
        shutil.rmtree(folder, ignore_errors=True)
        return "" if self._run is None else self._run.saved()

    def _tell(self, checked: Checked) -> None:
        """Discard the last run, except for a plan that stays valid, and report the notes of the next."""
        box = self._box
        box.flush()
        box.kept.clear()
        box.ended.clear()
        box.events = EventLog()
        self._results, self._resting = None, False
        if self._run is not None and not self._run.lasts:
            self._run = None
        box.pending += [LogMessage("", 0.0, "note", "", note) for note in checked.notes]
        box.flush()

    def _planned(
        self,
        components: Components | Isolated,
        grid: Grid,
        record: Sequence[str] | None,
        files: Sequence[Path] = (),
        taps: Sequence[Tap] = (),
        paced: bool = False,
    ) -> Run:
        """Return a run of the components: the last one if it may begin again."""
        run = self._run
        if run is None or not run.lasts or run.wanted != wanted(grid, record) or files or taps:
            run = self._run = Run(components, grid, record, self._options, files, taps, paced)
        return run

    def grid(self, start: float | None, stop: float | None, step: float | None) -> Grid:
        """Return start, stop, step and number of steps; UsageError when they do not fit."""
        experiment = self._system.experiment
        begin = start if start is not None else experiment.start or 0.0
        end = stop if stop is not None else experiment.stop
        step = step if step is not None else experiment.step
        if end is None:
            raise UsageError("stop: expected a time, because the system's default experiment has no stop time.")
        if step is None:
            raise UsageError("step: expected a communication step, because the default experiment has no step.")
        return Grid(float(begin), float(end), float(step), count_steps(step, end, begin))
