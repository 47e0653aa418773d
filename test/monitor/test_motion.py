"""Joint rates from stamped positions, and what they say of the way to a threshold."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from support import expected_numbers, LENGTHS, parameter_values

from kinopt_ros.kinetostatics.gradient import index_gradient, IndexGradient
from kinopt_ros.kinetostatics.index import kinetostatic_index, KinetostaticIndex
from kinopt_ros.kinetostatics.planar_arm import PlanarArm
from kinopt_ros.monitor.configuration import Configuration
from kinopt_ros.monitor.motion import (
    LONGEST_GAP,
    LONGEST_TIME,
    motion_at,
    PositionHistory,
    Trend,
    WINDOW,
)
from kinopt_ros.monitor.posture_monitor import PostureMonitor
from kinopt_ros.monitor.verdict import Thresholds

RATES = np.array([0.5, -1.2, 0.03])


def history_of(stamps, positions):
    history = PositionHistory()
    for stamp, position in zip(stamps, positions):
        history.add(stamp, tuple(position))
    return history


def positions_at(times, rates=RATES):
    return np.outer(times, rates) + [0.4, 2.0, -1.0]


def test_constant_rates_are_exact():
    times = 1.7e9 + 0.01 * np.arange(100)
    rates = history_of(times, positions_at(times - 1.7e9)).joint_rates()
    # Stamps of today resolve 0.24 microseconds as floats.
    np.testing.assert_allclose(rates, RATES, rtol=1e-5)


@pytest.mark.parametrize('period', [0.001, 0.008, 0.05, 0.3, 0.9])
def test_any_publishing_rate(period):
    times = period * np.arange(round(1.0 / period) + 3)
    rates = history_of(times, positions_at(times)).joint_rates()
    np.testing.assert_allclose(rates, RATES, rtol=1e-9)


def test_unknown_until_the_positions_span_half_the_window():
    history = PositionHistory()
    assert history.joint_rates() is None
    known = []
    for stamp in 0.01 * np.arange(20):
        history.add(stamp, tuple(positions_at([stamp])[0]))
        known.append(history.joint_rates() is not None)
    # The rounding of 0.05 may fall to either side.
    assert known.index(True) in (5, 6)
    assert all(known[6:])
    assert 0.05 == 0.5 * WINDOW


def test_no_older_than_the_window_and_a_sample():
    """After a stop the rates are zero as soon as a window has passed."""
    times = 0.01 * np.arange(200)
    moving = positions_at(np.minimum(times, 1.0))
    history = PositionHistory()
    for stamp, position in zip(times, moving):
        history.add(stamp, tuple(position))
        if stamp > 1.0 + WINDOW + 0.011:
            assert history.joint_rates() == [0.0, 0.0, 0.0]
        elif 0.06 < stamp <= 1.0:
            np.testing.assert_allclose(history.joint_rates(), RATES, rtol=1e-9)


def test_repeated_samples():
    """Every so often a driver repeats the last positions under a new stamp."""
    rng = np.random.default_rng(17)
    period = 0.008
    times = period * np.arange(2000)
    positions = positions_at(times)
    repeated = rng.random(len(times)) < 0.17
    for i in range(1, len(times)):
        if repeated[i]:
            positions[i] = positions[i - 1]
    history, errors = PositionHistory(), []
    for i, (stamp, position) in enumerate(zip(times, positions)):
        history.add(stamp, tuple(position))
        if i > 20:
            errors.append(np.array(history.joint_rates()) / RATES - 1.0)
    errors = np.array(errors)
    # Each end of the window lags by the samples repeated there: one makes 8 %, in rows of them
    # more; no row of this seed is longer than 4.
    assert 0.16 < repeated.mean() < 0.18
    assert np.abs(errors).max() < 4.5 * period / WINDOW
    assert np.sqrt(np.mean(errors ** 2)) < 0.06
    assert abs(errors.mean()) < 0.005


def test_repeated_messages():
    """A message that comes twice with one stamp tells nothing new."""
    times = 0.01 * np.arange(100)
    twice = np.repeat(times, 2)
    rates = history_of(twice, positions_at(twice)).joint_rates()
    np.testing.assert_allclose(rates, RATES, rtol=1e-9)


def test_jitter_in_the_stamps():
    rng = np.random.default_rng(5)
    times = 0.01 * np.arange(1000)
    stamps = times + rng.normal(0.0, 0.001, len(times))
    history, errors = PositionHistory(), []
    for stamp, position in zip(stamps, positions_at(times)):
        history.add(stamp, tuple(position))
        if stamp > 0.2:
            errors.append(history.joint_rates()[0] / RATES[0] - 1.0)
    # Two ends with 1 ms each in 0.1 s: 1.4 %.
    assert np.std(errors) == pytest.approx(math.sqrt(2.0) * 0.001 / WINDOW, rel=0.25)
    assert np.max(np.abs(errors)) < 0.07


def test_standing_stamps_give_no_rates():
    positions = positions_at(0.01 * np.arange(50))
    assert history_of(np.full(50, 3.0), positions).joint_rates() is None
    assert history_of(np.zeros(50), positions).joint_rates() is None


def test_stamps_that_stand_still_for_a_while():
    """The positions that came under the standing stamp are not taken for a jump."""
    times = 0.01 * np.arange(100)
    stamps = times.copy()
    stamps[60:70] = stamps[60]
    history = PositionHistory()
    for stamp, position in zip(stamps, positions_at(times)):
        history.add(stamp, tuple(position))
        if history.joint_rates() is not None:
            np.testing.assert_allclose(history.joint_rates(), RATES, rtol=1e-9)


@pytest.mark.parametrize('jump', [-0.001, -1e9, LONGEST_GAP + 0.01, 1e9])
def test_stamps_that_jump_start_it_again(jump):
    times = 0.01 * np.arange(60)
    stamps = 5.0 + times + np.where(np.arange(60) < 30, 0.0, jump - 0.01)
    history, known = PositionHistory(), []
    for stamp, position in zip(stamps, positions_at(times)):
        history.add(stamp, tuple(position))
        rates = history.joint_rates()
        known.append(rates is not None)
        if rates is not None:
            np.testing.assert_allclose(rates, RATES, rtol=1e-4)
    assert known[29] and not any(known[30:35]) and all(known[37:])


@pytest.mark.parametrize('stamp', [math.nan, math.inf])
def test_stamp_that_is_no_number_gives_no_rates(stamp):
    history = history_of([0.0, 0.1, stamp], positions_at([0.0, 0.1, 0.2]))
    assert history.joint_rates() is None


def test_forgets():
    history = history_of([0.0, 0.1], positions_at([0.0, 0.1]))
    history.clear()
    assert history.joint_rates() is None


@pytest.mark.parametrize('turn', [2.0 * math.pi, -2.0 * math.pi, 4.0 * math.pi])
def test_continuous_joint_that_wraps(turn):
    times = 0.01 * np.arange(100)
    for start in range(85, 100):
        positions = positions_at(times)
        positions[start:, 1] += turn
        np.testing.assert_allclose(history_of(times, positions).joint_rates(), RATES, rtol=1e-9)


def slow(z_slope, margin_slope, z=0.5, margin=0.3, thresholds=None, rate=1.0):
    gradient = IndexGradient(np.array([0.0, z_slope]), np.array([0.0, margin_slope]))
    return motion_at(KinetostaticIndex(z, 1.0, margin), gradient, [7.0, rate],
                     thresholds or Thresholds(z_max=0.9, margin_min=0.05))


@pytest.mark.parametrize('slopes, trend, time', [
    ((0.1, -0.1), Trend.APPROACHING, 2.5), ((0.1, 0.1), Trend.APPROACHING, 4.0),
    ((0.1, -0.05), Trend.APPROACHING, 4.0), ((-0.1, -0.1), Trend.APPROACHING, 2.5),
    ((0.0, -0.1), Trend.APPROACHING, 2.5), ((-0.1, 0.1), Trend.LEAVING, None),
    ((0.0, 0.1), Trend.LEAVING, None), ((0.0, 0.0), Trend.STEADY, None),
    ((9e-4, -9e-4), Trend.STEADY, None)])
def test_trend_and_time_by_hand(slopes, trend, time):
    motion = slow(*slopes)
    assert (motion.z_rate, motion.margin_rate) == slopes
    assert motion.trend is trend
    if time is None:
        assert math.isnan(motion.time_to_threshold)
    else:
        assert motion.time_to_threshold == pytest.approx(time)


def test_time_is_capped():
    assert slow(0.0, -0.0011).time_to_threshold == LONGEST_TIME == 60.0
    assert slow(0.0, -0.25 / 59.0).time_to_threshold == pytest.approx(59.0)


def test_time_is_0_beyond_a_threshold():
    assert slow(0.1, -0.1, margin=0.04).time_to_threshold == 0.0
    assert slow(0.1, 0.1, z=0.95).time_to_threshold == 0.0
    assert math.isnan(slow(-0.1, 0.1, z=0.95, margin=0.01).time_to_threshold)


@pytest.mark.parametrize('rate', [math.inf, math.nan, 1e308])
def test_rates_beyond_numbers_are_unknown(rate):
    motion = slow(10.0, -10.0, rate=rate)
    assert motion.trend is Trend.UNKNOWN
    assert math.isnan(motion.time_to_threshold)


# A crossing at constant joint rates: the elbow stretches while the wrist turns.
START = np.array([0.3, 1.5, 1.0])
TURN = np.array([0.4, -1.0, 0.2])
CROSSING = 1.5
LIMITS = Thresholds(z_max=1.0, margin_min=0.05)


def posture_at(t):
    return (START + TURN * t).tolist()


def threshold_time():
    """Time at which the margin reaches the threshold, by the oracle's singular values."""
    return brentq(lambda t: expected_numbers(LENGTHS, posture_at(t)).margin - LIMITS.margin_min,
                  0.5, CROSSING, xtol=1e-13)


def monitor(**changes):
    values = parameter_values(
        link_lengths=LENGTHS, z_max=LIMITS.z_max, margin_min=LIMITS.margin_min,
        stale_timeout=10.0, **changes)
    return PostureMonitor(Configuration.from_parameters(values), 0.0)


def motions(watch, times, velocities=(), delay=0.0):
    for t in times:
        watch.on_joint_state(['a', 'b', 'c'], posture_at(t), t + delay, velocities, t)
        yield t, watch.motion()


def test_predicted_time_converges_to_the_true_crossing():
    arm, crossing = PlanarArm(LENGTHS), threshold_time()
    errors = []
    for remaining in (0.4, 0.2, 0.1, 0.05, 0.025):
        posture = posture_at(crossing - remaining)
        motion = motion_at(kinetostatic_index(arm, posture), index_gradient(arm, posture),
                           TURN.tolist(), LIMITS)
        assert motion.trend is Trend.APPROACHING
        errors.append(abs(motion.time_to_threshold - remaining))
    # First order: half the distance, a quarter of the error.
    ratios = np.array(errors[:-1]) / errors[1:]
    assert np.all((ratios > 3.0) & (ratios < 5.0)), ratios
    assert errors[-1] < 0.01 * 0.025


@pytest.mark.parametrize('velocities, tolerance', [(TURN.tolist(), 0.0), ((), 0.01)])
def test_crossing_seen_by_the_monitor(velocities, tolerance):
    """Alike from velocities and from positions alone; the prediction is of first order."""
    crossing = threshold_time()
    watch = monitor()
    for t, motion in motions(watch, np.arange(0.0, 2.0, 0.01), velocities):
        if t < 0.1:
            continue
        expected = Trend.APPROACHING if t < CROSSING else Trend.LEAVING
        if abs(t - CROSSING) > 0.011:
            assert motion.trend is expected, t
        assert watch.verdict.near_singularity == (t > crossing) or t > CROSSING
        if crossing < t < CROSSING - 0.011:
            assert motion.time_to_threshold == 0.0
        elif crossing - 0.2 < t < crossing:
            remaining = crossing - t
            assert motion.time_to_threshold == pytest.approx(
                remaining, rel=tolerance + 0.35 * remaining)
        elif t > CROSSING + 0.011:
            assert math.isnan(motion.time_to_threshold)


def test_rates_are_the_derivatives_of_the_index():
    watch = monitor()
    h = 1e-5
    for t, motion in motions(watch, [0.1, 0.6, 1.2, 1.8], TURN.tolist()):
        after, before = (expected_numbers(LENGTHS, posture_at(t + s)) for s in (h, -h))
        assert motion.z_rate == pytest.approx((after.z - before.z) / (2 * h), rel=1e-7)
        assert motion.margin_rate == pytest.approx(
            (after.margin - before.margin) / (2 * h), rel=1e-7)


def test_directions_apply_to_the_rates():
    """The arm is the same when a joint is measured the other way round."""
    mirrored = monitor(joint_directions=[1, -1, 1], joint_offsets=[0.0, 0.5, -0.2])
    plain = monitor()
    position = posture_at(0.8)
    plain.on_joint_state(['a', 'b', 'c'], position, 0.0, TURN.tolist(), 0.0)
    measured = [position[0], -(position[1] - 0.5), position[2] + 0.2]
    mirrored.on_joint_state(['a', 'b', 'c'], measured, 0.0, [TURN[0], -TURN[1], TURN[2]], 0.0)
    assert mirrored.motion().z_rate == pytest.approx(plain.motion().z_rate, rel=1e-12)
    assert mirrored.motion().margin_rate == pytest.approx(plain.motion().margin_rate, rel=1e-12)


def test_velocities_of_some_joints_are_no_velocities():
    """With one joint's velocity missing all rates come from positions."""
    watch = monitor()
    for _ in motions(watch, np.arange(0.0, 0.3, 0.01)):
        pass
    from_positions = watch.motion()
    other = monitor()
    for _ in motions(other, np.arange(0.0, 0.3, 0.01), [99.0, math.nan, 99.0]):
        pass
    assert other.motion() == from_positions
    assert from_positions.trend is Trend.APPROACHING


def test_unknown_without_posture_or_rates():
    watch = monitor()
    assert watch.motion().trend is Trend.UNKNOWN
    watch.on_joint_state(['a', 'b', 'c'], posture_at(0.0), 0.0, (), 0.0)
    assert watch.motion().trend is Trend.UNKNOWN
    watch.on_joint_state(['a', 'b', 'c'], posture_at(0.0), 0.0, TURN.tolist(), 0.0)
    assert watch.motion().trend is Trend.APPROACHING
    watch.on_joint_state(['a', 'b', 'c'], [math.nan] * 3, 0.0, TURN.tolist(), 0.0)
    assert watch.motion().trend is Trend.UNKNOWN
    assert watch.gradient() is None


def test_history_does_not_reach_back_over_a_lost_posture():
    watch = monitor()
    for _ in motions(watch, np.arange(0.0, 0.3, 0.01)):
        pass
    watch.on_joint_state(['a', 'b', 'c'], [math.nan] * 3, 0.3)
    watch.on_joint_state(['a', 'b', 'c'], posture_at(0.0), 0.3, (), 0.31)
    assert watch.motion().trend is Trend.UNKNOWN


def test_arm_at_rest_is_steady():
    watch = monitor()
    rng = np.random.default_rng(8)
    for i in range(100):
        noisy = rng.normal(posture_at(0.3), 1e-6).tolist()
        watch.on_joint_state(['a', 'b', 'c'], noisy, 0.01 * i, (), 0.01 * i)
        if i > 10:
            assert watch.motion().trend is Trend.STEADY
