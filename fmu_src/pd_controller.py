"""The PD controller: desired and measured motion in, torques of the motors out.

``pythonfmu build -f pd_controller.py`` makes PDController.fmu for the paper's arm, which needs vdfmu in
the Python of the tool that imports it. Variables: vdfmu/arm/units/controller.py.
Equations: vdfmu/arm/equations/pd.py.
"""

import logging

try:
    from vdfmu.arm.slave import hold_globals, slave_of
except ImportError as error:
    text = f"this FMU needs the package vdfmu in the Python that imports it (pip install vdfmu): {error}"
    logging.getLogger("vdfmu.compiler.fmu").error("%s", text)  # many importers do not show it
    raise ImportError(text.replace("%", " percent")) from error  # importers use it as a format of printf

PDControllerSlave = slave_of("controller", robot="manipulator_6dof")

__all__ = ["PDControllerSlave"]

hold_globals(globals())
