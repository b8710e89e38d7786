"""Reading of system structure packages (SSP 1.0 and 2.0)."""

from vdfmu.engine.ssp.experiment import Experiment
from vdfmu.engine.ssp.read import load_ssp
from vdfmu.engine.ssp.structure import (
    Component,
    Connection,
    Connector,
    Hop,
    Parameter,
    System,
    Transformation,
    Unit,
)

__all__ = [
    "Component",
    "Connection",
    "Connector",
    "Experiment",
    "Hop",
    "Parameter",
    "System",
    "Transformation",
    "Unit",
    "load_ssp",
]
