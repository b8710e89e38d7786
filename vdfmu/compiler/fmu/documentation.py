"""documentation/index.html of an FMU: one page that needs no other files and no network."""

from __future__ import annotations

import inspect
from html import escape

from vdfmu.base.page import page, table
from vdfmu.compiler.fmu.content import Content, terms
from vdfmu.compiler.fmu.reference_results import columns
from vdfmu.compiler.unit.interface import Array, Interface
from vdfmu.compiler.unit.variable import Variable

_KIND = {"input": "input", "output": "output", "local": "derivative", "independent": "time"}
_HEADS = ("variable", "value reference", "kind", "unit", "start", "limits", "description")


def documentation_files(content: Content) -> dict[str, bytes]:
    """Return path in the FMU to content."""
    interface, fmi, native, robot = content.interface, content.fmi, content.backend == "native", content.robot
    exchange = native and interface.has_exchange
    needs = "nothing need be installed" if native else f"it runs in a Python that has vdfmu {content.version} installed"
    parts = [
        f"<p>FMI {content.fmi_version}, {'model exchange and ' if exchange else ''}co-simulation; {needs}. "
        f"Built by vdfmu {content.version} with {escape(content.tool)}, GUID <code>{content.guid}</code>.</p>",
        *_docstring(inspect.getdoc(content.unit) or ""),
    ]
    if robot is not None:
        kinds = ", ".join(robot.joint_types) if len(set(robot.joint_types)) > 1 else f"all {robot.joint_types[0]}"
        about = escape(f"{robot.name}. {robot.description.rstrip('.')}".rstrip(". "))
        parts.insert(0, f"<p>Robot: {about}. {robot.n} joints: {kinds}. Joints count from 1.</p>")
    for head, items in _texts(content, exchange).items():
        listed = "\n".join(f"<li>{text}</li>" for text, holds in items.items() if holds)
        parts += [f"<h2>{head}</h2>\n<ul>\n{listed}\n</ul>"] if listed else []
    end = interface.time + fmi.time_variable if native else len(interface)
    rows = [list(map(escape, _cells(content, array))) for array in interface.arrays if array.first < end]
    arrays = "A variable with a size is an array, row by row."
    scalars = "A row with several value references describes that many scalar variables."
    shown = table(_HEADS, rows, ("name", "ref", "", "", "", "", ""))
    parts.append(f'<h2>Interface</h2>\n<p>{arrays if fmi.arrays else scalars}</p>\n<div class="wide">{shown}</div>')
    return {"documentation/index.html": page(content.model_name, interface.description, "\n".join(parts), 62)}


def _texts(content: Content, exchange: bool) -> dict[str, dict[str, bool]]:
    """Return heading to sentences in HTML, each with whether it applies."""
    interface, fmi, native = content.interface, content.fmi, content.backend == "native"
    states, sampled, events = interface.has_states, interface.is_sampled, interface.events.stop > 0
    rate = ", or change at the rate that <code>fmi2SetRealInputDerivatives</code> sets"
    other = "" if interface.functions.shipped else " The C files common to all units belong to vdfmu (MIT)."
    return {"Use": {
        "Set parameters before the initialization ends; tunable ones and inputs can be set at any time. FMU states can "
        "be saved, restored and serialized.": True,
        f"Directional {'and adjoint ' if fmi.adjoints else ''}derivatives are exact, by inputs"
        f"{', states' if states else ''} and, during initialization, parameters.": native,
        f"Inputs are held over a communication step{rate if native and fmi.input_derivatives else ''}.": True,
        "Co-simulation: the solver is Rodas4 (implicit, order 4). <code>tolerance</code> bounds its local error, "
        "relative and absolute in SI units. A smaller tolerance of the experiment replaces it. The communication "
        "step can have any size.": states,
        "<code>solver</code> can fix the number of internal steps per communication step, for constant work whatever "
        "the error.": "solver" in interface.groups,
        "Model exchange: the equations may be stiff. Use an implicit solver (CVODE with BDF, Radau, Rodas) with a "
        "tolerance of 1e-6 or less.": exchange and states,
        "Sampled states change every <code>period</code> from the start time on. In co-simulation they do so at the "
        "start of a communication step with the inputs set for it, and within a longer step with the same inputs, so "
        "choose steps that divide the period. In model exchange they change in event mode, at times that the FMU "
        "announces.": sampled,
        "The unit has no state: its outputs after a communication step follow from its inputs and the end time."
        : not states and not sampled and not events,
        "Events: when one of the outputs " + _names(interface) + " rises above 0, states change. In co-simulation the "
        "solver locates the time to rounding and continues from there within the communication step. In model exchange "
        "these outputs are the event indicators, in this order.": events and states,
        "Events: when one of the outputs " + _names(interface) + " is above 0 at the end of a communication step and "
        "was not before, states change.": events and not states,
    }, "Limits": {
        "There are no event indicators: where equations jump with a state or an input, the solver takes small "
        "steps. Switching by time is located; in model exchange it is a time event.": states and not events,
        "Two changes of sign of an event's output within an eighth of an internal step may be missed. After 10,000 "
        "changes a communication step fails.": events and states,
        "If the solver cannot meet the tolerance, the error names the time and the state, and the state before the "
        "step is kept.": states,
        "Joint types, rotations of frames and some zeros of the robot are part of the code: the annotation "
        "<code>org.vdfmu.folded</code> of the model description lists them. All other numbers are parameters.":
        interface.has_robot,
        "Parameters that are unphysical together, such as static friction below Coulomb friction, are rejected at the "
        "initialization.": interface.has_robot,
        "Values that are not finite or outside their limits are rejected, and then no value changes.": True,
    }, "Files and licence": {
        "<code>sources/</code>: all C files. <code>unit.c</code> contains the tables and the program of this unit, "
        "<code>kernel_*.c</code> its equations. The others are the same for all units.": content.sources,
        "<code>extra/org.fmi-standard.fmi-ls-ref/</code>: reference results, see "
        '<a href="fmi-ls-ref.txt">fmi-ls-ref.txt</a>.': bool(columns(content, "output")),
        "<code>extra/vdfmu/vdfmu.json</code>: the robot, the start values and the versions that made the FMU.": True,
        f"{escape(terms(content.made_by))}{other} See "
        '<a href="licenses/license.txt">licenses/license.txt</a>.': True,
    } if native else {}}  # fmt: skip


def _names(interface: Interface) -> str:
    return ", ".join(f"<code>{v.name}</code>" for v in interface.memory[interface.events])


def _docstring(text: str) -> list[str]:
    """Return the HTML of a docstring without its first line: paragraphs, and indented blocks verbatim."""
    blocks = [block.strip("\n") for block in "\n".join(text.splitlines()[1:]).split("\n\n")]
    return [
        f"<pre>{escape(inspect.cleandoc(block))}</pre>" if block.startswith("    ")
        else f"<p>{escape(block.strip().replace('::', ':'))}</p>"
        for block in blocks if block.strip() not in ("", "::")
    ]  # fmt: skip


def _cells(content: Content, array: Array) -> tuple[str, ...]:
    members = content.interface.memory[array.positions]
    first, last = members[0], members[-1]
    name, reference = array.name, str(array.first)
    if content.fmi.arrays:
        name += f"  ({' × '.join(map(str, array.shape))})" if array.shape else ""
    elif len(members) > 1:
        name, reference = f"{first.name} .. {last.name}", f"{array.first} .. {array.first + array.size - 1}"
    kind = _KIND.get(first.causality, f"{first.variability} parameter")
    starts = [_start(v) for v in members]
    start = starts[0] if len(set(starts)) == 1 else ", ".join(starts)
    bounds = (f"{sign} {value:g}" for sign, value in (("≥", first.minimum), ("≤", first.maximum)) if value is not None)
    names = " or ".join(f"{i} ({choice})" for i, choice in enumerate(first.choices))
    described = content.interface.array_description(array)
    return name, reference, kind, first.unit or "", start, names or ", ".join(bounds), described


def _start(v: Variable) -> str:
    if v.start is None or v.type == "Boolean":
        return "" if v.start is None else str(v.start).lower()
    return f"{v.start:g}" if v.causality == "input" else f"{v.start:.9g}"
