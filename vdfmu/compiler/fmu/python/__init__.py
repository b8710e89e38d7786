"""Python FMUs. They run in a Python that has vdfmu."""
