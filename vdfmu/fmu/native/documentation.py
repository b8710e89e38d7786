"""documentation/index.html of a native FMU: one page that needs no other file and no network."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from vdfmu.fmu.content import Content
from vdfmu.fmu.layout import Array, Layout
from vdfmu.fmu.native.equations_html import EQUATIONS
from vdfmu.fmu.table import Variable

__all__ = ["documentation_files"]

_KIND = {
    "input": "input",
    "output": "output",
    "local": "derivative",
    "independent": "time",
}

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1f2328; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
h1 { margin-bottom: 0; } h2 { margin-top: 2.2rem; border-bottom: 1px solid #d0d7de; }
p.what { margin-top: .3rem; color: #57606a; }
table { border-collapse: collapse; font-size: 14px; margin: 1rem 0; }
th, td { text-align: left; vertical-align: top; padding: .2rem .7rem .2rem 0; border-bottom: 1px solid #eaeef2; }
td.name, td.ref { font-family: ui-monospace, monospace; white-space: nowrap; }
table.equations td { border: 0; padding: .25rem 1.5rem .25rem 0; }
table.equations td:first-child { font-family: "Latin Modern Math", "Cambria Math", Georgia, serif; font-size: 17px; }
table.equations td:last-child { color: #57606a; }
code { background: #f3f4f6; padding: 0 .25em; border-radius: 3px; }
.wide { overflow-x: auto; }
"""


def documentation_files(content: Content, layout: Layout) -> dict[str, bytes]:
    """Path in the FMU to content."""
    return {"documentation/index.html": _page(content, layout).encode()}


def _page(content: Content, layout: Layout) -> str:
    table = layout.table
    name, robot = content.model_name, table.robot
    about = f" {escape(robot.description.rstrip('.'))}." if robot.description else ""
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<title>{name}</title>
<style>{_STYLE}</style>
</head>
<body>
<h1>{name}</h1>
<p class="what">{escape(table.description)}</p>
<p>Robot: {escape(robot.name)}.{about} {_joints(content)}</p>
<p>FMI {content.fmi_version}, {_interfaces(layout)}. Native code; nothing need be installed.
Made by vdfmu {content.version} with {escape(content.tool)}, GUID <code>{content.guid}</code>.</p>
<h2>Equations</h2>
{EQUATIONS[table.unit]}
<h2>Use</h2>
{_use(content, layout)}
<h2>Limits</h2>
{_limits(layout)}
<h2>Interface</h2>
{_interface(content, layout)}
<h2>Files</h2>
<ul>
<li><code>sources/</code>: all C files. <code>unit.c</code> holds tables and program of this unit,
<code>kernel_*.c</code> its equations; the others are the same for all units.</li>
<li><code>extra/org.fmi-standard.fmi-ls-ref/</code>: reference results,
see <a href="fmi-ls-ref.txt">fmi-ls-ref.txt</a>.</li>
<li><code>extra/vdfmu/vdfmu.json</code>: the robot, the start values and the versions that made the FMU.</li>
</ul>
<h2>Licence</h2>
<p>MIT, see <a href="licenses/license.txt">licenses/license.txt</a>.</p>
</body>
</html>
"""


def _joints(content: Content) -> str:
    robot = content.robot
    kinds = ", ".join(robot.joint_types) if len(set(robot.joint_types)) > 1 else f"all {robot.joint_types[0]}"
    return f"{robot.n} joints: {kinds}. Joints count from 1."


def _interfaces(layout: Layout) -> str:
    return "model exchange and co-simulation" if layout.states.stop > layout.states.start else "co-simulation"


def _use(content: Content, layout: Layout) -> str:
    state = "states and inputs" if layout.states.stop > layout.states.start else "inputs"
    lines = [
        "<p>Set parameters before the initialization ends; tunable ones and inputs at any time before the end.</p>",
        "<p>States of the FMU can be saved, restored and serialized. Directional "
        + ("and adjoint derivatives" if content.fmi_version == "3.0" else "derivatives")
        + f" are exact: with respect to {state}, during initialization also to parameters.</p>",
    ]
    rate = ", or change at the rate that <code>fmi2SetRealInputDerivatives</code> sets"
    held = f"Inputs are held over a communication step{rate if content.fmi_version == '2.0' else ''}."
    if layout.states.stop > layout.states.start:
        lines += [
            f"<p><b>Co-simulation.</b> The solver is Rodas4 (implicit, order 4) with error control; the parameter "
            "<code>tolerance</code> bounds the local error, relative and absolute in SI units. A smaller tolerance of "
            f"the experiment replaces it. Any communication step will do; 1 ms suits a sampled controller. {held}</p>",
            "<p><b>Model exchange.</b> The equations are stiff: use an implicit solver (CVODE with BDF, Radau, Rodas) "
            "with a tolerance of 1e-6 or less.</p>",
        ]
    elif layout.table.unit == "trajectory":
        lines += ["<p>The outputs are those of the end of a communication step. Any step will do.</p>"]
    else:
        lines += [
            f"<p>The unit has no state: its outputs after a communication step are those of its inputs. {held} "
            "1 ms is a usual step.</p>"
        ]
    return "\n".join(lines)


def _limits(layout: Layout) -> str:
    items: list[str] = []
    if layout.states.stop > layout.states.start:
        items += [
            "<li>There are no event indicators and no events: friction is regularised by tanh(v/ε), so the equations "
            "are smooth. Sticking is a creep slower than ε.</li>",
            "<li>The solver that cannot meet the tolerance returns an error that names time and state; the state is "
            "that before the step.</li>",
            "<li>Joints have no stops, motors no limit of their own.</li>",
        ]
    if layout.table.unit == "trajectory":
        items += ["<li>The third derivative jumps at both ends of the motion.</li>"]
    if layout.table.has_robot:
        items += [
            "<li>Numbers of the robot that are zero, its joint types and the rotations of its frames are part of the "
            "code; all others are parameters.</li>",
            "<li>Parameters that are not physical together, such as static below Coulomb friction, are refused at the "
            "initialization with a message.</li>",
        ]
    items += [
        "<li>Values that are not finite or out of their limits are refused; nothing is changed then.</li>"
    ]
    return f"<ul>\n{chr(10).join(items)}\n</ul>"


def _interface(content: Content, layout: Layout) -> str:
    arrays = [a for a in layout.arrays if content.fmi_version == "3.0" or a.first != layout.time]
    rows = "\n".join(_row(content, layout, array) for array in arrays)
    heads = ("variable", "value reference", "kind", "unit", "start", "limits", "description")
    head = "".join(f"<th>{text}</th>" for text in heads)
    words = (
        "A variable with a size is an array, row by row."
        if content.fmi_version == "3.0"
        else "A row with several value references stands for as many scalar variables."
    )
    return f'<p>{words}</p>\n<div class="wide"><table>\n<tr>{head}</tr>\n{rows}\n</table></div>'


def _row(content: Content, layout: Layout, array: Array) -> str:
    members: Sequence[Variable] = layout.variables[array.positions]
    first, last = members[0], members[-1]
    name, reference = array.name, str(array.first)
    if content.fmi_version == "3.0":
        name += f"  ({' × '.join(map(str, array.shape))})" if array.shape else ""
    elif len(members) > 1:
        name, reference = f"{first.name} .. {last.name}", f"{array.first} .. {array.first + array.size - 1}"
    kind = _KIND.get(first.causality, f"{first.variability} parameter")
    starts = list(dict.fromkeys(_value(v) for v in members))
    start = starts[0] if len(starts) == 1 else ", ".join(_value(v) for v in members)
    cells = (
        ("name", name), ("ref", reference), ("", kind), ("", first.unit or ""), ("", start), ("", _bounds(first)),
        ("", layout.description(array)),
    )  # fmt: skip
    return (
        "<tr>"
        + "".join(
            f'<td class="{style}">{escape(text)}</td>' if style else f"<td>{escape(text)}</td>"
            for style, text in cells
        )
        + "</tr>"
    )


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
