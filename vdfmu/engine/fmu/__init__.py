"""One FMU: its description, its variables, its calls. The only place that knows FMI's functions."""
