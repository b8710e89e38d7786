"""Python FMUs, which run in a Python that has vdfmu."""
