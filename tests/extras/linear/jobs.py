"""Commands that hostile surroundings are tried with."""

from tests.hostile.jobs import Job

JOBS = {"linear": Job(("linear", "planar_2dof", "--bode", "1", "-o", "out/bode.png"))}
