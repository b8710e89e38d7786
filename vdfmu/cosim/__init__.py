"""The co-simulation master: checks and runs any SSP 1.0 of FMI 2.0 co-simulation units."""

from vdfmu.cosim.check import check_system
from vdfmu.cosim.checked import Checked
from vdfmu.cosim.component import LogMessage
from vdfmu.cosim.master import Interrupted, simulate
from vdfmu.cosim.results import Results, Signal
from vdfmu.cosim.schedule import ALGORITHMS

__all__ = [
    "ALGORITHMS",
    "Checked",
    "Interrupted",
    "LogMessage",
    "Results",
    "Signal",
    "check_system",
    "simulate",
]
