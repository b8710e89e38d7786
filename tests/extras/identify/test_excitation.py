"""Sweeps and multisines: no jump up to the fourth derivative, their frequencies, limits kept, and their files."""

import numpy as np
import pytest

import vdfmu
from tests.arm.motion.files import require_read, writer
from tests.arm.motion.jumps import jumps, rounding
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.extras.identify.excitation import multisine, sweep

TABLES = {
    "fastest": "points = [[0, 0], [0.5, 0.2], [0.3, 0.4]]\nvelocity = 1.0\nacceleration = 2\ntorque = 30",
    "sweep": 'start = [0, 0]\namplitude = [0.1, 0]\nfrequencies = [0.5, 2]\nduration = 4\nlaw = "linear"',
    "multisine": 'start = [0, 0]\namplitude = 0.1\nlines = [1, 3]\nperiod = 2\nphases = "random"\nseed = 3',
}


@pytest.fixture
def written(tmp_path):
    return writer(tmp_path)


@pytest.mark.parametrize("kind", TABLES)
def test_each_kind_is_read(kind, robot, written):
    require_read(written, kind, TABLES[kind], robot)


@pytest.mark.parametrize(("text", "words"), [
    ('kind = "multisine"\nlines = [1, 2.5]', "motion.lines: expected whole numbers"),
    ('kind = "multisine"\nperiod = [2]', "motion.period: expected one number"),
    (f'kind = "sweep"\n{TABLES["sweep"]}'.replace("[0.5, 2]", "[1, 2, 3]"), "frequencies: expected two above 0 Hz"),
    (f'kind = "sweep"\n{TABLES["sweep"]}'.replace("0.5, 2", "1, 1e9"), "expected at most 1736 periods"),
    (f'kind = "sweep"\n{TABLES["sweep"]}'.replace("duration = 4", "duration = 0"), "duration: expected more than"),
    (TABLES["sweep"].join(['kind = "sweep"\n', '\nphases = "x"']), "motion.phases: expected a known key"),
])  # fmt: skip
def test_problems_of_a_table_are_named(robot, written, text, words):
    with pytest.raises(ModelError) as caught:
        vdfmu.load_motion(written(text), robot)
    assert words in str(caught.value)


def test_no_derivative_up_to_the_fourth_jumps_and_they_rest_at_both_ends():
    for motion in (sweep([0.1, 0.2], 0.1, (0.5, 5.0), 4.0), multisine([0.1, 0.2], 0.1, [1, 3, 5], 2.0)):
        assert np.all(jumps(motion) < rounding(motion))
        assert np.all(rounding(motion)[1:] < 1e-3 * motion.peaks.max(axis=1))  # so that a jump would show
        assert np.abs(motion.at(0.0)[1:]).max() == 0.0


@pytest.mark.parametrize("phases", ["schroeder", "random"])
def test_a_multisine_has_the_lines_asked_for_and_no_others(phases):
    lines, period, n = [1, 2, 5, 9], 4.0, 512
    motion = multisine([0.1, -0.2, 0.3], [0.2, 0.1, 0.0], lines, period, periods=2, phases=phases)
    assert motion.duration == 16.0 and motion.closed
    t = period + period * np.arange(n) / n
    spectrum = 2.0 / n * np.abs(np.fft.rfft(motion.at(t)[0], axis=0))
    amplitudes = spectrum[lines]
    # Knots 1/24 of the shortest period apart: the error of a spline of degree 5 is some h^6/30000 of the sixth
    # derivative, (2 pi / 24)^6 / 30000 = 1e-8 of an amplitude, and its ends add as much.
    assert np.abs(amplitudes - amplitudes[0]).max() < 1e-6 * amplitudes.max()
    assert np.delete(spectrum, [0, *lines], axis=0).max() < 1e-6 * amplitudes.max()
    assert spectrum[1:, 2].max() < 1e-15  # of a joint without amplitude: the rounding of the transform
    deviation = np.abs(motion.at(np.linspace(period, 3.0 * period, 40_001))[0] - [0.1, -0.2, 0.3]).max(axis=0)
    # the peak is found at 24 points of the shortest period: (pi / 24)^2 / 2 = 0.9 % of the fastest line at most
    assert deviation == pytest.approx([0.2, 0.1, 0.0], rel=0.01)


def test_amplitudes_shrink_to_keep_limits_and_say_so():
    motion = multisine([0.0, 1.0], 0.2, [1, 4], 2.0, velocity=[10.0, 0.5], acceleration=[10.0, 100.0])
    assert motion.peaks[1, 0] == pytest.approx(10.0, rel=1e-12)  # scaled by this number
    assert motion.peaks[0, 1] == pytest.approx(0.5, rel=1e-12)
    assert [note.split(":")[0] for note in motion.notes] == ["joint 1", "joint 2"]
    assert motion.start == pytest.approx([0.0, 1.0], abs=0.0)


@pytest.mark.parametrize(("keys", "words"), [
    ({"lines": [2, 2]}, "lines: expected whole numbers of at least 1, each once"),
    ({"periods": np.nan}, "periods: expected a whole number"),
    ({"seed": -1}, "seed: expected a whole number of at least 0"),
    ({"seed": np.nan}, "seed: expected a whole number, got nan"),
    ({"start": []}, "start: expected a position for each joint"),
    ({"amplitude": np.inf}, "amplitude: expected a number above 0"),
])  # fmt: skip
def test_a_multisine_that_does_not_fit_is_named(keys, words):
    with pytest.raises(UsageError, match=words):
        multisine(**({"start": [0.0], "amplitude": 0.1, "lines": [1, 2], "period": 1.0} | keys))


@pytest.mark.parametrize("law", ["linear", "logarithmic"])
def test_a_sweep_goes_from_one_frequency_to_the_other(law):
    first, last, T = 1.0, 8.0, 10.0
    motion = sweep([0.0], 0.1, (first, last), T, law=law)
    t = np.linspace(0.1 * T, 0.9 * T, 200_001)
    q = motion.at(t)[0][:, 0]
    crossings = t[1:][(q[:-1] < 0.0) & (q[1:] >= 0.0)]
    frequency = 1.0 / np.diff(crossings)
    middle = 0.5 * (crossings[1:] + crossings[:-1])
    if law == "linear":
        expected = first + (last - first) * middle / T
    else:
        expected = first * (last / first) ** (middle / T)
    # crossings are found to 4e-5 s of periods of at least 0.125 s; the mean over a period differs by curvature, < 1 %
    assert frequency == pytest.approx(expected, rel=0.01)
    with pytest.raises(UsageError, match="frequencies: expected two above 0 Hz"):
        sweep([0.0], 0.1, (0.0, 1.0), 1.0)
