"""Analysis of a system: linearisation, and stability margins of the sampled loops."""
