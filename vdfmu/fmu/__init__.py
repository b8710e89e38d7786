"""The FMI layer: variable table, model descriptions, slaves and the build of FMUs."""

from vdfmu.fmu.build import build_fmus
from vdfmu.fmu.interface import UNIT_NAMES, Interface, Variable

__all__ = ["UNIT_NAMES", "Interface", "Variable", "build_fmus"]
