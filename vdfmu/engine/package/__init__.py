"""Reading of system structure packages (SSP 1.0 and 2.0)."""
