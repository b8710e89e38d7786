"""Commands that hostile surroundings are tried with."""

from tests.hostile.jobs import RUN, Job

_IDENTIFY = ("identify", "out/results.csv", "--robot", "planar_2dof", "--overwrite", "-o", "robot.toml")
JOBS = {"identify": Job(_IDENTIFY, ((*RUN, "1", "--no-reference"),))}
