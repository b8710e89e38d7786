"""Flexible arm as a co-simulation slave: what it computes is in the installed package vdfmu."""

try:
    from vdfmu.fmu.slave import UnitSlave
except ImportError as error:
    raise ImportError(
        "This FMU needs the package vdfmu in the Python that imports it (pip install vdfmu): " + str(error)
    ) from error


class VdfmuPlantSlave(UnitSlave):
    """Slave of the unit plant."""

    unit = "plant"
