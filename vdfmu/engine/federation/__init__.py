"""Distributed co-simulation: the components of a system in processes on one or several machines, joined by HELICS."""

from vdfmu.engine.federation.distributed import CORES, Federation, federate

__all__ = ["CORES", "Federation", "federate"]
