"""documentation/index.html of a system package: one page that needs no other file and no network."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

from vdfmu.base.page import page, table
from vdfmu.base.version import __version__
from vdfmu.system.package.description import PackageSignal, SystemDescription
from vdfmu.system.package.drawing import draw_system
from vdfmu.system.package.structure_file import value_text


def system_page(description: SystemDescription, icons: Mapping[str, bytes], fmi_versions: Sequence[str]) -> bytes:
    """Page of a package, made from what its other files are made from, and the icons by their sources."""
    scenario = description.scenario
    about = [f"Scenario {scenario.name}: {scenario.description.rstrip('.')}."]
    if scenario.robot is not None:
        about.append(f"Robot {scenario.robot.name}:\n{scenario.robot.description.rstrip('.')}.")
    body = f"""<p>{escape(" ".join(about))} SSP {description.version}, FMI {" and ".join(fmi_versions)}.</p>
<h2>Diagram</h2>
<div class="wide">
{draw_system(description, icons)}
</div>
<p>A wire is an array, with its size, or a scalar. Free are outputs to record, and inputs, which have the values of the
parameter sets.</p>
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
<h2>Origin</h2>
<p>Made by vdfmu {__version__} from the same description as the other files of this package.</p>"""
    return page(description.full_name, description.description, body, 76)


def _components(description: SystemDescription) -> str:
    rows = [
        (
            component,
            f"resources/{description.fmu_name(component)}",
            escape(table.description),
            "<br>".join(_binding(b.file, b.mapping) for b in description.bindings[component]),
        )
        for component, table in description.tables.items()
    ]
    return table(("component", "FMU", "", "parameter sets"), rows, ("name", "name", "", ""))


def _binding(file: str, mapping: Sequence[tuple[str, str]]) -> str:
    pairs = {(a.split("[")[0], b.split("[")[0]) for a, b in mapping}
    renamed = "".join(f", {escape(a)} as {escape(b)}" for a, b in sorted(pairs))
    return f"<code>{file}</code>{renamed}"


def _run(description: SystemDescription) -> str:
    scenario = description.scenario
    step, stop = f"{scenario.step:g}", f"{scenario.stop:g}"
    text = f"""<p>From 0 to {stop} s with a communication step of {step} s. The numbers of the scenario are for the
<code>{scenario.master}</code> algorithm; solver tolerance {description.tolerance:g}. The annotations
of the default experiment say the same.</p>
<p>Values apply in the order of the bindings of a component. An importer that applies one set of a component applies
<code>scenario</code>; the rest are start values of the FMUs in this package, if it was made by
<code>vdfmu ssp</code>.</p>"""
    if not description.arrays:
        outputs = [f"{name}.{s.name}" for name in description.tables for s in description.signals(name, "output")]
        shown = next((name for name in ("plant.q[1]", *outputs) if name in outputs), "time")
        text += f"""
<pre>vdfmu simulate system.ssp</pre>
<p>or in Python</p>
<pre>import vdfmu
results = vdfmu.simulate("system.ssp")
print(results["{escape(shown)}"][-1])</pre>"""
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
            str(sum(1 if x.start_index or not x.start[1].shape else len(x.start[1].variables) for x in links)),
            _units(x.start[1] for x in links),
        )
        for (a, b), links in counts.items()
    ]
    return table(("from", "to", "signals", "unit"), rows, ("name", "name", "", ""))


def _units(signals: Iterable[PackageSignal]) -> str:
    return escape(", ".join(sorted({s.unit or "" for s in signals})))


def _parameters(description: SystemDescription) -> str:
    takers: dict[str, list[str]] = {}
    for component, bindings in description.bindings.items():
        for binding in bindings:
            takers.setdefault(binding.file, []).append(component)
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
        listed = table(("parameter", "value", "unit", ""), rows, ("name", "value", "", ""))
        head = f"{file}: set {parameters.name}, for {', '.join(takers[file])}"
        parts.append(f"<details><summary>{head}</summary>\n{listed}\n</details>")
    return "\n".join(parts)


def _choice(signal: PackageSignal, values: Sequence[Any]) -> str:
    choices = signal.variables[0].choices
    return f" ({escape(choices[int(values[0])])})" if choices else ""


def _connectors(description: SystemDescription) -> str:
    parts: list[str] = []
    for component in description.tables:
        rows = [
            (escape(s.name), kind, _type(s), escape(s.unit or ""), escape(s.description))
            for kind in ("input", "output")
            for s in description.signals(component, kind)
        ]
        listed = table(("connector", "kind", "type", "unit", ""), rows, ("name", "", "", "", ""))
        parts.append(f"<details><summary>{component}</summary>\n{listed}\n</details>")
    return "\n".join(parts)


def _type(signal: PackageSignal) -> str:
    return signal.type + (f" [{', '.join(map(str, signal.shape))}]" if signal.shape else "")
