"""Frequency responses: the closed form of two masses on a spring, and MuJoCo's derivatives of the same arm."""

import numpy as np
import pytest

import vdfmu
from tests.conftest import invoked, ran
from tests.study.analysis.lift import MASS, ONE_JOINT
from tests.study.analysis.lift import roots as poles_of
from vdfmu.base.errors import UsageError
from vdfmu.extras.linear import bode, joint_bode


@pytest.fixture
def lift(tmp_path):
    (tmp_path / "lift.toml").write_text(ONE_JOINT)
    return vdfmu.load_robot(tmp_path / "lift.toml")


@pytest.fixture
def smooth(lift):
    return lift.with_parameters(f_v=0.0)


def test_two_masses_on_a_spring_have_their_resonance_and_anti_resonance(smooth):
    _, K, J = poles_of(smooth, 0.0)
    curves = joint_bode(smooth, [0.1], 1)
    # rounding of eigenvalues: 1e-16 of the norm of A, 1e5, over 300 rad/s
    assert curves.resonance == pytest.approx(np.sqrt(K * (1 / J + 1 / MASS)) / (2 * np.pi), rel=1e-9)
    assert curves.antiresonance[0] == pytest.approx(np.sqrt(K / MASS) / (2 * np.pi), rel=1e-9)
    assert not curves.antiresonance[1].size
    s = 2j * np.pi * curves.frequency
    near = np.min(np.abs(curves.frequency[:, None] - curves.resonance), axis=1) < 1e-3 * curves.resonance[0]
    # a motor torque acts as ell times as much on the link side
    ell = float(smooth.ell[0])
    whole = s * (J * MASS * s**2 + K * (J + MASS))
    rotor, link = ell * (MASS * s**2 + K) / whole, ell * K / whole
    size = np.abs(rotor) + np.abs(link)
    for mine, other in zip(curves.response, (rotor, link), strict=True):
        # beside the pole, of which both are infinite: rounding of 1e-16 times 1e5, over 1e-3 of the pole's square
        np.testing.assert_allclose((mine / size)[~near], (other / size)[~near], atol=1e-8)


@pytest.mark.heavy
def test_the_command_draws_a_joint(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = ran("linear", "planar_2dof", "--pose", "0.3 -0.5", "--bode", "2")
    assert (tmp_path / "planar_2dof_bode.png").read_bytes().startswith(b"\x89PNG")
    curves = joint_bode(vdfmu.load_robot("planar_2dof"), [0.3, -0.5], 2)
    assert all(f"{f:.2f}" in said.output for f in (*curves.resonance, *curves.antiresonance[0]))
    for options, message in (
        (["--bode", "3"], "--bode 3: expected a joint, 1 to 2"),
        (["--bode", "1", "--modes"], "--modes is only for a scenario, but planar_2dof is a robot"),
    ):
        failed = invoked("linear", "planar_2dof", *options, "--overwrite")
        assert isinstance(failed.exception, UsageError) and message in str(failed.exception), options
        assert "Hz" not in failed.output  # it fails before it prints anything


def test_signals_that_are_not_there_are_named(smooth):
    with pytest.raises(UsageError, match=r"expected a system in continuous time with tau\[2\], q\[1\]; inputs are tau"):
        bode(vdfmu.linearize(smooth, [0.1]), "tau[2]", ["q[1]"])
