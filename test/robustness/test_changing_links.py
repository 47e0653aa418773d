"""Parameters change all the time while messages arrive."""

import time

from support import assert_numbers, expected_numbers, LENGTHS, REGULAR

PERIOD = 0.02
STATES = [
    {'link_lengths': LENGTHS, 'joint_offsets': [0.0, 0.0, 0.0], 'joint_directions': [1, 1, 1]},
    {'link_lengths': [0.2, 0.9, 0.5], 'joint_offsets': [0.0, 0.7, -0.4],
     'joint_directions': [1, -1, 1]}]


def expected(state):
    angles = [direction * position + offset for direction, position, offset in zip(
        state['joint_directions'], REGULAR, state['joint_offsets'])]
    return expected_numbers(state['link_lengths'], angles)


def test_every_triple_belongs_to_one_configuration(make_bench, soak):
    """Three parameters change together at 50 Hz; half of a change would give other numbers."""
    bench = make_bench()
    known = [expected(state) for state in STATES]
    changes, seen = 0, [0, 0]
    begun = time.monotonic()
    while changes < soak(100):
        bench.send(REGULAR)
        bench.executor.spin_once(timeout_sec=0.001)
        if time.monotonic() - begun > changes * PERIOD:
            changes += 1
            assert bench.set_atomically(**STATES[changes % 2]).successful
    bench.linger(0.1)
    for numbers, _ in bench.cycles:
        which = int(abs(numbers.z - known[1].z) < abs(numbers.z - known[0].z))
        assert_numbers(numbers, known[which])
        seen[which] += 1
    assert min(seen) > 10
