"""Torque estimator as a co-simulation slave: what it computes is in the installed package vdfmu."""

try:
    from vdfmu.fmu.slave import EstimatorSlave
    from vdfmu.fmu.wrapper import hold_globals
except ImportError as error:
    raise ImportError(
        "this FMU needs the package vdfmu in the Python that imports it (pip install vdfmu): "
        + str(error).replace("%", " percent")  # importers use the message as a format of printf
    ) from error

__all__ = ["EstimatorSlave"]

hold_globals(globals())
