"""A whole system as one container FMU, without a master.

FMPy's container is an FMU 2.0 with the units inside. Its compiled code steps all units with one fixed step, with inputs
from the outputs at the start of the step. Its variables are ``component.variable``.
"""

from __future__ import annotations

import math
import os
import uuid
import zipfile
from collections.abc import Iterator, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import fmpy
import fmpy.model_description as fmi
from fmpy.container_fmu.cli import create_container_fmu
from fmpy.container_fmu.config import Component, Configuration, Connection
from fmpy.model_description import read_model_description

from vdfmu.base.errors import StorageError, UsageError
from vdfmu.base.files import pack_zip, require_ours, storing, temporary_folder
from vdfmu.base.option import checks_types
from vdfmu.base.standards import FMI_2
from vdfmu.base.version import __version__
from vdfmu.engine.algorithms import DELAYED
from vdfmu.engine.fmu.description import Description
from vdfmu.engine.package.archive import Archive
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.package.system import FlatSystem
from vdfmu.engine.plan.check import Checked, check_system, with_steps
from vdfmu.engine.plan.conversion import Link
from vdfmu.engine.plan.graph import cycles, topological


@checks_types
def write_container(system: FlatSystem | str | os.PathLike[str], path: str | os.PathLike[str], *, step: float) -> Path:
    """Write the container FMU of a system.

    Parameters
    ----------
    system : System or path
        An SSP of FMI 2.0 units with native binaries, because Python FMUs do not run inside a container.
    path : path
        The FMU to write.
    step : float [s]
        The step at which the units exchange values. The container's own step must be a multiple of it.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    SspError
        If the system cannot be run; see :func:`vdfmu.engine.plan.check.check_system`.
    UsageError
        If a connection changes units or values, or a unit needs Python.
    FmuError
        If the file cannot be written.
    """
    if not 0.0 < step < math.inf:
        raise UsageError(f"step: expected a positive finite time, got {step:g} s.")
    checked = check_system(system if isinstance(system, FlatSystem) else load_ssp(Path(system)), algorithm=DELAYED)
    if slow := [component.name for component in checked.system.components if component.step is not None]:
        raise UsageError(
            f"{', '.join(slow)}: has its own step, but a container FMU steps all together. Remove its annotation."
        )
    with_steps(checked, step)
    for link in checked.links:
        if not link.conversion.trivial:
            raise UsageError(f"{link}: a container FMU passes values on unchanged; remove the conversion.")
        if link.source.kind != link.sink.kind:
            raise UsageError(f"{link}: a container FMU converts no types, got {link.source.type} to {link.sink.type}.")
        if link.sink.type == "String":
            raise UsageError(f"{link}: a container FMU passes no text on; remove the connection.")
    if exchanged := [name for name, description in checked.descriptions.items() if description.exchange]:
        raise UsageError(f"{exchanged[0]}: a container FMU steps co-simulation; it is for model exchange.")
    if loops := checked.schedule.initial.loops:
        raise UsageError(
            f"algebraic loop during initialization: {loops[0]}. A container FMU passes values on once and does not "
            "solve it; break the loop, or run the system without a container."
        )
    path = Path(path)
    require_ours(path)
    with storing(path), temporary_folder("vdfmu_container_") as folder:
        _write(checked, path, step, Path(folder))
    return path


def _write(checked: Checked, path: Path, step: float, folder: Path) -> None:
    components: dict[str, Component] = {}
    for name, description in checked.descriptions.items():
        if description.version != FMI_2:
            raise UsageError(
                f"{name}: {description.source} is an FMU of FMI {description.version.name}; a container holds "
                f"units of FMI {FMI_2.name}. Build it with --fmi {FMI_2.name}."
            )
        file = folder / f"{name}.fmu"
        with Archive(checked.system.path, checked.system.path.name) as package, file.open("wb") as target:
            package.copy(description.source, target)
        model = read_model_description(str(file))
        if model.coSimulation is not None and model.coSimulation.needsExecutionTool:
            raise UsageError(
                f"{description.source}: needs Python, but a container loads no Python. Build native FMUs: "
                "`vdfmu build --backend native`."
            )
        components[name] = Component(name, file, model)
    model, mappings = _model(checked, components, step)
    connections: list[Connection] = []
    for bundle in _bundles(checked):
        start, end = components[bundle[0].start[0]], components[bundle[0].end[0]]
        sources = [_variable(start, link.start[1]) for link in bundle]
        for source in sources:
            kind: Any = _FMI_3_TYPE.get(source.type, source.type)
            source.type = kind
        connections.append(Connection(start, sources, end, [_variable(end, link.end[1]) for link in bundle]))
    configuration = Configuration(
        parallelDoStep=False,
        modelDescription=model,
        components=list(components.values()),
        connections=connections,
        variableMappings=mappings,
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    unzipped, whole = folder / "unzipped", folder / "container.fmu"
    unzipped.mkdir()  # pack empties it first
    try:
        create_container_fmu(configuration, unzipped, whole)
    except zipfile.BadZipFile as error:  # the file was just written
        raise StorageError(f"{path}: cannot be written: {error}. Repeat the command.") from None
    # repacked for reproducible bytes, and because fmpy skips files that the disk fails to list
    pack_zip(path, {str(file.relative_to(unzipped).as_posix()): file.read_bytes() for file in _files(unzipped)})


def _files(folder: Path) -> Iterator[Path]:
    """Yield all files below a folder; OSError if the disk fails to list them."""

    def fail(error: OSError) -> None:
        raise error

    for place, _, names in os.walk(folder, onerror=fail):
        yield from (Path(place, name) for name in names)


def _bundles(checked: Checked) -> list[list[Link]]:
    """Return the connections that each call of the container carries, in the order of the initialization.

    A bundle contains all connections of a type between two units, unless bundles would depend on each other in a cycle.
    """
    whole: dict[tuple[str, str, str], list[Link]] = {}
    for link in checked.schedule.initial.links:
        whole.setdefault((link.start[0], link.end[0], link.source.type), []).append(link)
    edges = {
        (before, after)
        for before, feeding in whole.items()
        for after, fed in whole.items()
        if before[1] == after[0] and _feeds(checked.descriptions[after[0]], feeding, fed)
    }
    if cycles(list(whole), edges):
        return [[link] for link in checked.schedule.initial.links]
    return [whole[key] for key in topological(list(whole), edges)]


def _feeds(unit: Description, feeding: Sequence[Link], fed: Sequence[Link]) -> bool:
    """Return whether outputs of a unit depend on inputs during initialization."""
    arriving = {link.end[1] for link in feeding}
    declared = [unit.initial_dependencies.get(link.start[1]) for link in fed]
    return any(names is None or arriving & names for names in declared)


_FMI_3_TYPE = {"Real": "Float64", "Integer": "Int32"}
"""Names of FMI 2.0's types in the container's configuration; fmpy translates them only for variables."""


def _variable(component: Component, name: str) -> fmi.ModelVariable:
    return next(v for v in component.modelDescription.modelVariables if v.name == name)


def _model(
    checked: Checked, components: dict[str, Component], step: float
) -> tuple[fmi.ModelDescription, dict[fmi.ModelVariable, list[tuple[Component, fmi.ModelVariable]]]]:
    """Return the container's model description, and for each of its variables the variable of the unit."""
    connected = {link.end for link in checked.links}
    units: dict[str, Any] = {}
    # value reference 0 is the time; fmpy numbers the variables in order
    time = fmi.ModelVariable(name="time", type="Real", causality="independent", variability="continuous")
    variables, mappings = [time], {}
    for name, component in components.items():
        values = checked.starts.get(name, ())
        starts = {v.name: str(x).lower() if isinstance(x, bool) else str(x) for v, x in values}
        for definition in component.modelDescription.unitDefinitions:
            units.setdefault(str(definition.name), definition)
        for inner in component.modelDescription.modelVariables:
            if inner.causality not in ("input", "output", "parameter") or (name, inner.name) in connected:
                continue
            outer = fmi.ModelVariable(
                name=f"{name}.{inner.name}",
                type=inner.type,
                description=inner.description,
                causality=inner.causality,
                variability=inner.variability,
                initial=None if inner.causality == "input" else inner.initial,  # fmpy fills it in
                unit=inner.unit,
                min=inner.min,
                max=inner.max,
                start=starts.get(inner.name, inner.start),
            )
            variables.append(outer)
            mappings[outer] = [(component, inner)]
    outputs = [fmi.Unknown(variable=v) for v in variables if v.causality == "output"]
    tokens = "\n".join(str(c.modelDescription.instantiationToken) for c in components.values())
    content = f"{tokens}\n{step!r}\n{[(v.name, v.start) for v in variables]}"
    token = "{" + str(uuid.UUID(bytes=sha256(content.encode()).digest()[:16])) + "}"
    experiment = checked.system.experiment
    default = fmi.DefaultExperiment(
        startTime=f"{experiment.start or 0.0!r}",
        stopTime=None if experiment.stop is None else repr(experiment.stop),
        stepSize=repr(step),
    )
    model = fmi.ModelDescription(
        fmiVersion=FMI_2.name,
        modelName=checked.system.name,
        instantiationToken=token,
        description=f"The system {checked.system.name} as one FMU; its units exchange values every {step:g} s",
        generationTool=f"vdfmu {__version__}, fmpy {fmpy.__version__}",
        variableNamingConvention="structured",
        coSimulation=fmi.CoSimulation(modelIdentifier="container_fmu", fixedInternalStepSize=step),
        unitDefinitions=list(units.values()),
        defaultExperiment=default,
        modelVariables=variables,
        outputs=outputs,
        initialUnknowns=[fmi.Unknown(variable=unknown.variable) for unknown in outputs],
    )
    return model, mappings
