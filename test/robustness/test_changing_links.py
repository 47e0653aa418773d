"""Parameters change all the time while messages arrive."""

from itertools import pairwise
import time

from support import assert_numbers, expected_numbers, LENGTHS, REGULAR

PERIOD = 0.02
LEAST_RATE = 40.0
STATES = [
    {'link_lengths': LENGTHS, 'joint_offsets': [0.0, 0.0, 0.0], 'joint_directions': [1, 1, 1]},
    {'link_lengths': [0.2, 0.9, 0.5], 'joint_offsets': [0.0, 0.7, -0.4],
     'joint_directions': [1, -1, 1]}]


def expected(state):
    angles = [direction * position + offset for direction, position, offset in zip(
        state['joint_directions'], REGULAR, state['joint_offsets'])]
    return expected_numbers(state['link_lengths'], angles)


def closest(numbers, known):
    """Tell by z which of the known numbers these are meant to be."""
    return min(range(len(known)), key=lambda i: abs(numbers.z - known[i].z))


def test_every_triple_belongs_to_one_configuration(make_bench, soak):
    """Three parameters change together at 50 Hz; half of a change would give other numbers."""
    bench = make_bench()
    known = [expected(state) for state in STATES]
    changes = 0
    begun = time.monotonic()
    while changes < soak(100):
        bench.send(REGULAR)
        bench.executor.spin_once(timeout_sec=0.001)
        if time.monotonic() - begun > changes * PERIOD:
            changes += 1
            assert bench.set_atomically(**STATES[changes % 2]).successful
    rate = changes / (time.monotonic() - begun)
    bench.linger(0.1)
    seen = [closest(numbers, known) for numbers, _ in bench.cycles]
    for (numbers, _), which in zip(bench.cycles, seen):
        assert_numbers(numbers, known[which])
    # A change that comes late is made up for, and a round takes some 5 ms: a pause of the
    # machine does not show here.
    assert rate > LEAST_RATE, f'only {rate:.0f} changes/s'
    # The messages do arrive between the changes: nearly every one shows in the answers.
    assert sum(a != b for a, b in pairwise(seen)) > 0.8 * changes
