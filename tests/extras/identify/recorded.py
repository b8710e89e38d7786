"""A motion of the planar arm that logs have recorded."""

import numpy as np

from vdfmu.arm.equations.rigid_body import body_parameters
from vdfmu.extras.identify.problem import regressor

STEP, M = 0.004, 1500
T = STEP * np.arange(M)


def motion(robot, t):
    """Return rotors, links and motor torques of a stiff arm with friction, at any times."""
    w = 2 * np.pi * np.array([[0.4, 0.7], [0.9, 0.5]])
    phase = np.array([[0.3, 1.1], [2.0, 0.2]])
    size = np.array([[0.8, 0.7], [0.3, 0.4]])
    at = w[:, None] * t[:, None] + phase[:, None]
    kappa, v, a = (
        np.sum(size[:, None] * each, axis=0)
        for each in (np.sin(at), w[:, None] * np.cos(at), -(w[:, None] ** 2) * np.sin(at))
    )
    links = regressor(robot, kappa, v, a, v, a).links @ body_parameters(robot)
    friction = robot.f_c * np.tanh(v / 0.01) + robot.f_v * v
    return kappa, kappa - links / 1e4, (links + robot.I_m * robot.ell * a + friction) / robot.ell


def noisy(log, robot, seed):
    """Return the log as of encoders of 17 bits behind and before the gears, and torques with 0.5 % of the largest."""
    random = np.random.default_rng(seed)
    size = 0.005 * np.abs(log.tau).max(axis=0)
    phase = random.uniform(0.0, ENCODER, (2, robot.n))  # where the encoders have their zero
    return log._replace(
        q=np.round((log.q + phase[0]) / ENCODER) * ENCODER - phase[0],
        kappa=(np.round((robot.ell * log.kappa + phase[1]) / ENCODER) * ENCODER - phase[1]) / robot.ell,
        tau=log.tau + size * random.normal(size=log.tau.shape),
    )


def thinned(log, stride):
    return log._replace(**{name: getattr(log, name)[::stride] for name in ("t", "kappa", "q", "tau")})


ENCODER = 2 * np.pi / 2**17
