"""Arithmetic of the equations: elementwise functions of floats, symbols and jets, and linear algebra."""

from vdfmu.compiler.scalar.generic import clip, lookup, maximum, minimum, sgn, zeros
from vdfmu.compiler.scalar.jet import derivative, jets
from vdfmu.compiler.scalar.matrices import factorize, is_zero, solve_factorized  # registers np.linalg.solve too
from vdfmu.compiler.scalar.passes import inward, outward, total
from vdfmu.compiler.scalar.random_numbers import LARGEST_SEED
from vdfmu.compiler.scalar.symbol import ZERO, Symbol, from_sx, to_sx

__all__ = [
    "LARGEST_SEED",
    "ZERO",
    "Symbol",
    "clip",
    "derivative",
    "factorize",
    "from_sx",
    "inward",
    "is_zero",
    "jets",
    "lookup",
    "maximum",
    "minimum",
    "outward",
    "sgn",
    "solve_factorized",
    "to_sx",
    "total",
    "zeros",
]
