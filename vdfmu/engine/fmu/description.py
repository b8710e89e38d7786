"""Description of an FMU for the master, read from its model description."""

from __future__ import annotations

import math
import pickle
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256
from typing import Any

import fmpy
import numpy as np
from fmpy.model_description import (
    CoSimulation,
    DefaultExperiment,
    ModelDescription,
    Unknown,
    ValidationError,
    read_model_description,
)

from vdfmu.base.cache import built_as, cache_folder, load, store
from vdfmu.base.errors import SspError
from vdfmu.base.sources import source_digest
from vdfmu.base.standards import FMI_1, FMI_2, MASTER_VERSIONS, FmiVersion
from vdfmu.engine.fmu.variables import FmuVariable, element_names, read_variables, type_of
from vdfmu.engine.package.archive import Archive
from vdfmu.engine.package.elements import read_units
from vdfmu.engine.package.parse import parse_xml
from vdfmu.engine.package.system import Value
from vdfmu.engine.rules import Finding, breach, finding, fmpy_finding

KINDS = ("CoSimulation", "ModelExchange", "ScheduledExecution")
_UNIT = "resources/unit.py"
"""Member of this project's Python FMUs that contains the code of a user's unit."""
_TRUE = {"true", "1"}
_SAMPLED, _CONTINUOUS = (f".//{{urn:org.vdfmu.sampled}}{tag}" for tag in ("Sampled", "Continuous"))
_CHOICES = "{urn:org.vdfmu.choices}"
_CONTINUOUS_INPUT = {("input", None), ("input", "continuous")}


@dataclass(frozen=True)
class Description:
    """An FMU, for co-simulation or for model exchange."""

    source: str
    identifier: str
    guid: str
    once_per_process: bool
    variables: Mapping[str, FmuVariable]
    """The variables, arrays as their elements."""
    step_dependencies: Mapping[str, frozenset[str] | None]
    """Names on which each output depends in the steps. None means all, because the FMU states no dependencies."""
    initial_dependencies: Mapping[str, frozenset[str] | None]
    """The same during initialization, for each initial unknown."""
    version: FmiVersion = FMI_2
    shapes: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """Shapes of the arrays."""
    saves_state: bool = False
    """Whether its state can be saved and restored, so that a step can be repeated."""
    serializes_state: bool = False
    """Whether its saved state can be written to bytes."""
    interpolates_inputs: bool = False
    """Whether it accepts derivatives of real inputs, to ramp them over a step."""
    updates_inputs: bool = False
    """Whether its real inputs can be set in intermediate updates of co-simulation (FMI 3.0)."""
    derives_outputs: bool = False
    """Whether it provides time derivatives of its outputs."""
    derives_unknowns: bool = False
    """Whether it provides directional derivatives."""
    states: tuple[tuple[int, int, int], ...] = ()
    """Value references of its continuous states and of their derivatives, and their lengths."""
    varies_steps: bool = True
    """Whether its steps may vary in length."""
    event_mode: bool = False
    """Whether it has events of co-simulation that the master can handle."""
    exchange: bool = False
    """Whether it is for model exchange."""
    sizes: tuple[int, int] = (0, 0)
    """Numbers of continuous states and of event indicators."""
    tolerance: float | None = None
    """Relative tolerance of the default experiment, for co-simulation; None if a parameter ``tolerance`` decides."""
    stop: float | None = None
    """Stop time [s] of the default experiment."""
    step: float | None = None
    """Step [s] of the default experiment."""
    tool: str = ""
    """The tool that made it, as stated in the FMU."""
    period: str = ""
    """Parameter with the time between samples of its discrete outputs, from an annotation of this project. They are
    states that change at the start of a step with its inputs; directional derivatives refer to the next sample."""
    samples: bool | None = None
    """Whether it samples its inputs, from the same annotation: every `period`, else once per step. None if it does not
    declare whether it is sampled or continuous."""

    @property
    def sampled(self) -> list[FmuVariable]:
        """The sampled states, if the FMU names their period."""
        return [v for v in self.named("output") if self.period and v.variability == "discrete"]

    @property
    def recordable(self) -> list[FmuVariable]:
        """The outputs, or the local variables if there are no outputs."""
        return self.named("output") or self.named("local")

    @property
    def names(self) -> list[str]:
        """The variables as in the FMU: scalars, and arrays as a whole."""
        return [*(v.name for v in self.variables.values() if v.length == 1), *self.shapes]

    def elements(self, name: str, index: Sequence[int] = ()) -> list[FmuVariable]:
        """Return a variable, the elements of an array or those of a part of it; empty if the name is unknown."""
        if name not in self.shapes:
            return [self.variables[name]] if name in self.variables else []
        shape, start = self.shapes[name], tuple(i - 1 for i in index)
        places = zip(np.ndindex(*shape), element_names(name, shape), strict=True)
        return [self.variables[each] for place, each in places if place[: len(start)] == start]

    def named(self, causality: str) -> list[FmuVariable]:
        """Return the variables of one causality, in the order of the FMU."""
        return list(self._named.get(causality, ()))

    @cached_property
    def _named(self) -> dict[str, list[FmuVariable]]:
        by_causality: dict[str, list[FmuVariable]] = {}
        for v in self.variables.values():
            by_causality.setdefault(v.causality, []).append(v)
        return by_causality


def is_own(unit: Archive) -> bool:
    """Return whether this user built exactly these bytes here, and without a user's Python unit in the FMU.

    Only such FMUs run in this process; all others run in a separate process.
    """
    return _UNIT not in unit and built_as(unit.file) is not None


def library_name(identifier: str, version: FmiVersion) -> str:
    """Return the member of an FMU with the binary for this platform."""
    platform = fmpy.platform_tuple if version.platform_tuples else fmpy.platform
    return f"binaries/{platform}/{identifier}{fmpy.sharedLibraryExtension}"


def inspect_description(
    unit: Archive, source: str, implementation: str = "any", sizes: Mapping[str, Value] | None = None
) -> tuple[Description | None, list[Finding]]:
    """Read an FMU as far as possible and return all problems; None if the model description cannot be understood.

    `source` is its name in messages, `implementation` the type of FMU in the SSD. `sizes` replace start values of
    structural parameters and so determine the shapes of arrays. A description without problems is cached under
    everything that determines it.
    """
    try:
        xml, sizes = unit.read("modelDescription.xml"), sizes or {}
        code = source_digest("engine.fmu.description"), fmpy.__version__, fmpy.platform_tuple
        facts = code, source, implementation, sizes, unit.names
        path = cache_folder() / "descriptions" / sha256(repr(facts).encode() + xml).hexdigest()
        if (kept := load(path, pickle.loads)) is not None:
            return kept, []
        description, problems = _inspect(unit, xml, source, implementation, sizes)
    except SspError as error:
        return None, error.problems
    if not problems:
        store(path, pickle.dumps(description))
    return description, problems


def _inspect(
    unit: Archive, xml: bytes, source: str, implementation: str, sizes: Mapping[str, Value]
) -> tuple[Description | None, list[Finding]]:
    names = unit.names
    root = parse_xml(xml, f"{source}: modelDescription.xml")
    version = MASTER_VERSIONS.get(root.get("fmiVersion") or "")
    if version is None or (version is FMI_1 and root.find("Implementation") is None):
        got = f"{source}: is an FMU of FMI {root.get('fmiVersion')}{' for model exchange' if version else ''}"
        raise breach("RUN007", f"{got}; the master runs FMI 2.0 and 3.0, and FMI 1.0 for co-simulation", root)
    problems: list[Finding] = []
    try:
        model = read_model_description(unit.file)
    except Exception as error:  # fmpy raises bare exceptions
        faults = error.problems if isinstance(error, ValidationError) else [error]
        broken = [fmpy_finding(str(f), f"{source}: faulty model description: {f}") for f in faults]
        problems += [text for text in broken if text.rule.number != "FMI013"]  # missing entries count as all
        try:
            model = read_model_description(unit.file, validate=False)
        except Exception:
            raise SspError(problems or broken) from None
    if version is FMI_1:
        _complete(model, root)
    for variable in model.modelVariables if sizes else ():
        chosen = [sizes.get(d.variable.name, d.variable.start) if d.variable else d.start for d in variable.dimensions]
        variable.shape = tuple(int(size) for size in chosen)  # pyright: ignore[reportArgumentType]
    kinds = [kind for kind in KINDS if getattr(model, kind[0].lower() + kind[1:], None) is not None]
    parts = {"CoSimulation": model.coSimulation, "ModelExchange": model.modelExchange}
    wanted = [kind for kind in kinds if kind in parts and implementation in ("any", kind)]
    if implementation not in ("any", *kinds):
        text = f"the SSD requires {implementation}, {source} has {' and '.join(kinds) or 'none'}"
        problems.append(finding("SSP045", text))
    elif not wanted:
        text = f"{source}: expected an FMU for {' or '.join(parts)}, got one for {' and '.join(kinds) or 'neither'}"
        problems.append(finding("RUN007", text, root))
    part = parts[wanted[0]] if wanted else None
    identifier = "" if part is None else str(part.modelIdentifier)
    library = library_name(identifier, version)
    if identifier and library not in names:
        has = sorted({n.split("/")[1] for n in names if n.startswith("binaries/") and n.count("/") > 1})
        text = f"{source}: has no binary for this platform ({library}); it has {', '.join(has) or 'none'}"
        problems.append(finding("FMI017", text))
    try:
        return _describe(model, root, source, wanted[:1] == ["ModelExchange"]), problems
    except (ValueError, TypeError, AttributeError):  # the text violates the schema
        if not problems:
            raise
        return None, problems


def _complete(model: ModelDescription, root: Any) -> None:
    """Complete fmpy's description of FMI 1.0 with the parts that FMI 2.0 states elsewhere."""
    items = {item.get("name"): item for item in root.iterfind("ModelVariables/ScalarVariable")}
    # fmpy returns the value of the original, without the sign
    model.modelVariables = [v for v in model.modelVariables if items[v.name].get("alias") != "negatedAlias"]
    variables = {v.name: v for v in model.modelVariables}
    for v in model.modelVariables:
        v.initial = None if v.start is None else "exact" if v.causality == "parameter" else "approx"
        v.causality = v.causality if v.causality in ("input", "output", "parameter") else "local"
        if v.causality == "output":
            direct = items[v.name].find("DirectDependency")
            names = None if direct is None else [name.text for name in direct]
            needs = None if names is None else [variables[name] for name in names if name in variables]
            model.outputs.append(Unknown(variable=v, dependencies=needs))
    part, able = model.coSimulation, root.find("Implementation//Capabilities")
    if part is not None and able is not None:
        for flag in ("canHandleVariableCommunicationStepSize", "canInterpolateInputs"):
            setattr(part, flag, able.get(flag) in _TRUE)
        part.canBeInstantiatedOnlyOncePerProcess = able.get("canBeInstantiatedOnlyOncePerProcess") in _TRUE
        part.maxOutputDerivativeOrder = int(able.get("maxOutputDerivativeOrder", 0))


def _describe(model: ModelDescription, root: Any, source: str, exchange: bool) -> Description:
    derived: list[Any] = [u.variable for u in model.derivatives]
    rates = [v for v in derived if v.derivative is not None]
    part: Any = (model.modelExchange if exchange else model.coSimulation) or CoSimulation()
    experiment = model.defaultExperiment or DefaultExperiment()
    # a parameter of this name would be overridden at set-up
    own_tolerance = any(v.name == "tolerance" and v.causality == "parameter" for v in model.modelVariables)
    relative = {
        v.get("name")
        for v in root.iterfind("ModelVariables/*")
        for typed in (v, *v.iterfind("Real"))
        if typed.get("relativeQuantity") in _TRUE
    }
    updated = all(
        v.get("intermediateUpdate") in _TRUE
        for v in root.iterfind("ModelVariables/*")
        if type_of(v.tag) == "Real" and (v.get("causality"), v.get("variability")) in _CONTINUOUS_INPUT
    )
    clocks = {v.get("name"): v for v in root.iterfind("ModelVariables/Clock")}
    names = {
        listed.get("name"): {each.get("name", ""): i for i, each in enumerate(listed.iterfind(f"{_CHOICES}Choice"))}
        for listed in root.iterfind(f".//{_CHOICES}Variable")
    }
    return Description(
        source=source,
        identifier=str(part.modelIdentifier or ""),
        guid=str(model.guid),
        once_per_process=bool(part.canBeInstantiatedOnlyOncePerProcess),
        variables=read_variables(model, relative, read_units(root.iterfind("UnitDefinitions/Unit")), clocks, names),
        shapes={v.name: tuple(v.shape) for v in model.modelVariables if v.shape},
        step_dependencies=_unknowns(model.outputs),
        initial_dependencies=_unknowns(model.initialUnknowns),
        version=MASTER_VERSIONS[str(model.fmiVersion)],
        saves_state=bool(part.canGetAndSetFMUstate),
        serializes_state=_declared(root, exchange, "canSerializeFMUstate", "canSerializeFMUState"),
        varies_steps=exchange or bool(part.canHandleVariableCommunicationStepSize),
        interpolates_inputs=exchange or bool(part.canInterpolateInputs),
        updates_inputs=not exchange and bool(part.providesIntermediateUpdate) and updated,
        derives_outputs=not exchange and part.maxOutputDerivativeOrder > 0,
        derives_unknowns=_declared(root, exchange, "providesDirectionalDerivative", "providesDirectionalDerivatives"),
        states=tuple((v.derivative.valueReference, v.valueReference, math.prod(v.shape or ())) for v in rates),
        event_mode=not exchange and bool(part.hasEventMode),
        exchange=exchange,
        sizes=(model.numberOfContinuousStates, model.numberOfEventIndicators),
        tolerance=None if exchange or own_tolerance else _positive(experiment.tolerance),
        stop=_positive(experiment.stopTime),
        step=_positive(experiment.stepSize),
        tool=str(model.generationTool or ""),
        period=next((e.get("period", "") for e in root.iterfind(_SAMPLED)), ""),
        samples=True if root.find(_SAMPLED) is not None else False if root.find(_CONTINUOUS) is not None else None,
    )


def _positive(text: str | None) -> float | None:
    number = float(text or 0.0)
    return number if 0.0 < number < math.inf else None


def _declared(root: Any, exchange: bool, *flags: str) -> bool:
    """Return whether an FMU declares a capability by a flag of FMI 2.0 or 3.0; FMPy reads few of these flags."""
    parts = root.iterfind("ModelExchange" if exchange else "CoSimulation")
    return any(part.get(flag) in _TRUE for part in parts for flag in flags)


def _unknowns(unknowns: Iterable[Any]) -> dict[str, frozenset[str] | None]:
    names: dict[str, frozenset[str] | None] = {}
    for u in unknowns:
        elements = (each for v in u.dependencies or () for each in element_names(v.name, v.shape))
        needs = None if u.dependencies is None else frozenset(elements)
        names |= dict.fromkeys(element_names(u.variable.name, u.variable.shape), needs)
    return names
