"""What the files of the shipped scenarios say of their gains: margins along the run."""

import numpy as np
import pytest

from vdfmu.study.analysis.loops import margins_along
from vdfmu.study.verdict import loop_sentences
from vdfmu.system.scenario import load_scenario


def margins(name, **options):
    """Return the smallest modulus margins [-] and delay margins [s] of the loops along a run."""
    along = margins_along(name, **options)
    return tuple(np.min([getattr(each, key) for each in along.margins], axis=0) for key in ("modulus", "delay"))


@pytest.mark.heavy
@pytest.mark.parametrize("name", [
    "tracking", "estimation", "two_joint", "two_joint_table5", "planar_tracking", "slider_tracking", "wall", "two_arms",
])  # fmt: skip
def test_each_loop_has_a_modulus_margin_of_a_half_and_a_delay_margin_of_a_sample(name):
    """Ms <= 2 is the upper end of what Astrom and Hagglund (2006, section 4.5) recommend."""
    modulus, delay = margins(name)
    assert modulus.min() >= 0.5
    assert delay.min() >= load_scenario(name).step


@pytest.mark.heavy
def test_where_a_margin_is_less_the_file_says_why():
    modulus, delay = margins("screw")
    assert modulus.min() >= 0.5 and 0.9e-3 < delay.min() < 1e-3  # 306 Hz, as its file says
    modulus, delay = margins("kr300")
    assert modulus.min() >= 0.5 and 0.8e-3 < delay.min() < 1e-3  # gains of the real controller


@pytest.mark.heavy
def test_under_jacobi_the_gains_hold_at_half_the_step_and_the_verdict_says_so():
    figures = margins_along("tracking", algorithm="jacobi").judged.figures
    state, sentences = loop_sentences(figures)
    assert state != "good" and sentences[-1].startswith("with a step of 0.0005 s the modulus margin is 0.5")
    modulus, _ = margins("tracking", algorithm="jacobi", step=5e-4)
    assert modulus.min() >= 0.5
    assert figures["half_step"]["value"] == pytest.approx(modulus.min(), rel=0.02)  # the rows of another run
