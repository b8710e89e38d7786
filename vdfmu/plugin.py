"""Classes for packages that add master algorithms and result formats; to add units, use `vdfmu.unit`."""

from vdfmu.engine.algorithms import Algorithm
from vdfmu.engine.masters.components import Coupling
from vdfmu.engine.masters.sampled import SampledStepper
from vdfmu.engine.results.formats import Format, Stream
from vdfmu.engine.results.results import Recorded, Signal

__all__ = ["Algorithm", "Coupling", "Format", "Recorded", "SampledStepper", "Signal", "Stream"]
