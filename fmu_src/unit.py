"""A unit as a slave of pythonfmu: the script of the Python FMU of each unit that has no separate file here."""

import logging

try:
    from vdfmu.compiler.fmu.python.slave import slave_class
    from vdfmu.compiler.fmu.python.wrapper import hold_globals
except ImportError as error:
    text = f"this FMU needs the package vdfmu in the Python that imports it (pip install vdfmu): {error}"
    # to stderr, if nobody takes it: many importers say no more than that the instantiation failed
    logging.getLogger("vdfmu.compiler.fmu").error("%s", text)
    raise ImportError(text.replace("%", " percent")) from error  # importers use it as a format of printf

ModelSlave = slave_class("Model")

__all__ = ["ModelSlave"]

hold_globals(globals())
