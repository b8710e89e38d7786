"""All that is public, a line each, made from the code; ``python -m tests.promise --write`` records it.

`docs/promise.md` says what each part promises. The record is ``promise.txt`` beside this file: a test holds the code
against it, so that nothing public changes unseen. A change is recorded once the changelog names it. What each release
promised is in ``earlier``, and a test holds the changelog since then against it.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import typer.main

import vdfmu
import vdfmu.motion
import vdfmu.plugin
import vdfmu.unit
from vdfmu import cli
from vdfmu.arm.robot import robot_names
from vdfmu.arm.units import PLUGINS as UNITS
from vdfmu.arm.units import package_units
from vdfmu.base.toml_file import ROBOTS
from vdfmu.cli.commands import app
from vdfmu.compiler.unit.declaration import JOINTS, Declared
from vdfmu.engine import algorithms
from vdfmu.engine.algorithms import ALGORITHMS
from vdfmu.engine.results import formats
from vdfmu.engine.results.formats import FORMATS
from vdfmu.study.identify import log_files
from vdfmu.study.report.summary_keys import KEYS, Keyed, List, Record
from vdfmu.study.run.scenario_run import RUN_OUTPUTS
from vdfmu.system.scenario import scenario_names
from vdfmu.system.scenario.schema import robot_schema, scenario_schema, system_schema

RECORD = Path(__file__).with_suffix(".txt")
_GROUPS = (UNITS, ROBOTS, algorithms.PLUGINS, formats.PLUGINS, log_files.PLUGINS)
PLUGINS = [f"vdfmu.{each.group}: {each.expected}" for each in _GROUPS]
CHANGELOG = RECORD.parents[1] / "CHANGELOG.md"
EARLIER = RECORD.parent / "earlier"
WAY_OUT = """What is public changed. If that is meant: name in CHANGELOG.md what went, came or changed, then
record it by 'python -m tests.promise --write' (docs/promise.md says how long the old form has to work)."""


def promised() -> list[str]:
    """Return all that is public, sorted within each part."""
    parts = {
        "Python": _python(),
        "commands": _commands("vdfmu", typer.main.get_command(app)),
        "exit codes": _exit_codes(),
        "files of a run": RUN_OUTPUTS,
        "keys of summary.json": _summary(),
        "keys of robot files": _keys(robot_schema()),
        "keys of scenario files": _scenario(),
        "keys of system files": _keys(system_schema()),
        "variables of units, and columns of results": _variables(),
        "robots": robot_names(),
        "scenarios": scenario_names(),
        "master algorithms": ALGORITHMS,
        "formats of results": FORMATS,
        "entry points": PLUGINS,
    }
    return [line for name, lines in parts.items() for line in (f"# {name}", *sorted({*lines}), "")]


def changes(record: Path | None = None) -> tuple[list[str], list[str]]:
    """Return the lines that went, and those that came, each with its part, since they were recorded."""
    recorded = (record or RECORD).read_text(encoding="utf-8").splitlines()
    now, before = (list(_with_parts(each)) for each in (promised(), recorded))
    return [line for line in before if line not in now], [line for line in now if line not in before]


def sections(changelog: str) -> dict[str, str]:
    """Return the text of each version of a changelog by its heading, the newest first."""
    found = re.split(r"^## (.*)$", changelog, flags=re.MULTILINE)[1:]
    return dict(zip(found[::2], found[1::2], strict=True))


def not_named(lines: Iterable[str], changelog: str) -> list[str]:
    """Return the lines whose name no piece of code of a changelog has, ``--seed`` or ``vdfmu tune --seed``."""
    code = " ".join(re.findall(r"`([^`]+)`", changelog))
    return [line for line in lines if not re.search(rf"(?<![\w-]){re.escape(name_of(line))}(?![\w-])", code)]


def name_of(line: str) -> str:
    """Return what a line is about, ``--seed`` of ``commands: vdfmu sweep run --seed int = 0``; of a path its end."""
    part, _, text = line.partition(": ")
    if part in ("files of a run", "entry points", "exit codes"):
        return text.partition(": ")[0].partition(" ")[0]
    words = re.split("->|[:=]", re.sub(r"\[.*?\]", "", text))[0].split()
    option = next((word.rstrip(",") for word in words if word.startswith("-")), "")
    last = words[-1] if part in ("Python", "commands") else words[0]
    return option or last.removesuffix("()").rpartition(".")[2].strip("*")


def _with_parts(lines: Iterable[str]) -> Iterator[str]:
    part = ""
    for line in lines:
        part = line if line.startswith("# ") else part
        yield line if line in ("", part) else f"{part[2:]}: {line}"


def _python() -> Iterator[str]:
    for module in (vdfmu, vdfmu.motion, vdfmu.unit, vdfmu.plugin):
        for name in module.__all__:
            yield from _member(f"{module.__name__}.{name}", getattr(module, name))


def _member(name: str, value: Any) -> Iterator[str]:
    if not callable(value):
        yield name
        return
    yield from _signature(name, value)
    for inner in vars(value) if isinstance(value, type) else ():
        if not inner.startswith("_"):
            member = inspect.getattr_static(value, inner)
            member = getattr(member, "__func__", member)  # of class methods
            yield from _signature(f"{name}.{inner}", member) if inspect.isfunction(member) else [f"{name}.{inner}"]


def _signature(name: str, function: Any) -> Iterator[str]:
    yield f"{name}()"
    try:
        signature = inspect.signature(function)
    except ValueError:  # of a class without one
        return
    listed = [each for each in signature.parameters.values() if each.name not in ("self", "cls")]
    for place, each in enumerate(listed, 1):
        annotation = getattr(each.annotation, "__forward_arg__", each.annotation)  # of named tuples before Python 3.14
        kind = "" if annotation is each.empty else f": {inspect.formatannotation(annotation)}"
        kind = kind.replace("'", "").replace("pathlib._local.", "")  # the module of Path in Python 3.13
        default = "" if each.default is each.empty else f" = {each.default!r}"
        default = " = ..." if "<" in default else default  # an object whose text has its address
        stars = {each.VAR_POSITIONAL: "*", each.VAR_KEYWORD: "**"}.get(each.kind, "")
        position = f"{place} " if each.kind is each.POSITIONAL_OR_KEYWORD else ""
        yield f"{name} {position}{stars}{each.name}{kind}{default}"
    returned = signature.return_annotation
    if returned not in (signature.empty, None, "None"):
        yield f"{name}() -> {inspect.formatannotation(returned)}".replace("'", "")


def _commands(name: str, command: Any) -> Iterator[str]:
    yield name
    for each in command.params:
        if each.param_type_name == "argument":
            yield f"{name} {each.metavar or each.name.upper()}{_default_of(each)}"
        elif name == "vdfmu" or each.name not in ("quiet", "verbose"):
            yield f"{name} {', '.join((*each.opts, *each.secondary_opts))}{_kind_of(each)}"
    for word, below in getattr(command, "commands", {}).items():
        yield from _commands(f"{name} {word}", below)


def _kind_of(option: Any) -> str:
    """Return the values of an option, whether it may be repeated, and its default."""
    values = "" if option.is_flag else f" {option.metavar or option.bare_type()}"
    return f"{values}{' ...' if option.multiple else ''}{_default_of(option)}"


def _default_of(parameter: Any) -> str:
    default = parameter.default
    return "" if default is None or default is False or callable(default) else f" = {default}"


def _exit_codes() -> list[str]:
    text = re.search(r"Exit codes: (.*?)\.\n", cli.__doc__ or "", re.DOTALL)
    assert text
    return [" ".join(each.split()) for each in text[1].split(", ")]


def _summary() -> Iterator[str]:
    for name, key in KEYS.items():
        yield f"{name}: {_kind(key.of)}"


def _kind(of: Any) -> str:
    if isinstance(of, List):
        return f"list of {_kind(of.of)}"
    if isinstance(of, Keyed):
        return f"by name, {_kind(of.of)}"
    if isinstance(of, Record | Mapping):
        keys = {**of.of, **of.also} if isinstance(of, Record) else of
        return f"table of {', '.join(keys)}"
    return of if isinstance(of, str) else " or ".join(of)


def _keys(schema: Mapping[str, Any], path: str = "") -> Iterator[str]:
    for key, value in schema.get("properties", {}).items():
        kind = " or ".join(map(str, value.get("enum", ()))) or value.get("type", "")
        yield f"{path}{key}{kind and f': {kind}'}{', needed' if key in schema.get('required', ()) else ''}"
        yield from _keys(value, f"{path}{key}.")
        yield from _keys(value.get("items", {}), f"{path}{key}[].")


def _scenario() -> Iterator[str]:
    """Yield the keys of a scenario, without those of its components, which are the variables of their units."""
    schema = scenario_schema()
    components = package_units().keys()
    yield from _keys(schema | {"properties": {k: v for k, v in schema["properties"].items() if k not in components}})


def _variables() -> Iterator[str]:
    for name, unit in package_units().items():
        for each in unit.declared.values():
            if isinstance(each, Declared):
                shape = ",".join("n" if axis is JOINTS else str(axis) for axis in each.shape)
                units = (each.unit,) if isinstance(each.unit, str) else dict.fromkeys(each.unit)
                yield f"{name}.{each.name}{shape and f'[{shape}]'}: {each.causality} {each.type} [{', '.join(units)}]"


def main() -> None:
    """Print the changes; with ``--write`` record them, if the newest version of the changelog names each."""
    gone, new = changes()
    print("\n".join([*(f"- {line}" for line in gone), *(f"+ {line}" for line in new)]))
    if "--write" in sys.argv[1:]:
        newest = next(iter(sections(CHANGELOG.read_text(encoding="utf-8")).values()))
        if missing := {name_of(line): None for line in not_named([*gone, *new], newest)}:
            sys.exit(f"Not recorded: the newest version in CHANGELOG.md does not name `{'`, `'.join(missing)}`.")
        RECORD.write_text("\n".join(promised()), encoding="utf-8")


if __name__ == "__main__":
    main()
