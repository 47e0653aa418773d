"""A flood of hostile messages: nothing dies, no false OK, and the next good one is believed."""

from functools import lru_cache
import math
import os
import random
import resource

from diagnostic_msgs.msg import DiagnosticStatus
from hostile import good_postures, hostile, joint_state
import pytest
from support import assert_numbers, assert_unknown, expected_numbers, LENGTHS, NAMES

# Fewer than the depth of the subscription: none of them pushes another one out.
BATCH = 5
MESSAGES = 2000


class Oracle:
    """What the node has to say of each message, told by the rules alone."""

    def __init__(self):
        self._known = {}

    def expect(self, names, positions):
        """
        Give what follows a message.

        Returns
        -------
        expected : 'nothing', 'unknown' or Numbers
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
        return numbers_of(tuple(self._known[name] for name in NAMES))


# Most postures come again and again.
@lru_cache(maxsize=256)
def numbers_of(posture):
    # Within one turn first: a sum with 1e300 would not know the other angles any more.
    return expected_numbers(
        LENGTHS, [math.atan2(math.sin(angle), math.cos(angle)) for angle in posture])


def flag_after(numbers, was_up):
    """Tell whether the flag is up: raised, cleared, or in the hysteresis between as before."""
    if numbers.z > 0.9 or numbers.margin < 0.05:
        return True
    return was_up and not (1.0 - numbers.z > 0.11 and numbers.margin > 0.055)


def check(cycle, status, expected, was_up):
    """Hold a cycle and its diagnostics against what is expected; tell whether the flag is up."""
    numbers, flag = cycle
    if expected == 'unknown':
        assert_unknown(cycle)
        assert status.level == DiagnosticStatus.ERROR, status
    else:
        assert_numbers(numbers, expected)
        # Of the numbers as published: just beside a threshold the oracle's may lie across it.
        assert flag is flag_after(numbers, was_up), (numbers, was_up)
        assert status.level == (DiagnosticStatus.WARN if flag else DiagnosticStatus.OK), status
    return flag


def check_answers(bench, expected, was_up):
    """Wait for a cycle and its diagnostics per answer, check them all, and forget them."""
    expected = [answer for answer in expected if answer != 'nothing']
    bench.wait(lambda: min(len(bench.cycles), len(bench.diagnostics)) >= len(expected),
               'all answers')
    for cycle, array, answer in zip(bench.cycles, bench.diagnostics, expected, strict=True):
        was_up = check(cycle, array.status[0], answer, was_up)
    for heard in (*bench._heard.values(), bench.diagnostics):
        heard.clear()
    return was_up


def resident_megabytes():
    with open('/proc/self/statm') as file:
        return int(file.read().split()[1]) * resource.getpagesize() / 1e6


@pytest.mark.skipif(not os.path.exists('/proc/self/statm'), reason='reads /proc')
def test_hostile_messages(make_bench, soak):
    bench = make_bench({'diagnostics_period': 0.0})
    rng = random.Random(20)
    postures = good_postures(rng)
    oracle = Oracle()
    # Once a posture is known each answer has its diagnostics, and there are no others.
    bench.send(postures[0])
    flag_up = check_answers(bench, [oracle.expect(NAMES, postures[0])], False)
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
        flag_up = check_answers(bench, expected, flag_up)
        if batch % max(1, batches // 100) == 0:
            resident.append(resident_megabytes())
    # Once warm it takes no more: the last tenth against the end of the first.
    growth = max(resident[-10:]) - max(resident[:10])
    print(f'{count} messages; resident memory grew by {growth:.2f} MB to {resident[-1]:.1f} MB')
    assert growth < 3.0
