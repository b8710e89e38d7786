"""The feedforward: the desired motion in, torques of the motors and motion of the rotors out.

``pythonfmu build -f feedforward.py`` makes Feedforward.fmu for the paper's arm, which needs vdfmu in
the Python of the tool that imports it. Variables: vdfmu/arm/units/feedforward.py.
Equations: vdfmu/arm/equations/feedforward.py.
"""

import logging

try:
    from vdfmu.arm.slave import hold_globals, slave_of
except ImportError as error:
    text = f"this FMU needs the package vdfmu in the Python that imports it (pip install vdfmu): {error}"
    logging.getLogger("vdfmu.compiler.fmu").error("%s", text)  # many importers do not show it
    raise ImportError(text.replace("%", " percent")) from error  # importers use it as a format of printf

FeedforwardSlave = slave_of("feedforward", robot="manipulator_6dof")

__all__ = ["FeedforwardSlave"]

hold_globals(globals())
