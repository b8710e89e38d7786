"""The angular velocities of the links that the paper prints after (47), against (29)-(36)."""

import numpy as np
import pytest

from vdfmu.arm.equations.inverse_dynamics import link_motion


def printed(q, q_dot):
    _, _, _, c4, c5, c6 = np.cos(q)
    _, s2, _, s4, s5, s6 = np.sin(q)
    c2 = np.cos(q[1])
    s23, c23 = np.sin(q[1] + q[2]), np.cos(q[1] + q[2])
    d1, d2, d3, d4, d5, d6 = q_dot
    theta_1 = d2 + d3
    theta_2 = d4 + d1 * s23
    theta_3 = (d2 + d3) * s4 + d1 * c23 * c4
    across = d5 + theta_1 * c4 - d1 * c23 * s4
    return [
        np.array([0.0, 0.0, d1]),
        np.array([d1 * s2, d1 * c2, d2]),
        np.array([d1 * s23, d1 * c23, theta_1]),
        np.array([-theta_1 * s4 - d1 * c23 * c4, d1 * c23 * s4 - theta_1 * c4, theta_2]),
        np.array([theta_2 * s5 - theta_3 * c5, theta_2 * c5 - theta_3 * s5, across]),
        np.array(
            [
                -(theta_3 * c5 - theta_2 * s5) * c6 - across * s6,
                (theta_3 * c5 - theta_2 * s5) * s6 - across * c6,
                d6 + theta_3 * s5 + theta_2 * c5,
            ]
        ),
    ]


@pytest.mark.parametrize("link", [1, 2, 3, 4, 5, 6])
def test_angular_velocities_are_those_printed_after_equation_47(arm, draw, link):
    for state in draw(arm, 10, seed=50):
        V_B = link_motion(arm, state.q, state.q_dot, state.q_ddot).V_B
        expected = printed(state.q, state.q_dot)[link - 1]
        entries = [0, 2] if link == 5 else [0, 1, 2]  # its second entry has its own test
        # Some 20 products of order 1 to 4: 1e-14 is 20 roundings.
        np.testing.assert_allclose(V_B[link - 1][3:][entries], expected[entries], rtol=0, atol=1e-14)


def test_erratum_omega_B5_has_a_wrong_sign_in_its_second_entry(arm, draw):
    # Printed: theta_2 c5 - theta_3 s5. Built: theta_2 c5 + theta_3 s5, which the paper's own omega_B6
    # contains (its third entry is q6_dot plus the second of omega_B5).
    for state in draw(arm, 10, seed=51):
        omega = printed(state.q, state.q_dot)
        second = link_motion(arm, state.q, state.q_dot, state.q_ddot).V_B[4][3:][1]
        consistent = omega[5][2] - state.q_dot[5]
        # As above.
        assert second == pytest.approx(consistent, abs=1e-14)
        c23, s4, c4 = np.cos(state.q[1] + state.q[2]), np.sin(state.q[3]), np.cos(state.q[3])
        theta_3 = (state.q_dot[1] + state.q_dot[2]) * s4 + state.q_dot[0] * c23 * c4
        assert second - omega[4][1] == pytest.approx(2.0 * theta_3 * np.sin(state.q[4]), abs=1e-14)
        assert abs(second - omega[4][1]) > 1e-3
