"""A class in numpy becomes functions, C and an FMU. Nothing here knows a robot."""
