"""The arm with elastic joints: torques of the motors in, motion of links and rotors out.

``pythonfmu build -f plant.py`` makes Plant.fmu for the paper's arm, which needs vdfmu in
the Python of the tool that imports it. Variables: vdfmu/arm/units/plant.py.
Equations: vdfmu/arm/equations/plant.py.
"""

import logging

try:
    from vdfmu.arm.slave import hold_globals, slave_of
except ImportError as error:
    text = f"this FMU needs the package vdfmu in the Python that imports it (pip install vdfmu): {error}"
    logging.getLogger("vdfmu.compiler.fmu").error("%s", text)  # many importers do not show it
    raise ImportError(text.replace("%", " percent")) from error  # importers use it as a format of printf

PlantSlave = slave_of("plant", robot="manipulator_6dof")

__all__ = ["PlantSlave"]

hold_globals(globals())
