"""From a system and options to a plan of its run: checks, conversions, order of calls, inputs."""
