"""A wall and a screw take energy, push and never pull, and are stable when held for the steps that theory gives."""

import numpy as np
import pytest

from tests.conftest import random_rotation
from vdfmu.arm.units import find_unit
from vdfmu.arm.world.contact import friction_force, normal_force, screw_torque
from vdfmu.unit import maximum

EPS = np.finfo(float).eps


def touched(unit, p_O, R_O, V_O, **values):
    made = unit(p_O=p_O, R_O=R_O, V_O=V_O, **values)
    if "turn_0" in made.declared:
        made.start()
    made.outputs()
    return made


def test_a_wall_pushes_along_its_normal_and_takes_energy():
    Wall, random = find_unit("wall"), np.random.default_rng(1)
    for _ in range(50):
        normal, R_O = random.normal(size=3), random_rotation(random)
        n = normal / np.linalg.norm(normal)
        p_O, V_O = random.normal(scale=0.01, size=3), random.normal(scale=0.3, size=6)
        wall = touched(Wall, p_O, R_O, V_O, normal=normal, distance=0.0, c=2.0, k=2e4, mu=0.3)
        force = R_O @ wall.F_e[:3]
        np.testing.assert_allclose(wall.depth, n @ p_O, atol=8 * EPS)
        assert force @ n == pytest.approx(wall.N, abs=1e-12)  # roundings of forces of up to 1e3 N
        assert wall.N >= 0.0
        leaving = 1.0 + 2.0 * (n @ (R_O @ V_O[:3])) <= 0.0  # faster than the wall comes back
        assert (wall.N > 0.0) == (n @ p_O > 0.0 and not leaving)
        sliding = R_O @ V_O[:3] - n * (n @ (R_O @ V_O[:3]))
        friction = force - wall.N * n
        assert np.linalg.norm(friction) <= 0.3 * wall.N + 1e-12
        assert friction @ sliding >= 0.0
        # power into the wall is what its spring stores, and more
        stored = 2e4 * maximum(n @ p_O, 0.0) * (n @ (R_O @ V_O[:3]))
        assert wall.F_e @ V_O >= stored - 1e-12 * abs(stored)


def test_friction_is_that_of_coulomb_far_from_rest_and_viscous_near_it():
    v = np.array([3.0, 4.0, 0.0])
    # sqrt(1 + (eps / v)^2) = 1 + 2e-8, and eps / v of the other case is 1e4
    np.testing.assert_allclose(friction_force(0.3, 1e-3, 10.0, v), 3.0 * v / 5.0, rtol=1e-7)
    np.testing.assert_allclose(friction_force(0.3, 1e-3, 10.0, 1e-8 * v), 3e3 * 1e-8 * v, rtol=1e-8)


def test_a_bounce_loses_what_hunt_and_crossley_say():
    """It leaves with v (1 - 2/3 c v), to first order: the error falls with the square of c v."""
    errors = []
    for c in (0.2, 0.1):
        k, m, v, x, h = 1e4, 1.0, 1.0, 0.0, 1e-6
        while x >= 0.0:  # midpoint rule, of order 2: 1e-8 of the way
            a = -normal_force(k, c, x, v) / m
            x_half, v_half = x + 0.5 * h * v, v + 0.5 * h * a
            x, v = x + h * v_half, v - h * normal_force(k, c, x_half, v_half) / m
        errors.append(abs(-v - (1.0 - 2.0 / 3.0 * c)))
    assert errors[0] < 0.5 * 0.2**2
    assert 3.0 < errors[0] / errors[1] < 5.0


def growth(k, d, m, h):
    """Growth in a step of a mass whose spring and damper are held over it: the motion of a held force is exact."""
    a, b = k * h * h / m, d * h / m
    A = np.array([[1.0 - a / 2.0, h - b * h / 2.0], [-a / h, 1.0 - b]])
    return np.abs(np.linalg.eigvals(A)).max()


@pytest.mark.parametrize(("k", "m"), [(2e4, 0.4), (5.0, 2e-3)])
def test_a_held_contact_is_stable_between_two_dampings(k, m):
    h = 1e-3
    least, most = k * h / 2.0, 2.0 * m / h
    for d, stable in ((0.99 * least, False), (1.01 * least, True), (0.99 * most, True), (1.01 * most, False)):
        assert (growth(k, d, m, h) < 1.0) == stable


def test_a_wall_held_at_a_load_turns_unstable_where_the_limit_says():
    """A mass pressed on the unit's wall by N: it rests for h < 2 c N / k, and chatters beyond."""
    k, c, m, N = 2e4, 2.0, 1.0, 50.0
    wall = find_unit("wall")(normal=[1.0, 0, 0], distance=0.0, k=k, c=c, mu=0.0, R_O=np.eye(3))
    limit = 2.0 * c * N / k
    ends = []
    for h in (0.8 * limit, 1.2 * limit):
        x, v = N / k * (1.0 + 1e-4), 0.0
        for _ in range(600):
            wall.p_O, wall.V_O = np.array([x, 0, 0]), np.array([v, 0, 0, 0, 0, 0])
            wall.outputs()
            a = (N - wall.F_e[0]) / m
            x, v = x + h * v + 0.5 * h * h * a, v + h * a
        ends.append(abs(x - N / k) / (1e-4 * N / k))
    assert ends[0] < 0.01
    assert ends[1] > 10.0


def test_a_screw_wants_a_push_and_gets_harder_until_it_is_seated():
    Screw = find_unit("screw")
    settings = {"axis": [0.0, 0.0, 1.0], "distance": 0.0, "turn_seat": 10.0, "pitch": 0.0}
    spin = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 5.0])
    at = {
        turn: touched(Screw, [0.0, 0.0, 1e-2], np.eye(3), spin, turn_0=turn, **settings).T
        for turn in (0.0, 5.0, 9.9, 10.2)
    }
    assert at[0.0] == pytest.approx(0.1, rel=1e-4)  # tanh(5 / 1) = 1 - 9e-5
    assert at[5.0] == pytest.approx(0.2, rel=1e-4)
    assert at[10.2] == pytest.approx(0.1 + 0.02 * 10.2 + 5.0 * 0.2 * (1.0 + 0.1 * 5.0), rel=1e-4)
    assert at[0.0] < at[5.0] < at[9.9] < at[10.2]
    assert touched(Screw, [0.0, 0.0, -1e-3], np.eye(3), spin, turn_0=5.0, **settings).T == 0.0
    slipping = touched(Screw, [0.0, 0.0, 1e-5], np.eye(3), spin, turn_0=12.0, **settings)
    assert slipping.T == pytest.approx(0.05 * slipping.N, rel=1e-12)
    assert screw_torque(0.1, 0.02, 1.0, 5.0, -5.0) == -screw_torque(0.1, 0.02, 1.0, 5.0, 5.0)


def test_a_screw_goes_in_by_its_pitch_and_turns_with_the_tool():
    Screw = find_unit("screw")
    screw = Screw(axis=[0.0, 0.0, 1.0], distance=0.0, pitch=1e-3, p_O=[0.0, 0.0, 5e-3],
                  V_O=[0.0, 0.0, 0.0, 0.0, 0.0, 4.0 * np.pi], R_O=np.eye(3), c=0.0)  # fmt: skip
    solution = screw.simulate(stop=1.0, step=0.5)
    np.testing.assert_allclose(solution["turn"], [0.0, 2.0 * np.pi, 4.0 * np.pi], atol=1e-6)  # its tolerance
    # two turns of 1 mm: the head is 2 mm deeper, and the bit less
    np.testing.assert_allclose(solution["N"], 2e4 * np.array([5e-3, 4e-3, 3e-3]), rtol=1e-6)
    lifted = Screw(axis=[0.0, 0.0, 1.0], distance=0.0, p_O=[0.0, 0.0, -1e-3], V_O=[0.0, 0, 0, 0, 0, 10.0])
    assert not lifted.simulate(stop=0.1, step=0.1)["turn"].any()
