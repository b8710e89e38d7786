"""Reference pages made from the code: the command line, the file of a scenario, and the rules of the check."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.cli.commands import app
from vdfmu.cli.options import TASKS
from vdfmu.engine.rules import RULES
from vdfmu.extras.schemas import scenario_schema


def command_line_page() -> str:
    """Return the reference of all commands and options, in markdown."""
    return "\n".join([_COMMANDS_HEAD, *_command("vdfmu", app), ""])


def _command(name: str, command: Any) -> Iterator[str]:
    inner: Mapping[str, Any] = getattr(command, "commands", {})
    if name != "vdfmu":
        yield f"\n{'#' * min(len(name.split()), 3)} {name}\n"
        yield _plain(command.help or "")
        if command.example:
            yield f"\n```sh\n{command.example}\n```"
    arguments = [p for p in command.params if p.param_type_name == "argument"]
    common = {"--help"} if name == "vdfmu" else {"--help", "--quiet", "--verbose"}
    options = [p for p in command.params if p.param_type_name == "option" and not common & {*p.opts}]
    for kind, parameters in (("argument", arguments), ("option", options)):
        if parameters:
            yield f"\n| {kind} | default | what it is |\n| --- | --- | --- |"
            for parameter in parameters:
                group = getattr(parameter, "group", "")
                role = f"{group}: " if group and group not in TASKS else ""
                text = _plain(f"{role}{parameter.help} {_ROLE.sub('', getattr(parameter, 'more', ''))}")
                yield f"| {_names(parameter)} | {_default(parameter)} | {text} |"
    for word, below in inner.items():
        yield from _command(f"{name} {word}", below)


def _names(parameter: Any) -> str:
    if parameter.param_type_name == "argument":
        return f"`{(parameter.metavar or parameter.name.upper()).strip('[].')}`"
    names = ", ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts))
    return names + (f" `{parameter.metavar}`" if parameter.metavar else "")


def _default(parameter: Any) -> str:
    value = parameter.default
    return f"`{value}`" if isinstance(value, (str, int, float, Path)) and value not in (False, "") else ""


def _plain(text: str) -> str:
    """Return a text for a cell of a table."""
    return (
        " ".join(text.split())
        .replace("|", r"\|")
        .replace("<", "&lt;")
        .replace("*", r"\*")
        .replace("[", r"\[")
        .replace("{", "&#123;")  # a frame at the end of a cell is no attribute of it
    )


def scenario_file_page() -> str:
    """Return the reference of a scenario file, in markdown."""
    schema = scenario_schema()
    keys: Mapping[str, Any] = schema["properties"]
    tables = {key: value for key, value in keys.items() if value.get("properties")}
    for part, table in tables.items():
        if part != "payload":
            table["properties"] = {k: v for k, v in table["properties"].items() if k not in PARAMETERS}
    top = {key: value for key, value in keys.items() if key not in tables}
    del tables["plant_factors"]
    lines = [_SCENARIO_HEAD, "## Top of the file", *_keys(top, schema["required"])]
    for name, table in tables.items():
        lines += [f"\n## [{name}]", *_keys(table["properties"], table["required"])]
    return "\n".join([*lines, ""])


def _keys(keys: Mapping[str, Any], required: list[str]) -> list[str]:
    lines = ["", "| key | value | what it is |", "| --- | --- | --- |"]
    for key, schema in keys.items():
        must = ", needed" if key in required else ""
        lines.append(f"| `{key}` | {_value(schema)}{must} | {_plain(schema.get('description', ''))} |")
    return lines


def _value(schema: Mapping[str, Any]) -> str:
    if "anyOf" in schema:
        kinds = " or ".join(dict.fromkeys(_value(each) for each in schema["anyOf"]))
        single, _, many = kinds.partition(" or list: ")
        return f"{single} or list" if single == many else kinds
    if "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema["enum"])
    kind = schema.get("type", "")
    if kind == "array":
        inner = _value(schema["items"])
        return {"number": "list", "list": "matrix"}.get(inner, f"list: {inner}")
    bounds = [
        f"{sign} {schema[key]:g}"
        for key, sign in (
            ("minimum", "≥"), ("exclusiveMinimum", ">"), ("maximum", "≤"), ("exclusiveMaximum", "<"),
        )
        if key in schema and abs(schema[key]) < _HUGE
    ]  # fmt: skip
    words = {"string": "text", "boolean": "true or false", "object": "table", "": "number or list"}
    return " ".join([words.get(kind, kind), *([", ".join(bounds)] if bounds else [])])


def rules_page() -> str:
    """Return the list of rules, in markdown."""
    rows = [f"| {rule.number} | {rule.severity} | {rule.title} | {rule.way} |" for rule in RULES.values()]
    return "\n".join([_RULES_HEAD, *rows, ""])


_ROLE = re.compile(r":[a-z]+:|(?<=`)`|`(?=`)")
"""Marks of docstrings: roles, and doubled quotes."""
_HUGE = 1e4
"""Bound from which it is there for broken files only."""
_COMMANDS_HEAD = """---
hide: [toc]
---

# Command line

This page lists every command and option. It is generated from the commands, so `vdfmu COMMAND --help` prints the same.
`vdfmu --completion bash >> ~/.bashrc` lets the shell complete commands and options.

| exit code | meaning |
| --- | --- |
| 0 | done |
| 1 | a check or a unit failed; `judge`: not right |
| 2 | wrong usage or input |
| 3 | `judge`: not decided |
| 130, 143, 129 | Ctrl-C, SIGTERM, SIGHUP |

Every command takes `--quiet` and `--verbose`, before or after its name. Results go to standard output, everything else
to standard error.

| option | standard output | standard error |
| --- | --- | --- |
| none | verdict, tables, files written | notes, warnings, errors, bars |
| `--quiet`, `-q` | a line `Written to` | errors |
| `--verbose`, `-v` | also the tables of a run | also stages, times, places of errors |

With `--quiet`, `run`, `sweep` and `tune` print only that line; `sweep` also lists its failed points. Progress bars
appear only on a terminal. They are ASCII if the terminal has no UTF-8, and have no colours if `NO_COLOR` is set.
"""

_SCENARIO_HEAD = """---
hide: [toc]
---

# Scenario file

Every key of a scenario file, generated from its schema, `vdfmu check --schema scenario`. A scenario is one TOML file
with the robot, system, values, duration and master of a run. [Arms and scenarios](../scenarios.md) lists the shipped
ones. A scenario
also has a table for each component of its system, with the component's parameters. One value applies to all joints.
Units are SI, angles in rad.

The table of a component that uses the robot can also have any of [its parameters](robot_file.md), such as `mass`. The
feedforward does not model values that are only in `[plant]`. `[plant_factors]` multiplies parameters of the plant
only, by one factor, `mass = 1.02`, or by a list for the joints. `[paper]` has the paper's values, from joint 1 on,
which are printed next to the results.
"""

_RULES_HEAD = """# Rules of the check

[`vdfmu check`](../checking.md) checks files by these rules, and readers and masters reject files by the same rules.
Each line of the check ends with the number of its rule. `PKG` are rules of zip files and XML, `SSP` of systems, `FMI`
of FMUs, `RUN` of runs, and `SRC` of robots, scenarios, systems and units. A note is not an error.

| rule | severity | requirement | fix |
| --- | --- | --- | --- |"""
