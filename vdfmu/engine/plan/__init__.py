"""Plans the run of a system with its options: checks, conversions, order of calls, inputs."""
