"""A sampled or memoryless unit as an eFMU of eFMI 1.0.0 beta 1: algorithm code and production code in an FMU."""
