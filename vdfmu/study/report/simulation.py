"""Data for the page of a run to run it again by itself: units as WebAssembly, start values, connections, knobs.

A unit is compiled from the C files in its FMU, without the derivatives of its functions, which the page does not need.
The functions are FMI 2.0's, in which a value reference is a position, whatever the version of the FMU.
``web/master.js`` steps the units like :class:`~vdfmu.engine.masters.sampled.SampledStepper`.
"""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vdfmu.base.errors import VdfmuError
from vdfmu.base.files import data_path, source_bytes
from vdfmu.base.seal import is_own
from vdfmu.base.standards import FMI_2
from vdfmu.compiler.c.compile import Compilation, compile_libraries, compiling
from vdfmu.compiler.c.platforms import WASM, native_available
from vdfmu.compiler.fmu.content import installed_digest
from vdfmu.compiler.fmu.native import fmi_headers
from vdfmu.engine.algorithms import ALGORITHMS, choice
from vdfmu.engine.fmu.variables import FmuVariable, Value
from vdfmu.engine.package.archive import Archive
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.plan.check import Checked, check_system
from vdfmu.engine.plan.conversion import Link
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.results.results import Results
from vdfmu.study.report.causes import LESS, causes, scaled_as
from vdfmu.study.report.curves import packed
from vdfmu.study.report.tracks import GOOD, POOR, tracks

ROWS = 100
"""Intervals between the recorded rows to which the page's own run is compared."""
LIMIT = 1e-9
"""Difference [rad, m] below which the page's own run is the recorded one. Its sin, cos and tanh differ by 1e-15."""
_APART = 3.0
"""Factor on the distance of a run from itself with a small change: both reach the largest distance, at other times."""
_UNKNOWN = (
    "Whether single solutions of this loop separate, whose last digits grow, was not found out: the run has no "
    "reference."
)
_SEPARATES = "Single solutions of this loop separate: two runs whose last digits differ are as far apart after a while."
MOST_VALUES = 20_000_000
"""Values of a run that a page keeps, 160 MB."""
NOT_MADE = (
    "This page has no simulation: 'vdfmu report' with the folder of the run makes one that has, and so do 'vdfmu run' "
    "and simulate=True in Python."
)
"""Shown instead of one."""
MOST_C = 2_400_000
"""Bytes of generated C of a run, a fifth of it as compressed modules: it keeps a page below 1 MB."""
MOST_MODULES = 660_000
"""Characters of the compressed modules of a page of several runs, for the same reason."""
_FUNCTIONS = (
    "fmi2Instantiate", "fmi2SetupExperiment", "fmi2EnterInitializationMode", "fmi2ExitInitializationMode",
    "fmi2SetReal", "fmi2SetInteger", "fmi2SetBoolean", "fmi2GetReal", "fmi2DoStep",
)  # fmt: skip
"""Functions that the page calls; code that only others call is not in its modules."""
_DERIVATIVE = re.compile(r"^(void \w+_(?:forward|reverse)\([^;]*\));", re.MULTILINE)
_LEFT_OUT = re.compile(r"kernel_\w+_(forward|reverse)(_part_\d+)?\.c|kernel_\w+_avx2\.c|operations\.[ch]|fmi3\.c")


class _CannotError(Exception):
    """Why a run cannot be simulated in its page, in plain words."""


class Knob(NamedTuple):
    """Parameters of a unit that a slider of the page scales."""

    words: str
    model: str
    names: tuple[str, ...]
    least: float = 0.1
    most: float = 10.0
    known: bool = False
    """Whether the feedforward has them too and may know the change."""


KNOBS = (
    Knob("Proportional gains", "PDController", ("K_p",)),
    Knob("Derivative gains", "PDController", ("K_v",)),
    Knob("Masses and inertias of links", "Plant", scaled_as("mass"), 0.5, 2.0, True),
    Knob("Mass of the payload", "Plant", scaled_as("payload"), 0.0, 3.0, True),
    Knob("Stiffness of the drives", "Plant", scaled_as("stiffness"), 0.2, 5.0, True),
    Knob("Friction", "Plant", scaled_as("friction"), 0.0, 3.0, True),
    Knob("Duration of the motion", "Trajectory", ("T",), 0.5, 2.0),
    Knob("Speed of the motion", "", ("speed",), 0.5, 2.0),
)
"""Parameters that the sliders may change, where a system has them; an empty model is any."""


def simulation_of(
    results: Results, summary: Mapping[str, Any], package: Path, binaries: dict[str, str] | None
) -> dict[str, Any]:
    """Return the page's simulation, ready for JSON; ``{"reason": ..}`` where it cannot.

    `binaries`: digest to base64 of a compressed module, to which those of the run's units are added. None: the page is
    to have none.
    """
    try:
        _refuse(summary, package)
        if binaries is None:
            return {"reason": NOT_MADE}
        checked = _checked(summary, package)
        steps = int(summary["steps"])
        outputs = sum(len(_outputs(checked, name)) for name in checked.descriptions)
        if steps * outputs > MOST_VALUES:
            raise _CannotError(f"it has {steps} steps of {outputs} signals, too much for a page")
        return _simulation(results, summary, checked, _modules(checked, binaries))
    except _CannotError as error:
        return {"reason": f"This run is not simulated here: {error}."}
    except VdfmuError as error:
        return {"reason": f"This run is not simulated here: {str(error).splitlines()[0]}"}


def _refuse(summary: Mapping[str, Any], package: Path) -> None:
    """Raise for a run that the page's master cannot make, as far as its summary tells."""
    master = str(summary.get("algorithm"))
    if "scenario" not in summary:
        raise _CannotError("only those of scenarios are, which 'vdfmu run' makes")
    if summary.get("backend") != "native":
        raise _CannotError("its units are Python FMUs")
    if master not in ALGORITHMS or ALGORITHMS[master].substeps != 1:
        raise _CannotError(f"its master is {master}, and the page's is {choice(substeps=1)}")
    if summary.get("inputs"):
        raise _CannotError("some of its inputs come from files")
    if not package.is_file():
        raise _CannotError("its package, system.ssp, is not beside the results")
    if not native_available():
        raise _CannotError("the compiler was not there when the page was made; 'pip install vdfmu[native]'")
    if not is_own(summary.get("seal"), package):
        raise _CannotError("it was not made with this cache, and a look at a run does not run its code")


def _checked(summary: Mapping[str, Any], package: Path) -> Checked:
    """Return the run's system, if the page's master can run it."""
    checked = check_system(load_ssp(package), algorithm=summary["algorithm"])
    if checked.multiples or any(component.step is not None for component in checked.system.components):
        raise _CannotError("its units have steps of their own")
    if checked.schedule.groups:
        raise _CannotError("components of it are integrated together")
    if checked.schedule.initial.torn:
        raise _CannotError("its initial values depend on each other")
    other = [str(link) for link in checked.links if {link.source.type, link.sink.type} != {"Real"}]
    if other:
        raise _CannotError(f"a connection carries other than real numbers, {other[0]}")
    return checked


@contextmanager
def compiling_modules(summary: Mapping[str, Any], package: Path) -> Generator[Callable[[], None]]:
    """Compile what a page's simulation needs while the block runs; the yielded function waits until the cache has it.

    Nothing is compiled for a run that :func:`simulation_of` refuses.
    """
    with ExitStack() as stack:
        made: Callable[[], object] = list[bytes]
        with suppress(_CannotError, VdfmuError):
            _refuse(summary, package)
            jobs = _compilations(_checked(summary, package))
            made = stack.enter_context(compiling(jobs.values()))

        def wait() -> None:
            with suppress(VdfmuError):  # which the page will say
                made()

        yield wait


def _compilations(checked: Checked) -> dict[str, Compilation]:
    """Return the module to make of each FMU, by source."""
    sources = {d.source: d for d in checked.descriptions.values()}
    jobs: dict[str, Compilation] = {}
    path = checked.system.path
    with Archive(path, path.name) as package:
        for source, description in sources.items():
            with package.opened(source, source) as unit:
                files = _sources(unit, source) | fmi_headers(FMI_2.name)
            jobs[source] = Compilation(description.identifier, files, WASM, exported=_FUNCTIONS)
    size = sum(len(c) for job in jobs.values() for name, c in job.sources.items() if name.startswith("kernel_"))
    if size > MOST_C:
        raise _CannotError(f"its units, {size / 1e6:.1f} MB of C, would make the page larger than 1 MB")
    return jobs


def _modules(checked: Checked, binaries: dict[str, str]) -> dict[str, str]:
    """Return the digest of the module of each unit's FMU, and add the modules."""
    jobs = _compilations(checked)
    modules = dict(zip(jobs, compile_libraries(jobs.values()), strict=True))
    found = {source: sha256(module).hexdigest()[:16] for source, module in modules.items()}
    added = {found[source]: compressed(module) for source, module in modules.items()}
    if binaries and sum(map(len, (binaries | added).values())) > MOST_MODULES:
        raise _CannotError("with its units too the page would be larger than 1 MB; make a page of this run alone")
    binaries |= added
    return found


def compressed(content: bytes) -> str:
    """Return the text that ``unzip`` of ``web/packed.js`` reads."""
    return base64.b64encode(gzip.compress(content, 6, mtime=0)).decode()


def _sources(unit: Archive, source: str) -> dict[str, bytes]:
    """Return the C files of a unit that the page needs."""
    if "extra/vdfmu/vdfmu.json" not in unit.names or "sources/unit.c" not in unit.names:
        raise _CannotError(f"{source} was built by another tool")
    names = [name for name in unit.names if name.startswith("sources/") and name.endswith((".c", ".h"))]
    files = {name.removeprefix("sources/"): unit.read(name) for name in names}
    if "fmi2.c" not in files:  # an FMU of FMI 3.0
        built = json.loads(unit.read("extra/vdfmu/vdfmu.json"))
        if built.get("digest") != installed_digest("native", built.get("module"), built.get("reader")):
            raise _CannotError(f"{source} was built by another version of vdfmu")
        files["fmi2.c"] = source_bytes(data_path("fmu_src") / "c" / "fmi2.c")
    absent = _DERIVATIVE.findall(files["kernel.h"].decode())
    text = "".join(f"{prototype}\n{{\n    __builtin_trap();\n}}\n" for prototype in absent)
    kept = {name: content for name, content in files.items() if not _LEFT_OUT.fullmatch(name)}
    return kept | {"absent.c": f'#include "kernel.h"\n{text}'.encode()}


def _position(variable: FmuVariable) -> int:
    """Return the value reference in FMI 2.0; in FMI 3.0 an array has its first element's."""
    return variable.reference + variable.index


def _outputs(checked: Checked, name: str) -> list[FmuVariable]:
    return [v for v in checked.descriptions[name].named("output") if v.type == "Real"]


def _simulation(
    results: Results, summary: Mapping[str, Any], checked: Checked, modules: Mapping[str, str]
) -> dict[str, Any]:
    names = list(checked.descriptions)
    places = {
        port: place for place, port in enumerate((name, v.name) for name in names for v in _outputs(checked, name))
    }
    begin, stop, step, steps = (summary[key] for key in ("start", "stop", "step", "steps"))
    sliders = list(knobs(checked))
    values = values_of(checked)
    figures: Mapping[str, Any] = summary.get("key_figures") or {}
    why = ""
    if "unstable" in figures:  # one place of a limit cycle says little about another gain
        why = "no margins along it: the run itself is unstable"
    margin = figures.get("margin", {})
    if not margin.get("value", 1.0):
        why = f"no margins along it: the run has none at {margin['at_s']:.3g} s"
    dry = "without_dry_friction" not in margin
    given = [[None]] * len(sliders) if why else tracks(checked, sliders, values, (begin, stop, step), dry)
    for slider, found in zip(sliders, given, strict=True):
        slider["tracks"] = found
        slider["why"] = why
    return {
        "units": [_unit(checked, name, modules, places) for name in names],
        "order": [names.index(name) for name in checked.schedule.units],
        "initial": [_carried(link, names) for link in checked.schedule.initial.links],
        "start": begin,
        "stop": stop,
        "step": step,
        "steps": steps,
        "last": Grid(begin, stop, step, steps).last,
        "knobs": sliders,
        "causes": list(causes(values, sliders, steps * len(places) * LESS <= MOST_VALUES)),
        "margins": {"good": GOOD, "poor": POOR},
        "recorded": _recorded(results, summary, [".".join(port) for port in places]),
    }


def _unit(
    checked: Checked, name: str, modules: Mapping[str, str], places: Mapping[tuple[str, str], int]
) -> dict[str, Any]:
    description, fresh = checked.descriptions[name], checked.schedule.fresh
    links = [link for link in checked.links if link.stepped and link.end[0] == name]
    links.sort(key=lambda link: link.end not in fresh)
    outputs = _outputs(checked, name)
    starts = checked.starts.get(name, ())
    return {
        "name": name,
        "binary": modules[description.source],
        "token": description.guid,
        "start": {
            kind: [[_position(v) for v, _ in chosen], [float(value) for _, value in chosen]]
            for kind in ("Real", "Integer", "Boolean")
            if (chosen := [(v, value) for v, value in starts if v.kind == kind])
        },
        "parameters": {v.name: [_position(v), value] for v, value in _parameters(checked, name).items()},
        "outputs": [_position(v) for v in outputs],
        "names": [f"{name}.{v.name}" for v in outputs],
        "inputs": [_position(link.sink) for link in links],
        "sources": [places[link.start] for link in links],
        "fresh": sum(link.end in fresh for link in links),
        "conversions": [
            [k, link.conversion.factor, link.conversion.offset]
            for k, link in enumerate(links)
            if not link.conversion.trivial
        ],
    }


def _parameters(checked: Checked, name: str) -> dict[FmuVariable, float]:
    """Return the real parameters of a unit, with the values of the run."""
    given: dict[str, Value] = {v.name: value for v, value in checked.starts.get(name, ())}
    return {
        v: float(given.get(v.name, v.start)) for v in checked.descriptions[name].named("parameter") if v.type == "Real"
    }


def values_of(checked: Checked) -> dict[str, dict[str, float]]:
    """Return the real parameters of all units by their names."""
    return {name: {v.name: value for v, value in _parameters(checked, name).items()} for name in checked.descriptions}


def _carried(link: Link, names: Sequence[str]) -> list[float]:
    ends = (names.index(link.start[0]), _position(link.source), names.index(link.end[0]), _position(link.sink))
    return [*ends, link.conversion.factor, link.conversion.offset]


def knobs(checked: Checked) -> Iterator[dict[str, Any]]:
    """Yield groups of parameters that the page may change, ready for JSON, if one of a group is not zero."""
    models = {name: description.identifier for name, description in checked.descriptions.items()}
    joined = {(link.start[0], link.end[0]) for link in checked.links}
    groups: dict[str, dict[str, list[float]]] = {}
    for unit in models:
        for v, value in _parameters(checked, unit).items():
            groups.setdefault(unit, {}).setdefault(v.name.partition("[")[0], []).append(value)
    for knob in KNOBS:
        found = {
            unit: names
            for unit, own in groups.items()
            if models[unit] == (knob.model or models[unit])
            and (names := [name for name in knob.names if any(own.get(name, ()))])
        }
        for unit, names in found.items():
            knowing = [
                name
                for name, other in models.items()
                if knob.known and other == "Feedforward" and (len(found) == 1 or (unit, name) in joined)
            ]
            units = [v.unit for v in _parameters(checked, unit) if v.name.partition("[")[0] == names[0]]
            yield {
                "key": f"{unit}.{names[0]}",
                "words": knob.words if len(found) == 1 else f"{knob.words}, {unit}",
                "units": [measure.name if measure else "" for measure in units],
                "values": groups[unit][names[0]],
                "targets": [{"unit": unit, "name": name} for name in names],
                "known": [{"unit": other, "name": name} for other in knowing for name in names],
                "least": knob.least,
                "most": knob.most,
            }


def _recorded(results: Results, summary: Mapping[str, Any], names: Sequence[str]) -> dict[str, Any]:
    """Return some recorded rows, in double precision, and the criterion by which the page's own run is judged."""
    known = set(results.names)
    kept = [name for name in names if name in known]
    judged = [name for name in kept if name.startswith("plant.q[")] or kept
    rows = np.unique(np.linspace(0, len(results) - 1, ROWS + 1).round().astype(int))
    values = np.array([results[name][rows] for name in kept]).T
    separation = (summary.get("separation") or {}).get("max_position_difference_rad", 0.0)
    return {
        "rows": rows.tolist(),
        "names": kept,
        "values": packed(values, "<f8"),
        "judged": judged,
        "unit": ", ".join(dict.fromkeys(results.units[name] for name in judged)),
        "limit": max(LIMIT, _APART * separation),
        "note": _SEPARATES if separation else "",
        "doubt": "" if summary.get("reference") else _UNKNOWN,
    }
