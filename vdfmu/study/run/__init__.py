"""The run of a scenario: co-simulation, references, comparison, verdict."""
