"""Systems of FMUs linearised: their matrices, the margins of their loops, and how disturbances grow along a run."""
