"""Joint states that nobody should send, made up at random; what hostile tests share."""

import math

from sensor_msgs.msg import JointState
from support import expected_numbers, LENGTHS, NAMES

NAN, INF = math.nan, math.inf
OTHERS = ['gripper', 'rail', '', 'shoulder ', 'Elbow', 'ж', 'x' * 3000]
NOT_FINITE = [NAN, INF, -INF]
EXTREME = [1e300, -1.7976931348623157e308, 5e-324, -0.0, 1e6]


def good_postures(rng):
    """Give postures on both sides of the thresholds, each fourth within the hysteresis."""
    postures = []
    while len(postures) < 40:
        posture = [rng.uniform(-3.0, 3.0) for _ in NAMES]
        if len(postures) % 4 or 0.05 < expected_numbers(LENGTHS, posture).margin < 0.055:
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
