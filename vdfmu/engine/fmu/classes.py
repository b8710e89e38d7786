"""The class of instances for each version of FMI."""

from __future__ import annotations

from vdfmu.base.standards import FMI_2, FMI_3, FmiVersion
from vdfmu.engine.fmu.description import Description
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.instance2 import Instance2
from vdfmu.engine.fmu.instance3 import Instance3

_CLASSES: dict[FmiVersion, type[Instance]] = {FMI_2: Instance2, FMI_3: Instance3}


def class_of(description: Description) -> type[Instance]:
    """Return the class of instances of an FMU."""
    return _CLASSES[description.version]
