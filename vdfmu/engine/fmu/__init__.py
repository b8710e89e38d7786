"""One FMU: its description, its variables, its calls. The only place that calls FMI's functions."""
