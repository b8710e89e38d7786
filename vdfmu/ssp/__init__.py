"""Reading of system structure packages (SSP 1.0)."""

from vdfmu.ssp.experiment import Experiment
from vdfmu.ssp.read import load_ssp
from vdfmu.ssp.structure import Component, Connection, Connector, Hop, Parameter, System, Transformation, Unit

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
