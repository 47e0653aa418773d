"""Assembling postures from messages, and the staleness of the whole, in plain time."""

import math

import numpy as np
import pytest
from support import parameter_values

from kinopt_ros.monitor.configuration import Configuration
from kinopt_ros.monitor.posture import BadJointStateError, PostureAssembler
from kinopt_ros.monitor.posture_monitor import PostureMonitor
from kinopt_ros.monitor.verdict import Level

NAMES = ('a', 'b', 'c')
TIMEOUT = 0.5


@pytest.fixture
def assembler():
    return PostureAssembler(NAMES)


@pytest.fixture
def monitor():
    return PostureMonitor(Configuration.from_parameters(parameter_values()), 100.0)


def test_complete_message(assembler):
    assert assembler.update(list('cxab'), [3.0, math.nan, 1.0, 2.0], 0.0, TIMEOUT) == (1, 2, 3)


def test_foreign_message(assembler):
    assert assembler.update(['x'], [1.0], 0.0, TIMEOUT) is None
    assert assembler.late_joints(0.0, TIMEOUT) == NAMES


def test_parts_and_ages(assembler):
    assert assembler.update(['a'], [1.0], 0.0, TIMEOUT) is None
    assert assembler.update(['b'], [2.0], 0.25, TIMEOUT) is None
    assert assembler.update(['c'], [3.0], 0.5, TIMEOUT) == (1, 2, 3)
    # Exactly as old as allowed is not older.
    assert assembler.update(['a'], [4.0], 0.75, TIMEOUT) == (4, 2, 3)
    assert assembler.update(['a'], [5.0], 0.8125, TIMEOUT) is None
    assert assembler.late_joints(0.8125, TIMEOUT) == ('b',)
    assert assembler.late_joints(1.0625, TIMEOUT) == ('b', 'c')
    assert assembler.update(['b', 'c'], [6.0, 7.0], 1.25, TIMEOUT) == (5, 6, 7)


@pytest.mark.parametrize('names, positions, joint', [
    (['a', 'b', 'c'], [0.0, math.nan, 0.0], 'b'),
    (['a', 'b', 'c'], [0.0, math.inf, math.nan], 'b'),
    (['a', 'b', 'a'], [0.0, 0.0, 0.0], 'a'),
    (['c'], [], 'c'),
    (['a', 'b', 'c'], [0.0, 0.0], 'c'),
    (['b', 'b', 'x'], [math.nan], 'b'),
])
def test_bad_message_names_the_joint(assembler, names, positions, joint):
    with pytest.raises(BadJointStateError) as error:
        assembler.update(names, positions, 0.0, TIMEOUT)
    assert error.value.joint == joint
    assert f"'{joint}'" in str(error.value)


def test_bad_message_changes_no_joint_that_it_does_not_name(assembler):
    assembler.update(list(NAMES), [1.0, 2.0, 3.0], 0.0, TIMEOUT)
    with pytest.raises(BadJointStateError):
        assembler.update(['a'], [math.nan], 0.1, TIMEOUT)
    assert assembler.update(['a'], [4.0], 0.2, TIMEOUT) == (4, 2, 3)


def test_order_of_names_may_change_at_every_message(assembler):
    rng = np.random.default_rng(0)
    names = np.array(['a', 'b', 'c', 'x', 'y'])
    positions = np.arange(5.0)
    for i in range(100):
        order = rng.permutation(5)
        posture = assembler.update(
            names[order].tolist(), positions[order].tolist(), float(i), TIMEOUT)
        assert posture == (0.0, 1.0, 2.0)


def test_list_of_names_reused_by_the_caller(assembler):
    """The cached order must not follow a list that the caller changes in place."""
    names = ['a', 'b', 'c']
    assembler.update(names, [1.0, 2.0, 3.0], 0.0, TIMEOUT)
    names.reverse()
    assert assembler.update(names, [3.0, 2.0, 1.0], 0.1, TIMEOUT) == (1, 2, 3)


def reference(events, timeout):
    """Tell, message by message, what the contract says of a random run; times are exact."""
    known = {}
    for now, names, positions in events:
        ours = [name for name in names if name in NAMES]
        if not ours:
            yield None
        elif (len(set(ours)) < len(ours) or len(positions) < len(names)
              or not all(math.isfinite(p) for n, p in zip(names, positions) if n in NAMES)):
            # Joints of a bad message have no reading that is known to be their latest.
            for name in ours:
                known.pop(name, None)
            yield 'bad'
        else:
            known.update((n, (p, now)) for n, p in zip(names, positions) if n in NAMES)
            fresh = all(n in known and now - known[n][1] <= timeout for n in NAMES)
            yield tuple(known[n][0] for n in NAMES) if fresh else None


@pytest.mark.parametrize('seed', range(20))
def test_random_runs_against_a_plain_reference(seed):
    rng = np.random.default_rng(seed)
    events, now = [], 0.0
    for _ in range(300):
        now += float(rng.integers(0, 6)) / 32.0
        names = rng.choice(['a', 'b', 'c', 'x'], rng.integers(0, 5),
                           replace=bool(rng.random() < 0.1)).tolist()
        positions = rng.normal(size=len(names)).tolist()
        if positions and rng.random() < 0.1:
            positions[rng.integers(len(positions))] = [math.nan, math.inf][rng.integers(2)]
        if rng.random() < 0.05:
            positions = positions[:-1]
        events.append((now, names, positions))
    assembler = PostureAssembler(NAMES)
    outcomes = set()
    for (now, names, positions), expected in zip(events, reference(events, TIMEOUT)):
        try:
            got = assembler.update(names, positions, now, TIMEOUT)
        except BadJointStateError:
            got = 'bad'
        assert got == expected, (now, names, positions)
        outcomes.add(got if got in (None, 'bad') else 'posture')
    assert outcomes == {None, 'bad', 'posture'}


def test_stale_once_from_the_start_on(monitor):
    assert monitor.verdict.level == Level.STALE
    assert monitor.verdict.near_singularity
    assert monitor.on_time(100.49) is None
    verdict = monitor.on_time(100.51)
    assert verdict.level == Level.STALE and verdict.near_singularity
    assert math.isnan(verdict.index.z)
    assert monitor.on_time(100.6) is None
    assert monitor.on_time(1e9) is None


def test_stale_after_the_last_accepted_posture(monitor):
    assert monitor.on_joint_state(list(NAMES), [0.0, 1.0, 2.0], 101.0).level == Level.OK
    assert monitor.on_time(101.4) is None
    assert monitor.on_joint_state(list(NAMES), [0.0, 1.0, 2.0], 101.4).level == Level.OK
    assert monitor.on_time(101.8) is None
    assert monitor.on_time(101.91).level == Level.STALE
    assert monitor.on_joint_state(list(NAMES), [0.0, 1.0, 2.0], 102.0).level == Level.OK
    assert monitor.on_time(102.51).level == Level.STALE


def test_time_to_stale_is_of_the_last_accepted_posture(monitor):
    monitor.on_joint_state(list(NAMES), [0.0, 1.0, 2.0], 101.0)
    monitor.on_joint_state(['x'], [0.0], 101.2)
    monitor.on_joint_state(['a', 'b'], [0.0, math.nan], 101.3)
    assert monitor.time_to_stale(101.3) == pytest.approx(0.2)


def test_no_numbers_survive_a_bad_message(monitor):
    monitor.on_joint_state(list(NAMES), [0.0, 1.0, 2.0], 101.0)
    verdict = monitor.on_joint_state(['b'], [math.nan], 101.1)
    assert verdict.level == Level.ERROR and verdict.near_singularity
    assert all(math.isnan(value) for value in verdict.index)
    assert monitor.verdict is verdict
    assert all(math.isnan(angle) for angle in monitor.joint_angles)
    assert (monitor.accepted, monitor.rejected) == (1, 1)


# --- a pause of the whole process -----------------------------------------------------------

PAUSE_END = 130.0


@pytest.fixture
def resumed(monitor):
    """Give a monitor that judged messages stamped 1000 s ahead, then stood for 29 s."""
    monitor.look(100.5)
    monitor.on_joint_state(list(NAMES), [0.0, 1.0, 2.0], 100.9, stamp=1100.9)
    monitor.look(101.0)
    monitor.on_joint_state(list(NAMES), [0.0, 1.0, 2.0], 101.0, stamp=1101.0)
    assert monitor.look(PAUSE_END).level == Level.STALE
    return monitor


@pytest.mark.parametrize('age', [28.9, 20.0, 10.0, TIMEOUT + 0.01])
def test_message_that_waited_in_a_pause_is_not_believed(resumed, age):
    """However late in the pause it was sent: it is older than the time-out."""
    stamp = PAUSE_END - age + 1000.0
    assert resumed.on_joint_state(list(NAMES), [0.0, 1.0, 2.0], PAUSE_END, stamp=stamp) is None
    assert resumed.verdict.level == Level.STALE


def test_fresh_message_is_believed_at_once_after_a_pause(resumed):
    now = PAUSE_END + 0.01
    verdict = resumed.on_joint_state(list(NAMES), [0.0, 1.0, 2.0], now, stamp=now + 1000.0)
    assert verdict.level == Level.OK


def test_message_without_stamp_waits_until_things_have_settled(resumed):
    for now, level in ((PAUSE_END + 0.05, None), (PAUSE_END + 0.11, Level.OK)):
        verdict = resumed.on_joint_state(list(NAMES), [0.0, 1.0, 2.0], now)
        assert (verdict and verdict.level) == level


def test_slow_clock_of_one_publisher_does_not_excuse_what_another_sent(resumed):
    """A part's stamps are 900 s behind the other's; those of the other waited in the pause."""
    now = PAUSE_END + 1.0
    resumed.on_joint_state(list(NAMES), [0.0, 1.0, 2.0], now, stamp=now + 1000.0)
    resumed.on_joint_state(['c'], [2.0], now, stamp=now + 100.0)
    assert resumed.look(now + 20.0).level == Level.STALE
    waited = now + 10.0 + 1000.0
    assert resumed.on_joint_state(list(NAMES), [0.0, 1.0, 2.0], now + 20.0, stamp=waited) is None


def test_what_waited_in_a_pause_before_the_first_posture_is_not_believed(monitor):
    monitor.look(100.4)
    assert monitor.look(PAUSE_END).level == Level.STALE
    assert monitor.on_joint_state(
        list(NAMES), [0.0, 1.0, 2.0], PAUSE_END, stamp=1.7e9) is None
