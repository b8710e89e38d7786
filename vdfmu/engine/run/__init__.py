"""The co-simulation master: checks and runs systems of FMUs of FMI 2.0 and 3.0."""

from vdfmu.engine.algorithms import ALGORITHMS
from vdfmu.engine.fmu.messages import LogMessage
from vdfmu.engine.plan.check import check_system
from vdfmu.engine.results.results import Results, Signal
from vdfmu.engine.run.isolated import LostProcessError
from vdfmu.engine.run.once import simulate
from vdfmu.engine.run.run import Interrupted
from vdfmu.engine.run.simulator import Simulator

__all__ = [
    "ALGORITHMS",
    "Interrupted",
    "LogMessage",
    "LostProcessError",
    "Results",
    "Signal",
    "Simulator",
    "check_system",
    "simulate",
]
