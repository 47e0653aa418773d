"""A flood of hostile messages: nothing dies, no false OK, and the next good one is believed."""

import math
import os
import random
import resource

import pytest
from sensor_msgs.msg import JointState
from support import assert_numbers, expected_numbers, LENGTHS, NAMES

from kinopt_ros.monitor.verdict import Thresholds

NAN, INF = math.nan, math.inf
# Fewer than the depth of the subscription: none of them pushes another one out.
BATCH = 5
MESSAGES = 2000
OTHERS = ['gripper', 'rail', '', 'shoulder ', 'Elbow', 'ж', 'x' * 3000]
NOT_FINITE = [NAN, INF, -INF]
EXTREME = [1e300, -1.7976931348623157e308, 5e-324, -0.0, 1e6]


class Oracle:
    """What the node has to say of each message, told by the rules alone."""

    def __init__(self, postures):
        self._known = {}
        self._answers = {tuple(posture): answer_of(posture) for posture in postures}

    def expect(self, names, positions):
        """
        Give what follows a message.

        Returns
        -------
        expected : 'nothing', 'unknown', 'some numbers', or (Numbers, bool)
        """
        ours = [name for name in names if name in NAMES]
        if not ours:
            return 'nothing'
        sound = len(set(ours)) == len(ours) and len(positions) == len(names)
        read = {name: position for name, position in zip(names, positions) if name in NAMES}
        if not sound or not all(map(math.isfinite, read.values())):
            for name in ours:
                self._known.pop(name, None)
            return 'unknown'
        self._known.update(read)
        if len(self._known) < len(NAMES):
            return 'nothing'
        posture = tuple(self._known[name] for name in NAMES)
        return self._answers.get(posture, 'some numbers')


def answer_of(posture):
    numbers = expected_numbers(LENGTHS, posture)
    return numbers, bool(Thresholds().crossed(numbers))


def good_postures(rng):
    """Give postures that are clearly on one side of the thresholds, also with the hysteresis."""
    postures = []
    while len(postures) < 40:
        posture = [rng.uniform(-3.0, 3.0) for _ in NAMES]
        numbers = expected_numbers(LENGTHS, posture)
        if numbers.margin < 0.04 or (numbers.margin > 0.07 and numbers.z < 0.85):
            postures.append(posture)
    return postures


def hostile(rng, postures):
    """Give names and positions of a message of some hostile or innocent kind."""
    posture = list(rng.choice(postures))
    names = list(NAMES)
    kind = rng.randrange(10)
    if kind == 0:
        posture[rng.randrange(3)] = rng.choice(NOT_FINITE)
    elif kind == 1:
        posture = posture[:rng.randrange(3)]
    elif kind == 2:
        posture += [rng.choice([0.0, NAN])] * rng.randrange(1, 4)
    elif kind == 3:
        names[rng.randrange(3)] = rng.choice([*NAMES, *OTHERS])
    elif kind == 4:
        names = names[:rng.randrange(4)]
        posture = posture[:len(names)]
    elif kind == 5:
        posture[rng.randrange(3)] = rng.choice(EXTREME)
    elif kind == 6:
        names = rng.sample(OTHERS, 3)
        posture[rng.randrange(3)] = rng.choice(NOT_FINITE)
    elif kind == 7:
        order = rng.sample(range(3), 3)
        names, posture = [names[i] for i in order], [posture[i] for i in order]
    elif kind == 8:
        place = rng.randrange(4)
        names.insert(place, rng.choice(OTHERS))
        posture.insert(place, rng.choice([*NOT_FINITE, *EXTREME]))
    return names, posture


def joint_state(rng, names, positions):
    junk = [NAN, INF, 1e308, -0.1, 0.0]
    message = JointState(
        name=names, position=positions,
        velocity=[rng.choice(junk) for _ in range(rng.choice([0, 0, len(names), 2]))],
        effort=[rng.choice(junk) for _ in range(rng.choice([0, 5]))])
    message.header.stamp.sec = rng.choice([0, -5, 2**31 - 1, rng.randrange(10**6)])
    message.header.stamp.nanosec = rng.choice([0, 2**32 - 1, rng.randrange(10**9)])
    message.header.frame_id = rng.choice(['', 'base', '\n'])
    return message


def check(cycle, expected):
    numbers, flag = cycle
    if expected == 'unknown':
        assert all(map(math.isnan, numbers)) and flag is True
    elif expected == 'some numbers':
        assert all(map(math.isfinite, numbers)), numbers
        assert 0.0 <= numbers.z <= 1.0 and -1e-12 <= numbers.margin <= 1.0
    else:
        assert_numbers(numbers, expected[0])
        # The flag may still be up by its hysteresis, never down where a threshold is crossed.
        assert flag or not expected[1]


def forget(bench):
    for heard in (*bench._heard.values(), bench.diagnostics):
        heard.clear()


def resident_megabytes():
    with open('/proc/self/statm') as file:
        return int(file.read().split()[1]) * resource.getpagesize() / 1e6


@pytest.mark.skipif(not os.path.exists('/proc/self/statm'), reason='reads /proc')
def test_hostile_messages(make_bench, soak):
    bench = make_bench({'diagnostics_period': 0.0})
    rng = random.Random(20)
    postures = good_postures(rng)
    oracle = Oracle(postures)
    count, resident = soak(MESSAGES), []
    batches = count // BATCH
    for batch in range(batches):
        expected = []
        for _ in range(BATCH):
            names, positions = hostile(rng, postures)
            expected.append(oracle.expect(names, positions))
            bench.publisher.publish(joint_state(rng, names, positions))
        # Bytes that are no message at all, and a good message to finish with.
        if rng.randrange(20) == 0:
            bench.publisher.publish(b'\x00\x01\x00\x00' + rng.randbytes(rng.randrange(60)))
        good = rng.choice(postures)
        expected.append(oracle.expect(NAMES, good))
        bench.send(good)
        expected = [answer for answer in expected if answer != 'nothing']
        bench.wait(lambda expected=expected: len(bench.cycles) >= len(expected), 'all answers')
        for cycle, answer in zip(bench.cycles, expected, strict=True):
            check(cycle, answer)
        forget(bench)
        if batch % max(1, batches // 100) == 0:
            resident.append(resident_megabytes())
    # Once warm it takes no more: the last tenth against the end of the first.
    growth = max(resident[-10:]) - max(resident[:10])
    print(f'{count} messages; resident memory grew by {growth:.2f} MB to {resident[-1]:.1f} MB')
    assert growth < 3.0
