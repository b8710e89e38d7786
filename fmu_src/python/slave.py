"""A unit as a co-simulation slave: what it computes is in the installed package vdfmu."""

try:
    from vdfmu.fmu.python.slave import slave_class
    from vdfmu.fmu.python.wrapper import hold_globals
except ImportError as error:
    raise ImportError(
        "this FMU needs the package vdfmu in the Python that imports it (pip install vdfmu): "
        + str(error).replace("%", " percent")  # importers use the message as a format of printf
    ) from error


ModelSlave = slave_class("Model")

__all__ = ["ModelSlave"]

hold_globals(globals())
