"""The desired motion of the joints: positions and their first four derivatives out.

``pythonfmu build -f trajectory.py`` makes Trajectory.fmu for the paper's arm, which needs vdfmu in
the Python of the tool that imports it. Variables: vdfmu/arm/units/trajectory.py.
Equations: vdfmu/arm/equations/trajectory.py.
"""

import logging

try:
    from vdfmu.arm.slave import hold_globals, slave_of
except ImportError as error:
    text = f"this FMU needs the package vdfmu in the Python that imports it (pip install vdfmu): {error}"
    logging.getLogger("vdfmu.compiler.fmu").error("%s", text)  # many importers do not show it
    raise ImportError(text.replace("%", " percent")) from error  # importers use it as a format of printf

TrajectorySlave = slave_of("trajectory", robot="manipulator_6dof")

__all__ = ["TrajectorySlave"]

hold_globals(globals())
