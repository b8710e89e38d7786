"""Inspection of FMUs and packages, by `vdfmu check`, and of systems, linearised: their loops and margins."""
