"""Native FMUs: C generated from the trace and the declaration of a unit, compiled for each platform."""

from vdfmu.compiler.c.platforms import PLATFORMS, this_platform
from vdfmu.compiler.c.programs import native_available

__all__ = ["PLATFORMS", "native_available", "this_platform"]
