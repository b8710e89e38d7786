"""Analysis of a system without a run: linearisation, and margins of stability of the sampled loop."""
