"""Commands that hostile surroundings are tried with."""

from tests.hostile.jobs import Job

_TUNE = (
    "tune", "planar_tracking", "--vary", "controller.K_p", "--cost", "rms(trajectory.q_d - plant.q)", "--stop", "0.02",
    "--workers", "1", "--method", "global", "--out", "out", "--evaluations",
)  # fmt: skip
JOBS = {"tune": Job((*_TUNE, "3")), "tune, more": Job((*_TUNE, "5"), ((*_TUNE, "3"),))}
