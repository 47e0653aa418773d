"""Split messages, their ages, and silence."""

import math
import time

from builtin_interfaces.msg import Time
import pytest
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from support import (
    assert_numbers,
    assert_unknown,
    expected_numbers,
    ISOTROPIC,
    LENGTHS,
    NAMES,
    REGULAR,
)

OK, WARN, ERROR, STALE = range(4)
# Short for a test's patience, long for a busy machine's scheduler.
TIMEOUT = 0.4


@pytest.fixture
def quick(make_bench):
    """A bench whose posture becomes stale soon."""
    return make_bench({'stale_timeout': TIMEOUT})


def elapsed_until(bench, condition, what):
    start = time.monotonic()
    bench.wait(condition, what)
    return time.monotonic() - start


def test_stale_from_the_start_on(quick):
    assert quick.cycles == []
    assert_unknown(quick.next_cycle(0))
    status = quick.wait_for_level(STALE)
    quick.wait(lambda: 'fresh' in quick.status.message, 'the verdict of the time-out')
    for name in NAMES:
        assert name in quick.status.message
    assert status.name == 'singularity_monitor: posture'


def test_stale_sets_in_once_after_the_timeout(quick):
    start = time.monotonic()
    quick.cycle(REGULAR)
    count = len(quick.cycles)
    assert_unknown(quick.next_cycle(count))
    assert time.monotonic() - start > TIMEOUT
    quick.wait_for_level(STALE)
    quick.linger(2.5 * TIMEOUT)
    assert set(quick.counts.values()) == {count + 1}


def test_timeout_is_kept_closely(quick):
    """The watch looks when the time is up, not at the next tick of some period."""
    late = []
    for _ in range(3):
        # Away from the watch's own ticks.
        quick.linger(0.5 * TIMEOUT)
        quick.cycle(REGULAR)
        count = len(quick.cycles)
        late.append(elapsed_until(
            quick, lambda count=count: len(quick.cycles) > count, 'stale') - TIMEOUT)
    # The least of three: a busy machine may delay one.
    assert -0.05 < min(late) < 0.15


def test_recovery_is_by_itself_and_staleness_sets_in_again(quick):
    for _ in range(2):
        numbers, flag = quick.cycle(REGULAR)
        while math.isnan(numbers.z):
            # Stale may have set in between.
            numbers, flag = quick.cycle(REGULAR)
        assert_numbers(numbers, expected_numbers(LENGTHS, REGULAR))
        assert flag is False
        quick.wait_for_level(OK)
        count = len(quick.cycles)
        assert_unknown(quick.next_cycle(count))
        quick.wait_for_level(STALE)


def test_posture_is_not_stale_while_messages_come(quick):
    end = time.monotonic() + 3.0 * TIMEOUT
    while time.monotonic() < end:
        last = time.monotonic()
        quick.cycle(REGULAR)
        if time.monotonic() - last > 0.5 * TIMEOUT:
            pytest.skip('the machine is too busy to feed the node in time')
    assert not any(math.isnan(numbers.z) for numbers, _ in quick.cycles[1:])


def test_other_robots_messages_do_not_keep_it_fresh(quick):
    quick.cycle(REGULAR)
    count = len(quick.cycles)
    deadline = time.monotonic() + 10.0
    while len(quick.cycles) == count:
        assert time.monotonic() < deadline
        quick.send([1.0, 2.0], ['gripper', 'rail'])
        quick.linger(0.02)
    assert_unknown(quick.cycles[count])


def test_bad_messages_do_not_keep_it_fresh(quick):
    """Silence for the time-out is said although bad messages come all the time."""
    quick.cycle(REGULAR)
    deadline = time.monotonic() + 10.0

    def is_told():
        """Tell whether the silence was said, and the bad message again after it."""
        levels = [array.status[0].level[0] for array in quick.diagnostics]
        silences = [i for i, array in enumerate(quick.diagnostics)
                    if levels[i] == STALE and 'fresh' in array.status[0].message]
        return silences and ERROR in levels[silences[0]:]

    while not is_told():
        assert time.monotonic() < deadline
        quick.send([math.nan] * 3)
        quick.linger(0.05)


def test_parts_make_a_posture(bench):
    bench.send(REGULAR[:1], NAMES[:1])
    bench.send(REGULAR[1:2], NAMES[1:2])
    numbers, _ = bench.cycle(REGULAR[2:], NAMES[2:])
    assert_numbers(numbers, expected_numbers(LENGTHS, REGULAR))
    # From now on each part completes a posture, with the newest values.
    numbers, _ = bench.cycle([2.5, 9.0], ['elbow', 'gripper'])
    assert_numbers(numbers, expected_numbers(LENGTHS, [REGULAR[0], 2.5, REGULAR[2]]))
    assert len(bench.cycles) == 2


def test_ten_parts_in_one_go_do_not_overwrite_each_other(make_bench):
    names = [f'joint_{i}' for i in range(10)]
    lengths = [1.0 / (i + 1) for i in range(10)]
    bench = make_bench({'joint_names': names, 'link_lengths': lengths})
    positions = [0.3 * i for i in range(10)]
    for name, position in zip(names, positions):
        bench.send([position], [name])
    numbers, _ = bench.next_cycle(0)
    assert_numbers(numbers, expected_numbers(lengths, positions))
    assert len(bench.cycles) == 1


def test_incomplete_posture_is_stale_and_names_what_is_missing(quick):
    quick.send(REGULAR[:2], NAMES[:2])
    assert_unknown(quick.next_cycle(0))
    quick.wait(lambda: quick.diagnostics and 'fresh' in quick.status.message, 'stale')
    assert 'wrist' in quick.status.message


def feed_until(bench, condition, names):
    """Publish REGULAR's part of these joints until the condition holds."""
    positions = [REGULAR[NAMES.index(name)] for name in names]
    deadline = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < deadline
        bench.send(positions, names)
        bench.linger(0.02)


def test_one_late_joint_makes_the_posture_stale(quick):
    quick.cycle(REGULAR)
    feed_until(quick, lambda: quick.diagnostics and quick.level == STALE
               and 'fresh' in quick.status.message, ['shoulder', 'elbow'])
    assert 'wrist' in quick.status.message
    assert 'shoulder' not in quick.status.message
    assert 'elbow' not in quick.status.message
    # The parts that go on complete nothing: no number may come.
    count = len(quick.cycles)
    assert_unknown(quick.cycles[-1])
    start = time.monotonic()
    feed_until(quick, lambda: time.monotonic() - start > TIMEOUT, ['shoulder', 'elbow'])
    assert len(quick.cycles) == count
    numbers, _ = quick.cycle(REGULAR[2:], NAMES[2:])
    assert_numbers(numbers, expected_numbers(LENGTHS, REGULAR))


def test_no_joint_of_a_posture_is_older_than_the_timeout(quick):
    """The wrist's part comes once; soon after its age is up no posture is made of it."""
    quick.send(REGULAR[2:], NAMES[2:])
    sent = time.monotonic()
    answered = sent
    while time.monotonic() - sent < 2.0 * TIMEOUT:
        count = len([c for c in quick.cycles if not math.isnan(c[0].z)])
        quick.send(REGULAR[:2], NAMES[:2])
        quick.linger(0.02)
        if len([c for c in quick.cycles if not math.isnan(c[0].z)]) > count:
            answered = time.monotonic()
    assert answered > sent
    assert answered - sent < TIMEOUT + 0.15


def test_staleness_names_the_joints_that_are_late_now(quick):
    """Others fall silent while it is stale: the diagnostics must not go on blaming one."""
    quick.cycle(REGULAR)
    feed_until(quick, lambda: quick.diagnostics and quick.level == STALE
               and 'wrist' in quick.status.message, ['shoulder', 'elbow'])
    quick.wait(lambda: all(name in quick.status.message for name in NAMES), 'all joints late')
    feed_until(quick, lambda: quick.level == STALE and 'wrist' not in quick.status.message
               and 'shoulder' in quick.status.message and 'elbow' in quick.status.message,
               ['wrist'])


def test_timeout_can_be_shortened_while_waiting(bench):
    bench.cycle(REGULAR)
    assert bench.set(stale_timeout=0.05)[0].successful
    assert_unknown(bench.next_cycle(1))
    assert bench.set(stale_timeout=30.0)[0].successful
    assert_numbers(bench.cycle(ISOTROPIC)[0], expected_numbers(LENGTHS, ISOTROPIC))


def test_timeout_can_be_lengthened(quick):
    quick.cycle(REGULAR)
    assert quick.set(stale_timeout=30.0)[0].successful
    count = len(quick.cycles)
    quick.linger(2.0 * TIMEOUT)
    assert len(quick.cycles) == count


def test_message_stamps_do_not_matter(quick):
    """Neither an old stamp nor one from the future makes a posture fresh or stale."""
    for sec in (0, 1, 2_000_000_000):
        count = len(quick.cycles)
        numbers, _ = quick.cycle(REGULAR, stamp=(sec, 0))
        if not math.isnan(numbers.z):
            assert_numbers(numbers, expected_numbers(LENGTHS, REGULAR))
        assert_unknown(quick.next_cycle(max(count + 1, len(quick.cycles))))


def test_paused_simulated_time_does_not_fool_it(make_bench):
    bench = make_bench({'stale_timeout': TIMEOUT, 'use_sim_time': True,
                        'diagnostics_period': 0.1})
    clock = bench.peer.create_publisher(Clock, '/clock', 1)
    subscription, = (s for s in bench.monitor.subscriptions if s.msg_type is Clock)
    bench.wait(lambda: clock.get_subscription_count() > 0
               and subscription.get_publisher_count() > 0, 'discovery of the clock')
    clock.publish(Clock(clock=Time(sec=1000)))
    bench.wait(lambda: bench.monitor.get_clock().now().nanoseconds == 1000 * 10**9,
               'simulated time')
    # Simulated time stands at 1000 s from here on.
    numbers, _ = bench.cycle(REGULAR)
    count = len(bench.cycles)
    assert_unknown(bench.next_cycle(count))
    bench.wait_for_level(STALE)
    # The diagnostics go on too.
    heard = len(bench.diagnostics)
    bench.wait(lambda: len(bench.diagnostics) > heard + 2, 'periodic diagnostics')
    # A jump, forth and back, makes nothing stale nor fresh.
    assert bench.set(stale_timeout=30.0)[0].successful
    bench.cycle(REGULAR)
    count = len(bench.cycles)
    for sec in (9000, 5):
        clock.publish(Clock(clock=Time(sec=sec)))
        bench.wait(lambda sec=sec: bench.monitor.get_clock().now().nanoseconds == sec * 10**9,
                   'simulated time')
    assert len(bench.cycles) == count


def test_use_sim_time_switched_on_while_running(quick):
    quick.cycle(REGULAR)
    result, = quick.monitor.set_parameters([Parameter('use_sim_time', value=True)])
    assert result.successful
    count = len(quick.cycles)
    assert_unknown(quick.next_cycle(count))
    assert quick.set(stale_timeout=30.0)[0].successful
    assert_numbers(quick.cycle(REGULAR)[0], expected_numbers(LENGTHS, REGULAR))
