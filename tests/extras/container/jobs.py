"""Commands that hostile surroundings are tried with."""

from tests.hostile.commands import OTHER
from tests.hostile.jobs import Job

CONTAINER = ("build", "planar_tracking", "--container", "--out", "out/arm.fmu")
JOBS = {"build --container": Job(CONTAINER, ((*CONTAINER, *OTHER),))}
