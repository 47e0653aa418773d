"""A recording of a real UR5 through the node, against singular values computed from scratch."""

import os
from pathlib import Path

import numpy as np
import pytest
from support import Numbers

RECORDING = Path(os.environ.get(
    'KINOPT_UR5_RECORDING',
    Path(__file__).parents[3] / 'shared' / 'data' / 'ur5_movement1_q.csv'))
NAMES = ['shoulder_pan_joint', 'shoulder_lift_joint', 'elbow_joint', 'wrist_1_joint',
         'wrist_2_joint', 'wrist_3_joint']
ARM = {'joint_names': NAMES[1:4], 'link_lengths': [0.425, 0.39225, 0.09465],
       'joint_offsets': [0.0, 0.0, np.pi / 2.0]}

pytestmark = pytest.mark.skipif(
    not RECORDING.exists(),
    reason=f'no recording at {RECORDING} (KINOPT_UR5_RECORDING names another place)')


def numbers_by_singular_values(positions):
    """Compute z, l_P and margin of all rows: singular values of the centred 2 x 3 blocks."""
    absolute = np.cumsum(positions + np.array(ARM['joint_offsets']), axis=1)
    steps = np.array(ARM['link_lengths'])[:, None] * np.array(
        [np.cos(absolute.T), np.sin(absolute.T)])
    vectors = np.cumsum(steps[:, ::-1], axis=1)[:, ::-1].transpose(2, 0, 1)
    n = vectors.shape[2]
    centred = vectors - vectors.mean(axis=2, keepdims=True)
    s = np.linalg.svd(centred, compute_uv=False)
    size = np.sum(vectors ** 2, axis=(1, 2))
    return np.column_stack([1.0 - s.sum(axis=1) ** 2 / (2.0 * size),
                            size / (np.sqrt(n) * s.sum(axis=1)),
                            s[:, 1] * s.sum(axis=1) / size])


def flags_of(numbers, z_max, margin_min, hysteresis):
    """Give the flag after each row, with its hysteresis."""
    up, flags = False, []
    for z, _, margin in numbers:
        if z > z_max or margin < margin_min:
            up = True
        elif (1.0 - z > (1.0 - z_max) * (1.0 + hysteresis)
              and margin > margin_min * (1.0 + hysteresis)):
            up = False
        flags.append(up)
    return flags


@pytest.mark.parametrize('z_max, margin_min, hysteresis', [(0.9, 0.05, 0.1), (0.75, 0.1, 0.3)])
def test_published_sequence_of_a_real_arm(make_bench, z_max, margin_min, hysteresis):
    rows = np.loadtxt(RECORDING, delimiter=',')
    positions = rows[:, 1:]
    expected = numbers_by_singular_values(positions[:, 1:4])
    flags = flags_of(expected, z_max, margin_min, hysteresis)
    # It passes near the elbow singularity and is clear of it too, or this would prove little.
    assert 0 < sum(flags) < len(flags)
    bench = make_bench({**ARM, 'z_max': z_max, 'margin_min': margin_min,
                        'hysteresis': hysteresis,
                        'qos_overrides./joint_states.subscription.reliability': 'reliable'})
    # All six joints, as the robot's driver publishes them; a few messages under way at a time.
    for sent, row in enumerate(positions, 1):
        bench.send(row, NAMES)
        bench.wait(lambda sent=sent: bench.counts['near_singularity'] > sent - 5, 'answers')
    bench.wait(lambda: min(bench.counts.values()) == len(rows), 'an answer to every message')
    cycles = bench.cycles
    for i, name in enumerate(Numbers._fields):
        published = [getattr(numbers, name) for numbers, _ in cycles]
        np.testing.assert_allclose(published, expected[:, i], rtol=1e-9, atol=1e-9)
    assert [flag for _, flag in cycles] == flags
