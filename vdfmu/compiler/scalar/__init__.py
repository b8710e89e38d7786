"""Arithmetic of the equations: elementwise functions of floats, symbols and jets, and elimination."""

from vdfmu.compiler.scalar import matrices as matrices  # so that symbols take np.linalg.solve
