"""Parameter sets (SSV) and parameter mappings (SSM) of a system package."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from vdfmu.system.package.description import ParameterSet
from vdfmu.system.package.xml import META, add, add_units, root, value_text


def parameter_file(parameters: ParameterSet, version: str) -> Any:
    """Root element of an SSV: values in the units of their variables."""
    attributes = {"version": version, "name": parameters.name, **META}
    top = root("ssv:ParameterSet", attributes, ("ssv", "ssc"))
    listed = add(top, "ssv:Parameters")
    for signal, values in parameters.entries:
        parameter = add(listed, "ssv:Parameter", name=signal.name)
        text = " ".join(value_text(signal.type, value) for value in values)
        add(parameter, f"ssv:{signal.type}", value=text, unit=signal.unit)
        for size in signal.shape:
            add(parameter, "ssc:Dimension", size=size)
    add_units(top, "ssv:Units", {signal.unit for signal, _ in parameters.entries if signal.unit})
    return top


def mapping_file(pairs: Sequence[tuple[str, str]], version: str) -> Any:
    """Root element of an SSM: name in the set to name in the component."""
    top = root("ssm:ParameterMapping", {"version": version, **META}, ("ssm", "ssc"))
    for source, target in pairs:
        add(top, "ssm:MappingEntry", source=source, target=target)
    return top
