"""Actuators, sensors and communication against independent checks: integers, lists of packets, closed forms."""

from itertools import islice

import fmpy
import numpy as np
import pytest

import vdfmu
from tests.arm.units.steps import sampled
from tests.engine.system_loops import system_loop
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.units import find_unit
from vdfmu.base.errors import FmuError, UsageError
from vdfmu.engine.linear.linearise import linear_system
from vdfmu.system.package.write import cached_fmus, write_ssp
from vdfmu.system.scenario import load_scenario
from vdfmu.unit import seeded, uniform

H = 1e-3
EPS = np.finfo(float).eps


def mrg32k3a(state):
    """Yield the numbers of MRG32k3a, by whole numbers of Python."""
    m_1, m_2 = 2**32 - 209, 2**32 - 22853
    a, b = list(state[:3]), list(state[3:])
    while True:
        a = [*a[1:], (1403580 * a[1] - 810728 * a[0]) % m_1]
        b = [*b[1:], (527612 * b[2] - 1370589 * b[0]) % m_2]
        yield ((a[2] - b[2]) % m_1 or m_1) / (m_1 + 1)


def of_seed(seed):
    state = [seed + 1]
    for _ in range(8):
        state.append(48271 * state[-1] % (2**31 - 1))
    return mrg32k3a(state[3:])


def test_random_numbers_are_those_that_the_author_of_the_generator_prints():
    """The first of the state 12345, 12345, .. in the package RngStreams."""
    numbers, _ = uniform(np.full(6, 12345.0), 5)
    np.testing.assert_allclose(numbers, [0.127011, 0.318528, 0.309186, 0.825847, 0.221630], rtol=0, atol=5e-7)


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", [0, 7, 2147483645])
def test_random_numbers_are_exact(seed):
    numbers, state = uniform(seeded(float(seed)), 1000)
    again, _ = uniform(state, 1000)
    assert [*numbers, *again] == list(islice(of_seed(seed), 2000))


def test_neighbouring_seeds_give_independent_numbers_and_noise_is_the_sum_of_twelve(planar):
    n = 4000
    drawn = np.array([uniform(seeded(float(seed)), n)[0] for seed in range(8)]) - 0.5
    matrix = 12.0 * drawn @ drawn.T / n
    # a mean of n products, each of standard deviation 1, or sqrt(4/5) on the diagonal; 5 standard deviations
    np.testing.assert_allclose(matrix, np.eye(8), rtol=0, atol=5.0 / np.sqrt(n))
    n, sigma, offset = 3000, np.array([0.1, 0.5]), np.array([0.3, -0.2])
    unit = find_unit("torque_sensor")(planar, tau_s=[7.0, 3.0], sigma=sigma, offset=offset)
    measured = sampled(unit, n)["tau_s_m"]
    noise = (measured - [7.3, 2.8]) / sigma
    numbers = np.array(list(islice(of_seed(1), 24 * n))).reshape(n, 2, 12).sum(axis=2) - 6.0
    # rounded to 1e-9, over 0.1
    np.testing.assert_allclose(noise, numbers, rtol=0, atol=0.51e-9 / 0.1)


@pytest.mark.parametrize("form", ["native 2.0", "native 3.0", "python 2.0"])
@pytest.mark.heavy
def test_noise_has_the_same_bits_in_every_fmu(planar, tmp_path, form):
    backend, version = form.split()
    start = {"seed": 11.0, "sigma[1]": 0.25, "sigma[2]": 2.0, "resolution[1]": 0.125, "resolution[2]": 2.0**-20}
    (path,) = build_fmus(
        planar, tmp_path, units=["torque_sensor"], backend=backend, fmi_version=version,
        parameters={"torque_sensor": start}, folded=True).values()  # fmt: skip
    names = ["tau_s_m"] if version == "3.0" else ["tau_s_m[1]", "tau_s_m[2]"]
    rows = fmpy.simulate_fmu(str(path), stop_time=0.5, output_interval=H, output=names)
    unit = find_unit("torque_sensor")(planar, seed=11.0, sigma=[0.25, 2.0], resolution=[0.125, 2.0**-20])
    expected = sampled(unit, 500)["tau_s_m"]
    measured = np.array([np.ravel(list(row)[1:]) for row in rows])
    # a row is at the end of a step, whose sample is that of its begin
    assert np.array_equal(measured[1:], expected)


def test_an_encoder_reads_in_steps_and_late_and_with_whole_samples_of_delay_has_the_samples(planar):
    w, late, span = 7.0, 2.25e-3, [2.0 * np.pi, 0.5]
    q = lambda t: np.array([np.sin(w * t), 0.3 * np.cos(w * t)])  # noqa: E731
    unit = find_unit("encoder")(planar, q=q(0.0), bits=14.0, T_d=late, span=span, T_v=[0.0, 4e-3])
    rows = sampled(unit, 600, q=q)
    r, t = np.array([2.0 * np.pi, 0.5]) / 2**14, H * np.arange(600)
    true = np.array([q(max(x - late, 0.0)) for x in t])
    error = rows["q_m"] - true
    # half a step, and the chord of a second derivative of w^2
    assert (np.abs(error) < r / 2.0 + w**2 * H**2 / 8.0 + 1e-12).all()
    assert (np.abs(error).max(axis=0) > 0.4 * r).all()
    counts = rows["q_m"] / r
    np.testing.assert_allclose(counts, np.rint(counts), rtol=0, atol=1e-9)  # up to 1e4 steps, of rounding
    # independently: each joint by itself, from the samples two and three before
    for i, (T_v, r_i) in enumerate(zip([0.0, 4e-3], r, strict=True)):
        x = np.array([q(max(s, 0.0))[i] for s in H * np.arange(-3, 600)])
        read = r_i * np.floor((0.75 * x[1:-2] + 0.25 * x[:-3]) / r_i + 0.5)
        same = read == rows["q_m"][:, i]
        assert same.mean() > 0.99  # but for a value within rounding of half a step
        v, velocity = 0.0, []
        for before, now in zip([rows["q_m"][0, i], *rows["q_m"][:-1, i]], rows["q_m"][:, i], strict=True):
            a = np.exp(-H / T_v) if T_v else 0.0
            v = a * v + (1.0 - a) * (now - before) / H
            velocity.append(v)
        np.testing.assert_allclose(rows["q_dot_m"][1:, i], velocity[1:], rtol=0, atol=1e-11)  # 1 / h of 1, rounded
    x = np.random.default_rng(0).normal(size=(50, 2))
    unit = find_unit("encoder")(planar, T_d=3e-3, bits=48.0)
    rows = sampled(unit, 50, q=lambda t: x[round(t / H)])["q_m"]
    np.testing.assert_allclose(rows[3:], x[:-3], rtol=0, atol=2.0 * np.pi / 2**49 + 4.0 * EPS)  # half a step


@pytest.mark.few(1)
@pytest.mark.parametrize(("delay", "jitter", "loss"), [(2e-3, 0.0, 0.0), (1.5e-3, 6e-3, 0.2), (0.0, 0.0, 0.3)])
def test_communication_gives_the_newest_of_what_has_arrived(planar, delay, jitter, loss):
    n = 400
    unit = find_unit("communication")(planar, T_d=delay, T_j=jitter, loss=loss, seed=5.0)
    rows = sampled(unit, n, tau_c=lambda t: [t, -t])
    numbers, packets, newest, expected = of_seed(5), [], -1, []
    for k in range(n):
        late, luck = next(numbers), next(numbers)
        if luck >= loss:
            packets.append((k, k * H + delay + jitter * late))
        newest = max([newest, *(sent for sent, arrives in packets if arrives <= k * H + 1e-12)])
        packets = [(sent, arrives) for sent, arrives in packets if sent > newest]
        expected.append(newest)
    expected = np.array(expected)
    begun = expected >= 0
    np.testing.assert_allclose(rows["tau"][begun, 0], H * expected[begun], rtol=0, atol=4.0 * n * H * EPS)
    np.testing.assert_allclose(rows["age"][begun], H * (np.arange(n) - expected)[begun], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(rows["tau"][:, 1], -rows["tau"][:, 0])
    lost = np.mean(rows["way"][:, 0] > 1e5)
    assert abs(lost - loss) <= 5.0 * np.sqrt(loss * (1.0 - loss) / n)  # 5 standard deviations of a share


def test_an_actuator_keeps_within_its_rate_torque_and_current(planar):
    unit = find_unit("actuator")(planar, tau_max=[2.0, 9.0], tau_dot_max=500.0, k_t=[0.5, 0.1], i_max=[9.0, 6.0])
    rows = sampled(unit, 40, tau_c=lambda t: [0.0, 0.0] if t < 5e-3 else [3.0, -3.0])
    tau = rows["tau"]
    expected = np.clip(500.0 * H * np.arange(-4, 36), 0.0, None)
    # sums of ten steps of 0.5
    np.testing.assert_allclose(tau[:, 0], np.minimum(expected, 2.0), rtol=0, atol=1e-14)
    np.testing.assert_allclose(tau[:, 1], -np.minimum(expected, 0.6), rtol=0, atol=1e-14)
    np.testing.assert_allclose(rows["i"] * [0.5, 0.1], tau, rtol=0, atol=1e-15)


def test_a_motor_gives_its_peak_until_it_is_warm_and_then_what_it_bears(planar):
    i_max, i_rms, T = 6.0, 2.0, 0.5
    unit = find_unit("actuator")(planar, i_max=i_max, i_rms=i_rms, T_i=T, k_t=0.1)
    rows = sampled(unit, 3000, tau_c=lambda t: [5.0, -0.15])
    i, h = rows["i"], rows["h"]
    until = -T * np.log(1.0 - i_rms**2 / i_max**2)
    assert np.flatnonzero(i[:, 0] < i_max)[0] * H == pytest.approx(until, abs=H)
    assert (h <= i_rms**2 * (1.0 + 8.0 * EPS)).all()
    np.testing.assert_allclose(i[-100:, 0], i_rms, rtol=1e-12)  # sqrt of sums that are rounded, over 1 - a = 2e-3
    np.testing.assert_allclose(i[:, 1], -1.5, rtol=1e-15)  # below i_rms nothing is cut
    t = H * np.arange(1, 3001)
    np.testing.assert_allclose(h[:, 1], 1.5**2 * (1.0 - np.exp(-t / T)), rtol=1e-12)  # 3000 roundings of sums


def braked(planar, load, v, tau_b, late=0):
    """Return the rows of a rotor, held over each period, under a brake that acts `late` samples later, and a load."""
    unit = find_unit("emergency_stop")(planar, tau_b=tau_b, T_b=0.0, t_stop=0.0)
    inertia = unit.robot.I_m
    x, v, rows, torques = np.zeros(2), np.array(v), [], [np.zeros(2)] * late
    for k in range(1500):
        unit.t, unit.kappa, unit.kappa_dot = k * H, x, v
        if k == 0:
            unit.start()
        unit.update()
        torques.append(unit.tau)
        a = (torques[-1 - late] + load) / inertia
        rows.append(np.concatenate([x, v, unit.tau]))
        x, v = x + H * v + 0.5 * H * H * a, v + H * a
    return np.array(rows), inertia


@pytest.mark.few(1)
@pytest.mark.parametrize("late", [0, 1])
def test_a_brake_slows_down_by_its_torque_and_holds_without_creep(planar, late):
    load, tau_b, v = np.array([0.1, -0.05]), np.array([0.3, 0.4]), np.array([20.0, -30.0])
    rows, inertia = braked(planar, load, v, tau_b, late)
    x, speed, tau = rows[:, :2], rows[:, 2:4], rows[:, 4:]
    assert (np.abs(tau) <= tau_b).all()
    slips = speed[5:8] - speed[4:7]
    np.testing.assert_allclose(slips, np.tile(H * (load - np.sign(v) * tau_b) / inertia, (3, 1)), rtol=1e-10)
    # at rest, where the poles of K and D, of 0.89 at most, have left nothing after 500 samples: 0.89^500 = 5e-26
    assert np.ptp(x[-100:], axis=0).max() < 1e-12
    np.testing.assert_allclose(tau[-1], -load, rtol=0, atol=1e-10)
    unloaded, _ = braked(planar, load, [0.0, 0.0], tau_b, late)
    turned = unloaded[-1, :2]
    np.testing.assert_allclose(turned, load / (0.05 * inertia / H**2), rtol=1e-9)


def test_an_overloaded_brake_slips_and_a_stop_is_remembered(planar):
    rows, inertia = braked(planar, np.array([0.5, 0.0]), [0.0, 0.0], 0.3)
    np.testing.assert_allclose(np.diff(rows[-3:, 2]) / H, 0.2 / inertia[0], rtol=1e-8)
    unit = find_unit("emergency_stop")(planar, T_b=3e-3)
    signals = sampled(unit, 12, tau_c=lambda t: [1.0, 1.0], stop=lambda t: float(round(t / H) == 4))
    assert signals["phase"].tolist() == [0.0] * 4 + [1.0] * 3 + [2.0] * 5
    assert signals["tau"][:, 0].tolist() == [1.0] * 4 + [0.0] * 8  # nothing moves
    timed = sampled(find_unit("emergency_stop")(planar, T_b=3e-3, t_stop=4e-3), 12, tau_c=lambda t: [1.0, 1.0])
    assert np.array_equal(timed["phase"], signals["phase"])


@pytest.mark.parametrize(("unit", "values", "message"), [
    ("encoder", {"T_d": 0.0151}, r"T_d up to 15 periods; .*, got T_d = 0.0151 s, period = 0.001 s"),
    ("encoder", {"bits[2]": 17.5}, r"whole numbers, got bits\[1\] = 17, bits\[2\] = 17.5"),
    (
        "communication", {"T_d": 0.01, "T_j": 0.006},
        r"T_d \+ T_j up to 15 periods; .*, got T_d = 0.01 s, T_j = 0.006 s, period = 0.001 s",
    ),
    ("communication", {"seed": 0.5}, "whole number"),
    ("torque_sensor", {"seed": 1.5}, "whole number"),
])  # fmt: skip
def test_what_cannot_be_is_refused(planar, tmp_path, unit, values, message):
    with pytest.raises((FmuError, UsageError), match=message):
        build_fmus(planar, tmp_path, units=[unit], parameters={unit: values}, folded=True)


SYSTEM = """extends = "system"
name = "devices"
description = "An arm behind an encoder, a link and an actuator"
[components]
encoder = "encoder"
communication = "communication"
actuator = "actuator"
brake = "emergency_stop"
[connections]
"plant.q" = ["encoder.q"]
"encoder.q_m" = ["controller.q"]
"controller.tau" = ["communication.tau_c"]
"communication.tau" = ["actuator.tau_c"]
"actuator.tau" = ["brake.tau_c"]
"brake.tau" = ["plant.tau"]
"plant.kappa" = ["brake.kappa"]
"plant.kappa_dot" = ["brake.kappa_dot"]
"""


def written(folder):
    (folder / "system.toml").write_text(SYSTEM)
    scenario = load_scenario("planar_tracking")
    text = (scenario.system.path.parent.parent / "models" / "scenarios" / "planar_tracking.toml").read_text()
    path = folder / "run.toml"
    path.write_text(text.replace('robot = "', 'system = "system.toml"\nrobot = "'))
    return path


@pytest.mark.heavy
def test_a_system_with_devices_equals_its_references_and_stops(tmp_path):
    """What a file feeds takes the place of what fed it in the system that it extends."""
    settings = {
        "encoder.bits": 30.0, "communication.loss": 0.1, "communication.T_d": 0.0, "communication.T_j": 1e-3,
        "brake.t_stop": 0.6,
    }  # fmt: skip
    results = vdfmu.run(written(tmp_path), stop=0.8, parameters=settings, out=False, record=["plant.tau[*]"])
    assert (
        results.summary["reference"]["sampled"]["max_position_difference_rad"] < 1e-8
    )  # a tenth of the solver's tolerance
    assert np.array_equal(results["brake.tau"], results["plant.tau"])
    assert np.abs(results["plant.kappa_dot"][600]).max() > 0.3
    assert results["brake.phase"][-1] == 2.0
    assert np.abs(results["plant.kappa_dot"][-1]).max() < 0.1  # the links still swing on their springs


@pytest.mark.heavy
def test_a_loop_that_a_stop_has_opened_has_the_margins_of_no_loop(tmp_path):
    package = write_ssp(loaded := load_scenario(written(tmp_path)), cached_fmus(loaded, tmp_path), tmp_path / "x.ssp")
    for stop, modulus in ((0.2, 1.0), (100.0, None)):  # between stop and brakes no torque depends on anything
        system = linear_system(package, 0.22, parameters={"brake.t_stop": stop})
        margin = system_loop(system, ["plant.tau"]).modulus
        assert (margin == modulus).all() if modulus else (margin < 0.9).all()
