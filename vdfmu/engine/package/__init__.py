"""Reading of system structure packages (SSP 1.0 and 2.0)."""

from vdfmu.engine.package.read import load_ssp

__all__ = ["load_ssp"]
