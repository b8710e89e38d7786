"""documentation/index.html of an FMU: one page that needs no other file and no network."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from html import escape

from vdfmu.base.page import page, table
from vdfmu.compiler.fmu.content import Content, terms
from vdfmu.compiler.fmu.reference_results import columns
from vdfmu.compiler.unit.interface import Array, Interface
from vdfmu.compiler.unit.variable import Variable

_KIND = {"input": "input", "output": "output", "local": "derivative", "independent": "time"}


def documentation_files(content: Content) -> dict[str, bytes]:
    """Path in the FMU to content."""
    return {"documentation/index.html": _page(content)}


def _page(content: Content) -> bytes:
    interface = content.interface
    exchange = content.backend == "native" and interface.has_exchange
    interfaces = "model exchange and co-simulation" if exchange else "co-simulation"
    if content.backend == "native":
        needs = "Native code; nothing need be installed."
    else:
        needs = f"It runs in a Python that has vdfmu {content.version} installed."
    body = f"""{_robot(content)}<p>FMI {content.fmi_version}, {interfaces}. {needs}
Made by vdfmu {content.version} with {escape(content.tool)}, GUID <code>{content.guid}</code>.</p>
{_docstring(inspect.getdoc(content.unit) or "")}
<h2>Use</h2>
{_use(content)}
<h2>Limits</h2>
{_limits(content)}
<h2>Interface</h2>
{_interface(content)}
{_files(content)}"""
    return page(content.model_name, interface.description, body, 62)


def _docstring(text: str) -> str:
    """HTML of a docstring except for its first line: paragraphs, and indented blocks as they stand."""
    blocks: list[str] = []
    for block in "\n".join(text.splitlines()[1:]).split("\n\n"):
        block = block.strip("\n")
        if block.startswith("    "):
            blocks.append(f"<pre>{escape(inspect.cleandoc(block))}</pre>")
        elif block.strip() not in ("", "::"):
            blocks.append(f"<p>{escape(block.strip().replace('::', ':'))}</p>")
    return "\n".join(blocks)


def _robot(content: Content) -> str:
    robot = content.robot
    if robot is None:
        return ""
    about = f" {escape(robot.description.rstrip('.'))}." if robot.description else ""
    kinds = ", ".join(robot.joint_types) if len(set(robot.joint_types)) > 1 else f"all {robot.joint_types[0]}"
    return f"<p>Robot: {escape(robot.name)}.{about} {robot.n} joints: {kinds}. Joints count from 1.</p>\n"


def _files(content: Content) -> str:
    if content.backend != "native":
        return ""
    known = content.made_by or {}
    other = "" if content.interface.functions.shipped else " The C files that all units have are of vdfmu, MIT."
    sources = """
<li><code>sources/</code>: all C files. <code>unit.c</code> holds tables and program of this unit,
<code>kernel_*.c</code> its equations; the others are the same for all units.</li>"""
    reference = """
<li><code>extra/org.fmi-standard.fmi-ls-ref/</code>: reference results,
see <a href="fmi-ls-ref.txt">fmi-ls-ref.txt</a>.</li>"""
    return f"""<h2>Files</h2>
<ul>{sources if content.sources else ""}{reference if columns(content, "output") else ""}
<li><code>extra/vdfmu/vdfmu.json</code>: the robot, the start values and the versions that made the FMU.</li>
</ul>
<h2>Licence</h2>
<p>{escape(terms(known))}{other} See <a href="licenses/license.txt">licenses/license.txt</a>.</p>"""


def _use(content: Content) -> str:
    interface = content.interface
    known = "states and inputs" if interface.has_states else "inputs"
    lines = [
        "<p>Set parameters before the initialization ends; tunable ones and inputs at any time before the end. "
        "States of the FMU can be saved, restored and serialized.</p>"
    ]
    rate = ", or change at the rate that <code>fmi2SetRealInputDerivatives</code> sets"
    held = "Inputs are held over a communication step"
    if content.backend == "native":
        lines.append(
            "<p>Directional "
            + ("and adjoint derivatives" if content.fmi.adjoints else "derivatives")
            + f" are exact: with respect to {known}, during initialization also to parameters.</p>"
        )
        held += rate if content.fmi.input_derivatives else ""
    if interface.has_states:
        lines.append(
            "<p><b>Co-simulation.</b> The solver is Rodas4 (implicit, order 4) with error control; the parameter "
            "<code>tolerance</code> bounds the local error, relative and absolute in SI units. A smaller tolerance of "
            f"the experiment replaces it. Any communication step will do. {held}.</p>"
        )
        if "solver" in interface.groups:
            lines.append(
                "<p><code>solver</code> fixes the number of internal steps in each communication step, which then has "
                "the same work whatever the error.</p>"
            )
    if content.backend == "native" and interface.has_states:
        lines.append(
            "<p><b>Model exchange.</b> The equations may be stiff: use an implicit solver (CVODE with BDF, Radau, "
            "Rodas) with a tolerance of 1e-6 or less.</p>"
        )
    if interface.is_sampled:
        lines.append(
            "<p>Sampled states change every <code>period</code> from the start time on: in co-simulation at the start "
            "of a communication step, by the inputs set for it, so their values of that time are read after it; inside "
            "a longer step, by the same inputs: choose steps of which the period is a whole multiple. In model "
            "exchange they change in event mode, at the times that the FMU names.</p>"
        )
    elif not interface.has_states:
        lines.append(
            "<p>The unit has no state: its outputs after a communication step are those of its inputs and of the end "
            f"of the step. {held}.</p>"
        )
    return "\n".join(lines)


def _limits(content: Content) -> str:
    interface = content.interface
    items: list[str] = []
    if interface.has_states:
        items += [
            "There are no event indicators: equations that jump with a state or an input are solved with small steps "
            "where they do. Switching by time is located; in model exchange it is a time event.",
            "The solver that cannot meet the tolerance returns an error that names time and state; the state is that "
            "before the step.",
        ]
    if interface.has_robot:
        items += [
            "Numbers of the robot that are zero, its joint types and the rotations of its frames are part of the code; "
            "all others are parameters.",
            "Parameters that are not physical together, such as static below Coulomb friction, are refused at the "
            "initialization with a message.",
        ]
    items += ["Values that are not finite or out of their limits are refused; nothing is changed then."]
    return "<ul>\n" + "\n".join(f"<li>{item}</li>" for item in items) + "\n</ul>"


def _interface(content: Content) -> str:
    interface = content.interface
    end = len(interface) if content.backend == "python" else interface.time + content.fmi.time_variable
    arrays = [a for a in interface.arrays if a.first < end]
    rows = [[escape(cell) for cell in _cells(content, interface, array)] for array in arrays]
    heads = ("variable", "value reference", "kind", "unit", "start", "limits", "description")
    explanation = (
        "A variable with a size is an array, row by row."
        if content.fmi.arrays
        else "A row with several value references stands for as many scalar variables."
    )
    classes = ("name", "ref", "", "", "", "", "")
    return f'<p>{explanation}</p>\n<div class="wide">{table(heads, rows, classes)}</div>'


def _cells(content: Content, interface: Interface, array: Array) -> tuple[str, ...]:
    members: Sequence[Variable] = interface.memory[array.positions]
    first, last = members[0], members[-1]
    name, reference = array.name, str(array.first)
    if content.fmi.arrays:
        name += f"  ({' × '.join(map(str, array.shape))})" if array.shape else ""
    elif len(members) > 1:
        name, reference = f"{first.name} .. {last.name}", f"{array.first} .. {array.first + array.size - 1}"
    kind = _KIND.get(first.causality, f"{first.variability} parameter")
    starts = list(dict.fromkeys(_value(v) for v in members))
    start = starts[0] if len(starts) == 1 else ", ".join(_value(v) for v in members)
    description = interface.array_description(array)
    return name, reference, kind, first.unit or "", start, _bounds(first), description


def _value(v: Variable) -> str:
    if v.start is None or v.causality == "input":
        return "" if v.start is None else f"{v.start:g}"
    if v.type == "Boolean":
        return str(bool(v.start)).lower()
    return f"{v.start:.9g}"


def _bounds(v: Variable) -> str:
    if v.choices:
        return " or ".join(f"{i} ({choice})" for i, choice in enumerate(v.choices))
    low = "" if v.minimum is None else f"≥ {v.minimum:g}"
    high = "" if v.maximum is None else f"≤ {v.maximum:g}"
    return ", ".join(filter(None, (low, high)))
