"""documentation/index.html of a system package: one page that needs no other file and no network."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

from vdfmu import __version__
from vdfmu.ssp.description import Signal, SystemDescription
from vdfmu.ssp.drawing import draw_system
from vdfmu.ssp.xml import value_text

__all__ = ["system_page"]

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1f2328; max-width: 76rem; margin: 2rem auto; padding: 0 1rem; }
h1 { margin-bottom: 0; } h2 { margin-top: 2.2rem; border-bottom: 1px solid #d0d7de; }
p.what { margin-top: .3rem; color: #57606a; }
table { border-collapse: collapse; font-size: 14px; margin: 1rem 0; }
th, td { text-align: left; vertical-align: top; padding: .2rem .9rem .2rem 0; border-bottom: 1px solid #eaeef2; }
td.name { font-family: ui-monospace, monospace; white-space: nowrap; }
td.value { font-family: ui-monospace, monospace; }
code, pre { background: #f3f4f6; border-radius: 3px; } code { padding: 0 .25em; } pre { padding: .6rem .8rem; }
summary { cursor: pointer; font-weight: 600; margin: .4rem 0; }
.wide { overflow-x: auto; }
"""


def system_page(
    description: SystemDescription, ssd: Any, icons: Mapping[str, bytes], fmi_version: str
) -> bytes:
    """Page of a package, made from what its other files are made from.

    Parameters
    ----------
    description : SystemDescription
    ssd : element
        Root of the SSD, for the diagram.
    icons : mapping of str to bytes
        Source of an icon to its SVG file.
    fmi_version : str
        Of the FMUs in the package.
    """
    scenario = description.scenario
    name = ssd.get("name")
    page = f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<title>{escape(name)}</title>
<style>{_STYLE}</style>
</head>
<body>
<h1>{escape(name)}</h1>
<p class="what">{escape(description.description)}</p>
<p>Scenario {escape(scenario.name)}: {escape(scenario.description)}. Robot {escape(scenario.robot.name)}:
{escape(scenario.robot.description.rstrip("."))}. SSP {description.version}, FMI {fmi_version}.</p>
<h2>Diagram</h2>
<div class="wide">
{draw_system(ssd, icons)}
</div>
<p>Filled connectors are connected; open ones are free: outputs to record, and the external wrench
<code>F_e</code>, which has the value of the parameter set. Lines of one group run together.</p>
<h2>Components</h2>
{_components(description)}
<h2>Run</h2>
{_run(description)}
<h2>Connections</h2>
{_connections(description)}
<h2>Parameters</h2>
{_parameters(description)}
<h2>Connectors</h2>
{_connectors(description)}
<h2>Licence and origin</h2>
<p>MIT. Made by vdfmu {__version__} from the same description as the other files of this package.</p>
</body>
</html>
"""
    return page.encode()


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], classes: Sequence[str]) -> str:
    lines = ["<table>", "<tr>" + "".join(f"<th>{head}</th>" for head in heads) + "</tr>"]
    for row in rows:
        cells = zip(row, classes, strict=True)
        lines.append(
            "<tr>"
            + "".join(
                f'<td class="{kind}">{cell}</td>' if kind else f"<td>{cell}</td>" for cell, kind in cells
            )
            + "</tr>"
        )
    return "\n".join([*lines, "</table>"])


def _components(description: SystemDescription) -> str:
    rows = [
        (
            unit,
            f"resources/{description.fmu_name(unit)}",
            escape(table.description),
            "<br>".join(_binding(b.file, b.mapping) for b in description.bindings[unit]),
        )
        for unit, table in description.tables.items()
    ]
    return _table(("component", "FMU", "", "parameter sets"), rows, ("name", "name", "", ""))


def _binding(file: str, mapping: Sequence[tuple[str, str]]) -> str:
    pairs = {(a.split("[")[0], b.split("[")[0]) for a, b in mapping}
    renamed = "".join(f", {escape(a)} as {escape(b)}" for a, b in sorted(pairs))
    return f"<code>{file}</code>{renamed}"


def _run(description: SystemDescription) -> str:
    scenario = description.scenario
    step, stop = f"{description.step:g}", f"{scenario.stop:g}"
    text = f"""<p>From 0 to {stop} s with a communication step of {step} s. The numbers of the scenario are for the
<code>{scenario.master}</code> algorithm; solver tolerance of the plant {description.tolerance:g}. The annotations
of the default experiment say the same.</p>
<p>Values apply in the order of the bindings of a component. An importer that applies one set of a component applies
<code>scenario</code>; the rest are start values of the FMUs in this package, if it was made by
<code>vdfmu ssp</code>.</p>"""
    if description.version == "1.0":
        text += """
<pre>vdfmu simulate system.ssp</pre>
<p>or in Python</p>
<pre>import vdfmu
results = vdfmu.simulate("system.ssp")
print(results["plant.q[1]"][-1])</pre>"""
    return text


def _connections(description: SystemDescription) -> str:
    counts: dict[tuple[str, str], list[Any]] = {}
    for link in description.links:
        key = (f"{link.start[0]}.{link.start[1].group}", f"{link.end[0]}.{link.end[1].group}")
        counts.setdefault(key, []).append(link)
    rows = [
        (
            a,
            b,
            str(
                sum(1 if x.start_index or not x.start[1].shape else len(x.start[1].variables) for x in links)
            ),
            _units(x.start[1] for x in links),
        )
        for (a, b), links in counts.items()
    ]
    return _table(("from", "to", "signals", "unit"), rows, ("name", "name", "", ""))


def _units(signals: Iterable[Signal]) -> str:
    return escape(", ".join(sorted({s.unit or "" for s in signals})))


def _parameters(description: SystemDescription) -> str:
    takers: dict[str, list[str]] = {}
    for unit, bindings in description.bindings.items():
        for binding in bindings:
            takers.setdefault(binding.file, []).append(unit)
    parts: list[str] = []
    for file, parameters in description.parameter_sets.items():
        rows = [
            (
                escape(signal.name),
                " ".join(value_text(signal.type, value) for value in values),
                escape(signal.unit or ""),
                escape(signal.description) + _choice(signal, values),
            )
            for signal, values in parameters.entries
        ]
        table = _table(("parameter", "value", "unit", ""), rows, ("name", "value", "", ""))
        head = f"{file}: set {parameters.name}, for {', '.join(takers[file])}"
        parts.append(f"<details><summary>{head}</summary>\n{table}\n</details>")
    return "\n".join(parts)


def _choice(signal: Signal, values: Sequence[Any]) -> str:
    choices = signal.variables[0].choices
    return f" ({escape(choices[int(values[0])])})" if choices else ""


def _connectors(description: SystemDescription) -> str:
    parts: list[str] = []
    for unit in description.tables:
        rows = [
            (escape(s.name), kind, _type(s), escape(s.unit or ""), escape(s.description))
            for kind in ("input", "output")
            for s in description.signals(unit, kind)
        ]
        table = _table(("connector", "kind", "type", "unit", ""), rows, ("name", "", "", "", ""))
        parts.append(f"<details><summary>{unit}</summary>\n{table}\n</details>")
    return "\n".join(parts)


def _type(signal: Signal) -> str:
    return signal.type + (f" [{', '.join(map(str, signal.shape))}]" if signal.shape else "")
