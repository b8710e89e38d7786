"""Arguments of environments of another type or without a meaning are refused by a sentence that names them."""

import math

import pytest

import vdfmu
from vdfmu.arm.units import find_unit
from vdfmu.base.errors import UsageError
from vdfmu.base.files import data_path
from vdfmu.extras.learn import Environment

LAG = find_unit(data_path("examples") / "units" / "low_pass.py")


@pytest.fixture(scope="module")
def system(tmp_path_factory):
    fmu = vdfmu.build(LAG, tmp_path_factory.mktemp("misuse") / "lag.fmu")
    return vdfmu.connect({"a": fmu, "b": fmu}, {"a.y": "b.u"}, stop=0.1, step=0.01)


def reward(seen, action):
    return -abs(seen["b.y"][0])


def environment(plant, **changes):
    arguments = dict(system=plant, actions={"a.u": 1.0}, observations={"b.y": 5.0}, reward=reward) | changes
    return Environment(**arguments)


@pytest.mark.parametrize(("changes", "message"), [
    ({"actions": ["a.u"]}, "actions: expected a mapping with texts as keys, got"),
    ({"actions": {}}, "actions: expected at least one input, such as"),
    ({"actions": {"a.u": "x"}}, "limit: expected one finite number, or 1 for a.u, got 'x'"),
    ({"actions": {"a.u": (1.0, -1.0)}}, "limit: expected finite bounds, the lower first"),
    ({"observations": None}, "observations: expected a mapping with texts as keys or a sequence of texts, got None"),
    ({"observations": {}}, "observations: expected at least one output"),
    ({"reward": 5}, "reward: expected a function, got 5"),
    ({"ended": 5}, "ended: expected None or a function, got 5|ended: expected a function, got 5"),
    ({"step": "x"}, "step: expected a number, got 'x'"),
    ({"hold": "x"}, "hold: expected a whole number, got 'x'"),
    ({"lost": math.nan}, "lost: expected a finite number, got nan"),
    ({"vary": {"a.T": "x"}}, "vary: a.T: expected two finite numbers"),
    ({"parameters": {"b.T": math.nan}}, "'b.T': expected a finite number, got nan"),
    ({"system": 5}, "system: expected a System or a Scenario or a text or a path, got 5"),
])  # fmt: skip
def test_an_environment_says_what_was_expected(system, changes, message):
    with pytest.raises(UsageError, match=message):
        environment(system, **changes)


def test_a_reward_that_is_no_number_ends_the_episode_with_a_reason_or_is_refused(system):
    made = environment(system, reward=lambda seen, action: math.nan, lost=-3.0)
    made.reset()
    _, value, ended, cut, info = made.step([0.0])
    assert ended and not cut and value == -3.0 * 10  # of this action and the nine that are left
    assert info == {"error": "the reward: expected a finite number at each step, so the episode ends."}
    for wrong in (None, "x", [1.0, 2.0]):
        made = environment(system, reward=lambda seen, action, wrong=wrong: wrong)
        made.reset()
        with pytest.raises(UsageError, match="reward: expected a function that returns a number, got"):
            made.step([0.0])
    with pytest.raises(UsageError, match="options: expected a mapping with texts as keys, got 5"):
        made.reset(options=5)
    with pytest.raises(UsageError, match="options: parameters: expected a mapping with texts as keys, got 5"):
        made.reset(options={"parameters": 5})
