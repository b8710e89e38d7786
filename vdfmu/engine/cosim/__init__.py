"""The co-simulation master: checks and runs systems of FMUs of FMI 2.0 and 3.0."""

from vdfmu.engine.algorithms import ALGORITHMS
from vdfmu.engine.cosim.check import check_system
from vdfmu.engine.cosim.master import simulate
from vdfmu.engine.cosim.messages import LogMessage
from vdfmu.engine.cosim.results import Results, Signal
from vdfmu.engine.cosim.run import Interrupted
from vdfmu.engine.cosim.simulator import Simulator

__all__ = [
    "ALGORITHMS", "Interrupted", "LogMessage", "Results", "Signal", "Simulator", "check_system", "simulate",
]  # fmt: skip
