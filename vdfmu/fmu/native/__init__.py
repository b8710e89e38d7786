"""Native FMUs: C generated from the trace and the variable table, compiled for each platform."""

from vdfmu.fmu.native.compile import native_available
from vdfmu.fmu.native.platforms import PLATFORMS, this_platform

__all__ = ["PLATFORMS", "native_available", "this_platform"]
