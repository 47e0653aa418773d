"""What the node says of messages that cannot be believed, and how it recovers."""

import math

import pytest
from sensor_msgs.msg import JointState
from support import (
    assert_numbers,
    assert_unknown,
    expected_numbers,
    ISOTROPIC,
    LENGTHS,
    NAMES,
    REGULAR,
    STRETCHED,
)

OK, WARN, ERROR, STALE = range(4)
NAN, INF = math.nan, math.inf
# Names, positions, and the joint that the reason has to name.
BAD = {
    'nan': (NAMES, [0.0, NAN, 1.0], 'elbow'),
    'infinite': (NAMES, [0.0, 1.0, INF], 'wrist'),
    'minus infinite': (NAMES, [-INF, 1.0, 1.0], 'shoulder'),
    'too few': (NAMES, [0.0, 1.0], 'wrist'),
    'none': (NAMES, [], 'shoulder'),
    'too few, one of ours last': (['gripper', 'rail', *NAMES], [0.0, 0.0, 0.0, 1.0], 'wrist'),
    'twice': ([*NAMES, 'elbow'], [0.0, 1.0, 2.0, 1.0], 'elbow'),
    'twice in a part': (['wrist', 'wrist'], [0.0, 0.0], 'wrist'),
    'nan in a part': (['shoulder'], [NAN], 'shoulder'),
    'nan among others': (['gripper', *NAMES], [0.0, 0.0, NAN, 0.0], 'elbow'),
}


@pytest.mark.parametrize('case', BAD)
def test_bad_message_is_unknown_once_with_the_reason(bench, case):
    names, positions, joint = BAD[case]
    bench.cycle(ISOTROPIC)
    bench.wait_for_level(OK)
    assert_unknown(bench.cycle(positions, names, stamp=(77, 5)))
    status = bench.wait_for_level(ERROR)
    assert f"'{joint}'" in status.message
    assert bench.values['z'] == bench.values['margin'] == 'nan'
    stamp = bench.diagnostics[-1].header.stamp
    assert (stamp.sec, stamp.nanosec) == (77, 5)
    # The next good message is the next cycle: nothing was published a second time.
    numbers, flag = bench.cycle(REGULAR)
    assert_numbers(numbers, expected_numbers(LENGTHS, REGULAR))
    assert flag is False
    assert set(bench.counts.values()) == {3}
    bench.wait_for_level(OK)


@pytest.mark.parametrize('case', BAD)
def test_bad_message_as_the_first(bench, case):
    names, positions, joint = BAD[case]
    assert_unknown(bench.cycle(positions, names))
    assert f"'{joint}'" in bench.wait_for_level(ERROR).message


def test_each_bad_message_is_a_cycle(bench):
    for count, (names, positions, _) in enumerate(BAD.values(), start=1):
        assert_unknown(bench.cycle(positions, names))
        assert set(bench.counts.values()) == {count}


def test_reasons_tell_the_rules_apart(bench):
    reasons = []
    for case in ('nan', 'too few', 'twice'):
        names, positions, _ = BAD[case]
        heard = len(bench.diagnostics)
        bench.cycle(positions, names)
        reasons.append(bench.wait_for_level(ERROR, since=heard).message)
    assert 'nan' in reasons[0] and 'finite' in reasons[0]
    assert '2 positions' in reasons[1] and '3 names' in reasons[1]
    assert 'more than once' in reasons[2]


def test_velocities_and_efforts_do_not_matter(bench):
    bench.publisher.publish(JointState(
        name=NAMES, position=REGULAR, velocity=[NAN], effort=[INF, NAN, 0.0, 1.0]))
    numbers, _ = bench.next_cycle(0)
    assert_numbers(numbers, expected_numbers(LENGTHS, REGULAR))


def test_foreign_values_do_not_matter(bench):
    numbers, _ = bench.cycle([NAN, *REGULAR, INF], ['gripper', *NAMES, 'gripper'])
    assert_numbers(numbers, expected_numbers(LENGTHS, REGULAR))


def test_bad_value_is_not_kept(bench):
    bench.cycle(ISOTROPIC)
    assert_unknown(bench.cycle([NAN], ['elbow']))
    # The other joints' parts alone never bring the bad one back.
    bench.send(REGULAR[:1], NAMES[:1])
    bench.send(REGULAR[2:], NAMES[2:])
    numbers, _ = bench.cycle(REGULAR[1:2], NAMES[1:2])
    assert_numbers(numbers, expected_numbers(LENGTHS, REGULAR))
    for numbers, _ in bench.cycles[2:]:
        assert not any(math.isnan(value) for value in numbers)


def test_counts_of_accepted_and_rejected(make_bench):
    bench = make_bench({'diagnostics_period': 0.0})
    bench.cycle(REGULAR)
    bench.cycle(REGULAR)
    for names, positions, _ in BAD.values():
        bench.cycle(positions, names)
    bench.send([0.0], ['gripper'])
    bench.cycle(REGULAR)
    bench.wait(lambda: bench.values.get('messages accepted') == '3', 'the third accepted')
    assert bench.values['messages rejected'] == str(len(BAD))


def test_huge_positions_do_not_end_the_node(bench):
    for position in (1e300, -1.7976931348623157e308, 5e-324):
        numbers, _ = bench.cycle([position, position, -position])
        assert all(math.isfinite(value) for value in numbers)
    assert_numbers(bench.cycle(REGULAR)[0], expected_numbers(LENGTHS, REGULAR))


def test_many_joints_and_odd_names(bench):
    names = [f'joint_{i}' for i in range(2000)] + ['', 'ж', 'x' * 10000] + NAMES
    numbers, _ = bench.cycle([0.5] * 2003 + REGULAR, names)
    assert_numbers(numbers, expected_numbers(LENGTHS, REGULAR))


def test_timers_survive_every_bad_message(make_bench):
    bench = make_bench({'diagnostics_period': 0.05, 'stale_timeout': 0.3})
    for names, positions, _ in BAD.values():
        bench.send(positions, names)
        bench.linger(0.01)
    bench.publisher.publish(b'\x00\x01\x00\x00' + b'\xff' * 40)
    bench.cycle(REGULAR)
    heard = len(bench.diagnostics)
    bench.wait(lambda: len(bench.diagnostics) > heard + 3, 'periodic diagnostics')
    bench.wait_for_level(STALE, since=heard)


@pytest.mark.parametrize('positions', [ISOTROPIC, STRETCHED, [0.0, math.pi, math.pi]])
def test_odd_velocities_and_stamps_do_not_disturb(make_bench, positions):
    bench = make_bench({'diagnostics_period': 0.0})
    velocities = [[], [0.0] * 3, [1e308] * 3, [-1e308, 1e308, 0.0], [NAN] * 3, [INF, 0.0, -INF],
                  [1.0], [0.0] * 7]
    stamps = [(0, 0), (0, 0), (2**31 - 1, 999_999_999), (-5, 0), (7, 0)]
    for count, velocity in enumerate(velocities * 2):
        sec, nanosec = stamps[count % len(stamps)]
        message = JointState(name=NAMES, position=positions, velocity=velocity)
        message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
        bench.publisher.publish(message)
        numbers, _ = bench.next_cycle(count)
        assert_numbers(numbers, expected_numbers(LENGTHS, positions))
        bench.wait(lambda count=count: len(bench.diagnostics) > count, 'diagnostics')
        stamp = bench.diagnostics[count].header.stamp
        assert (stamp.sec, stamp.nanosec) == (sec, nanosec)
