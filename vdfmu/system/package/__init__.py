"""The package of a scenario's system: description, diagram, files, FMUs, SSP 1.0 and 2.0."""
