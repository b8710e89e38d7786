"""One FMU: its description, its variables and its calls. FMI's functions are called only in this package."""
