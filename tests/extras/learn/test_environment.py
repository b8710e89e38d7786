"""Environments: the interface of gymnasium, one arm as in the master, many as one."""

import dataclasses

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import vdfmu
from vdfmu.base.errors import UsageError
from vdfmu.extras.learn import ArmEnv, ArmVectorEnv, Environment, TrackingTask
from vdfmu.system.scenario import load_scenario
from vdfmu.unit import Derivative, Input, Parameter, State, Unit

VARY = {"plant.q_0[1]": (-1.6, -1.5), "plant.mass[2]": (0.5, 1.5)}


def short(stop=0.2):
    return dataclasses.replace(load_scenario("planar_tracking"), stop=stop)


def with_devices(folder, units, connections):
    """Write `planar_tracking` of 0.1 s with units of its own."""
    system = f'extends = "system"\n[components]\n{units}\n[connections]\n{connections}\n'
    (folder / "s.toml").write_text(system)
    models = load_scenario("planar_tracking").system.path.parents[1] / "models"
    text = (models / "scenarios/planar_tracking.toml").read_text()
    (folder / "x.toml").write_text(text.replace("stop = 2.0", 'stop = 0.1\nsystem = "s.toml"'))
    return folder / "x.toml"


@pytest.fixture(scope="module")
def arm():
    with ArmEnv(short(), vary=VARY) as env:
        yield env


@pytest.mark.filterwarnings("ignore:.*not within the observation space")
def test_the_check_of_gymnasium_passes(arm):
    check_env(arm, skip_render_check=True)
    made = gymnasium.make("vdfmu/Arm-v0", scenario=short())
    check_env(made.unwrapped)
    made.close()


def test_numbers_have_names_units_and_limits_and_a_seed_gives_an_episode(arm):
    task = arm.task
    assert task.inputs == ["plant.tau[1]", "plant.tau[2]"] and task.action_units == ["N.m", "N.m"]
    assert dict(zip(task.signals, task.units, strict=True))["plant.kappa_dot[2]"] == "rad/s"
    assert arm.observation_space.shape == (12,) and arm.action_space.shape == (2,)
    assert arm.observation_space.high[:2].tolist() == [2.0 * np.pi] * 2
    assert set(task.scenario.system.parts) == {"trajectory", "plant"}  # the law and its feedforward are left out

    def episode(seed):
        seen, info = arm.reset(seed=seed)
        rows = [seen, *(arm.step(np.array([0.1, 0.0]))[0] for _ in range(5))]
        return np.array(rows), info["parameters"]

    first, drawn = episode(3)
    again, _ = episode(3)
    other, _ = episode(4)
    assert np.array_equal(first, again) and not np.array_equal(first, other)
    assert first[0, 0] == drawn["plant.q_0[1]"] and 0.5 < drawn["plant.mass[2]"] < 1.5


@pytest.mark.heavy
def test_an_episode_is_a_run_of_the_scenario_with_its_torques(arm):
    """The torques of the controller, played as actions held over one step, move the arm as the controller does."""
    run = vdfmu.run(short(), reference=False, out=False)
    env = ArmEnv(short(), hold=1)
    seen, _ = env.reset()
    rows, ends = [seen], []
    for torque in run["controller.tau"][1:]:
        seen, reward, ended, late, _ = env.step(torque)
        rows.append(seen)
        ends.append((ended, late))
        e = (seen[8:10] - seen[:2]) / 0.1
        assert reward == pytest.approx(-np.mean(e**2 / (1.0 + e**2)) - 0.01 * np.mean(torque**2), rel=1e-12)
    env.close()
    rows = np.array(rows)
    # a row has the torque of the step that ends there: gauss-seidel steps the controller before the plant
    assert np.array_equal(rows[:, :2], run["plant.q"]) and np.array_equal(rows[:, 8:10], run["trajectory.q_d"])
    assert ends == [(False, False)] * 199 + [(False, True)]


def test_what_leaves_the_limits_or_fails_ends_the_episode_at_the_worst_cost():
    env = ArmEnv(short(), limits={"plant.q_dot": 0.5}, hold=10)
    env.reset()
    ended, count = False, 0
    while not ended:
        seen, reward, ended, late, _ = env.step(np.array([1.0, 1.0]))
        assert env.observation_space.contains(seen)
        count += 1
    assert not late and count < 20
    assert reward == pytest.approx(-1.01 * (21 - count), rel=1e-12)  # of this action and those that are left
    assert env.reset()[0][2] == 0.0
    env.close()
    env = ArmEnv(short(), limit=1e6, hold=10)
    env.reset()
    _, reward, ended, _, info = env.step(np.array([1e6, -1e6]))
    assert ended and "doStep" in info["error"] and reward == pytest.approx(-1.01 * 20)
    env.reset()
    assert not env.step(np.zeros(2))[2]
    env.close()


@pytest.mark.parametrize(("options", "message"), [
    ({"hold": 7}, "whole actions, got 7"),
    ({"action": "plant.torque"}, "'plant.torque': expected a group of inputs"),
    ({"seen": ("arm.q",)}, "arm: expected components of"),
    ({"track": ("trajectory.q_d", "plant.kappa")}, "plant.kappa: expected an observed signal"),
    ({"limits": {"plant.x": 1.0}}, "plant.x: expected an observed signal"),
    ({"limits": {"plant.q": np.nan}}, "limits: plant.q: expected one finite number, or 2 for plant.q, got nan"),
    ({"limit": [1.0, -1.0]}, "limit: expected a finite number above 0, got \\[1.0, -1.0\\]"),
    ({"error": 0.0}, "error: expected a finite number above 0, got 0"),
    ({"effort": -1.0}, "effort: expected a finite number of at least 0, got -1"),
    (
        {"vary": {"plant.mass[2]": (1.5, 0.5)}},
        r"vary: plant.mass\[2\]: expected two finite numbers, the lower first",
    ),
    ({"vary": {"plant.mas[2]": (0.5, 1.5)}}, "plant.mas"),
    ({"vary": {"plant.mass": (0.5, 1.5)}}, "vary: plant.mass: must be one parameter"),
])  # fmt: skip
def test_what_is_not_there_is_refused(options, message):
    with pytest.raises(UsageError, match=message):
        TrackingTask(short(), **options)


@pytest.mark.heavy
def test_steps_need_a_reset_and_actions_are_finite(arm):
    single, many = ArmEnv(short()), ArmVectorEnv(2, short())
    for env in (single, many):
        with pytest.raises(UsageError, match=r"expected reset\(\) before the first step"):
            env.step(env.action_space.sample())
    single.close(), many.reset(), arm.reset()
    for wrong in (np.zeros(3), np.array([0.0, np.nan]), np.array([np.inf, 0.0])):
        with pytest.raises(UsageError, match=r"action: expected finite numbers of shape \(2,\), got"):
            arm.step(wrong)
        with pytest.raises(UsageError, match="action: expected finite numbers of shape"):
            many.step(np.array([wrong, wrong]))
    with pytest.raises(UsageError, match="num_envs: expected a whole number of at least 1, got 0"):
        ArmVectorEnv(0, short())


def test_a_seed_reaches_the_random_numbers_of_devices(tmp_path):
    path = with_devices(tmp_path, 'sensor = "torque_sensor"', '"plant.tau_s" = ["sensor.tau_s"]')
    with ArmEnv(path, seen=("sensor.tau_s_m", "plant.q", "trajectory.q_d")) as env:

        def episode(**options):
            env.reset(**options)
            return np.array([env.step(np.zeros(2))[0] for _ in range(3)])

        first, next_one, again = episode(seed=1), episode(), episode(seed=1)
        assert np.array_equal(first, again) and not np.array_equal(first, next_one)
        fixed = {"parameters": {"sensor.seed": 7}}
        assert np.array_equal(episode(seed=1, options=fixed), episode(seed=2, options=fixed))
        assert env.task.seeds == ["sensor.seed"]


@pytest.mark.heavy
def test_arms_in_lanes_are_that_of_the_master():
    """Eleven arms, each with parameters and torques of its own, fill blocks of 4 or 8 lanes."""
    n, rng = 11, np.random.default_rng(0)
    actions = rng.uniform(-0.3, 0.3, (20, n, 2))
    many = ArmVectorEnv(n, short(), vary=VARY, hold=10)
    seen, _ = many.reset(seed=5)
    observed, rewards = [seen], []
    for each in actions:
        seen, reward, ended, late, _ = many.step(each)
        observed.append(seen), rewards.append(reward)
    assert not ended.any() and late.all()
    observed, rewards = np.array(observed), np.array(rewards)
    drawn = np.random.default_rng(5)
    single = ArmEnv(short(), hold=10)
    for i in range(n):
        parameters = {name: drawn.uniform(*bounds) for name, bounds in VARY.items()}
        rows = [single.reset(options={"parameters": parameters})[0]]
        expected = []
        for action in actions[:, i]:
            seen, reward, *_ = single.step(action)
            rows.append(seen), expected.append(reward)
        # positions as tests/extras/batch, and other signals as they follow
        np.testing.assert_allclose(observed[:, i], rows, rtol=0, atol=1e-7 * max(1.0, np.abs(rows).max()))
        np.testing.assert_allclose(rewards[:, i], expected, rtol=0, atol=1e-7)
    single.close()


@pytest.mark.heavy
def test_an_arm_whose_episode_ends_begins_anew_while_the_others_go_on():
    many = ArmVectorEnv(3, short(), limit=1e6, hold=10)
    alone = ArmVectorEnv(1, short(), limit=1e6, hold=10)
    first, _ = many.reset(seed=1)
    alone.reset(seed=1)
    calm, wild = np.zeros((3, 2)), np.zeros((3, 2))
    wild[1] = [1e6, -1e6]
    for k in range(20):
        seen, reward, ended, late, info = many.step(wild if k == 4 else calm)
        assert info.get("_error", np.zeros(3, bool)).tolist() == [False, k == 4, False]
        expected, *_ = alone.step(calm[:1])
        assert np.array_equal(seen[[0, 2]], expected[[0, 0]])  # lanes do not meet
        assert ended.tolist() == [False, k == 4, False]
        assert late.tolist() == [k == 19, False, k == 19]
        if k == 5:
            assert np.array_equal(seen[1], first[1]) and reward[1] == 0.0
    again, *_ = many.step(calm)
    assert np.array_equal(again[[0, 2]], first[[0, 2]]) and not np.array_equal(again[1], first[1])
    many = gymnasium.make_vec("vdfmu/Arm-v0", num_envs=2, vectorization_mode="vector_entry_point", scenario=short())
    seen, _ = many.reset(seed=0)
    assert seen.shape == (2, 12) and many.observation_space.contains(seen)
    many.close()


# ---------------------------------------------------------------- any system


class Motor(Unit):
    """Motor with a lag.

    ::

        T w_dot = u - w
    """

    u = Input("V", text="voltage")
    T = Parameter("s", text="time constant", start=0.1, minimum=1e-6)
    w = State("rad/s", text="speed")
    w_dot = Derivative(w)

    def derivatives(self) -> None:
        """Rate of the speed."""
        self.w_dot = (self.u - self.w) / self.T


class Load(Unit):
    """Angle of a speed."""

    w = Input("rad/s", text="speed")
    q = State("rad", text="angle")
    q_dot = Derivative(q)

    def derivatives(self) -> None:
        """Rate of the angle."""
        self.q_dot = self.w


@pytest.fixture(scope="module")
def drive():
    return vdfmu.connect({"motor": Motor, "load": Load}, {"motor.w": "load.w"}, stop=1.0, step=0.01)


def reward_of(seen, action):
    return -np.abs(seen["load.q"][..., 0] - 1.0) - 1e-3 * action["motor.u"][..., 0] ** 2


@pytest.mark.filterwarnings("ignore:.*not within the observation space")
def test_a_system_of_fmus_is_an_environment(drive):
    env = Environment(drive, {"motor.u": (0.0, 3.0)}, {"load.q": 2.0, "motor.w": None}, reward_of, hold=5,
                            vary={"motor.T": (0.1, 0.2)}, lost=-2.0)  # fmt: skip
    check_env(env, skip_render_check=True)
    assert (env.task.inputs, env.task.action_units) == (["motor.u"], ["V"])
    assert (env.task.signals, env.task.units) == (["load.q", "motor.w"], ["rad", "rad/s"])
    assert env.observation_space.high.tolist() == [2.0, 50.0] and env.action_space.low.tolist() == [0.0]
    seen, info = env.reset(seed=1)
    T = info["parameters"]["motor.T"]
    rewards, late, ended = [], False, False
    while not (late or ended):
        seen, reward, ended, late, _ = env.step(np.array([1.0]))
        rewards.append(reward)
    # q of a step in voltage; the speed is held over a step of 0.01 s at the load: at most half a step of the speed late
    assert seen[0] == pytest.approx(1.0 - T * (1.0 - np.exp(-1.0 / T)), abs=0.01)
    assert len(rewards) == 20 and rewards[-1] == -abs(seen[0] - 1.0) - 1e-3
    env.reset()
    count = 0
    while not ended:
        _, reward, ended, _, _ = env.step(np.array([3.0]))
        count += 1
    assert reward == -2.0 * (21 - count)
    env.close()


def test_a_scenario_is_opened_at_the_actions_of_an_environment():
    env = Environment("planar_tracking", {"plant.tau": 1.0}, ["plant.q"], lambda seen, action: 0.0, stop=0.1,
                            ended=lambda seen: seen["plant.q"][0] > 1e9)  # fmt: skip
    env.reset()
    assert env.task.length == 100 and not env.step(np.zeros(2))[2]
    env.close()
