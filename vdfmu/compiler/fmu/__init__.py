"""The FMI layer: model descriptions, generated C, slaves and the build of FMUs."""

from vdfmu.compiler.fmu.build import build_fmus

__all__ = ["build_fmus"]
