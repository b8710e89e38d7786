"""The class of instances for each version of FMI."""

from __future__ import annotations

from vdfmu.base.standards import FMI_2, FMI_3, FmiVersion
from vdfmu.engine.fmu.component import Slave
from vdfmu.engine.fmu.component2 import Slave2
from vdfmu.engine.fmu.component3 import Slave3

CLASSES: dict[FmiVersion, type[Slave]] = {FMI_2: Slave2, FMI_3: Slave3}
