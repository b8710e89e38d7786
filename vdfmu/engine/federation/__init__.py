"""Distributed co-simulation: components of a system in processes on one or more machines, joined by HELICS."""

from vdfmu.engine.federation.distributed import CORES, Federation, federate

__all__ = ["CORES", "Federation", "federate"]
