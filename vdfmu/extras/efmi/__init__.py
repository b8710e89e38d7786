"""A sampled or memoryless unit as an eFMU, of eFMI 1.0.0 beta 1: algorithm code, production code, the FMU inside."""
