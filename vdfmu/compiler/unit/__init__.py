"""Units: declaration, variables for a robot, and traced functions."""

from vdfmu.compiler.scalar.generic import clip, interpolate, lookup, maximum, minimum, sgn, where, zeros
from vdfmu.compiler.scalar.matrices import expm, inv, solve
from vdfmu.compiler.scalar.random_numbers import normal, seeded, uniform
from vdfmu.compiler.scalar.symbol import casadi_call
from vdfmu.compiler.unit.declaration import (
    JOINTS,
    Choice,
    Derivative,
    Event,
    Held,
    Input,
    Mode,
    Output,
    Parameter,
    RobotParameters,
    Sampled,
    State,
    Switch,
    Terminal,
)
from vdfmu.compiler.unit.unit import Unit

__all__ = [
    "JOINTS",
    "Choice",
    "Derivative",
    "Event",
    "Held",
    "Input",
    "Mode",
    "Output",
    "Parameter",
    "RobotParameters",
    "Sampled",
    "State",
    "Switch",
    "Terminal",
    "Unit",
    "casadi_call",
    "clip",
    "expm",
    "interpolate",
    "inv",
    "lookup",
    "maximum",
    "minimum",
    "normal",
    "seeded",
    "sgn",
    "solve",
    "uniform",
    "where",
    "zeros",
]
