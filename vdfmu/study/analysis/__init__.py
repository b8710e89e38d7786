"""What the equations of a system say without a run: linearisation, and margins of stability of the sampled loop."""
