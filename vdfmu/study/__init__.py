"""Complete studies, which run, compare and report scenarios, for the command line and the Python API."""
