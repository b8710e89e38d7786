"""Energies of an arm."""

import numpy as np

ENERGIES = ("E_kin", "E_pot", "E_spring")


def energy(outputs):
    return sum(np.ravel(getattr(outputs, name))[0] for name in ENERGIES)
