"""Native FMUs: C generated from the trace and the declaration of a unit, compiled for each platform."""

from vdfmu.fmu.native.compile import native_available
from vdfmu.fmu.native.platforms import PLATFORMS, this_platform

__all__ = ["PLATFORMS", "native_available", "this_platform"]
