"""Publishers that die, interleave, flood, and send what nobody expects."""

import signal
import time

from processes import answer_of, ARM, assert_clean
from sensor_msgs.msg import JointState
from support import (
    assert_numbers,
    assert_unknown,
    expected_numbers,
    ISOTROPIC,
    LENGTHS,
    NAMES,
    REGULAR,
)

TIMEOUT = 0.5
FLOOD_RATE = 5000.0
FLOOD_TIME = 2.0


def knows(cycle):
    return cycle[0].z == cycle[0].z


def test_publisher_killed_and_restarted(make_bench, start):
    bench = make_bench({'stale_timeout': TIMEOUT})
    for _ in range(3):
        arm = start(*ARM, executable='simulated_arm')
        heard = len(bench.cycles)
        bench.wait(lambda heard=heard: any(map(knows, bench.cycles[heard:])), 'recovery')
        arm.popen.kill()
        arm.end()
        killed = time.monotonic()
        bench.wait(lambda: not knows(bench.cycles[-1]), 'staleness')
        assert time.monotonic() - killed < TIMEOUT + 0.5
        assert_unknown(bench.cycles[-1])
        bench.wait_for_level(3)


def test_two_publishers_with_interleaved_parts(make_bench, soak):
    """Each part completes a posture of the newest positions, whoever sent them."""
    bench = make_bench({'stale_timeout': 30.0})
    second = bench.peer.create_publisher(JointState, 'joint_states', 10)
    bench.wait(lambda: second.get_subscription_count() > 0, 'the second publisher')
    subscription, = (s for s in bench.monitor.subscriptions if s.topic_name == '/joint_states')
    bench.wait(lambda: subscription.get_publisher_count() == 2, 'the second publisher')
    latest = dict(zip(NAMES, REGULAR))
    bench.cycle(REGULAR)
    for step in range(soak(100)):
        names = (NAMES[:2], NAMES[1:], NAMES[2:], NAMES[:1])[step % 4]
        for place, name in enumerate(names):
            latest[name] = 0.01 * step + place - 1.0
        numbers, _ = bench.cycle([latest[name] for name in names], names,
                                 publisher=second if step % 2 else None)
        assert_numbers(numbers, expected_numbers(LENGTHS, [latest[name] for name in NAMES]))
        assert len(bench.cycles) == step + 2


def test_flood(start, feed):
    """A publisher far faster than the node: readings are passed over, never worked off late."""
    process = start(*ARM)
    feed.until(lambda: answer_of(feed))
    sent, begun = 0, time.monotonic()
    while (elapsed := time.monotonic() - begun) < FLOOD_TIME:
        while sent < FLOOD_RATE * elapsed:
            feed.publisher.publish(JointState(name=NAMES, position=REGULAR))
            sent += 1
        feed.executor.spin_once(timeout_sec=0.0)
    expected = expected_numbers(LENGTHS, ISOTROPIC).z
    last = time.monotonic()
    feed.publisher.publish(JointState(name=NAMES, position=ISOTROPIC))
    while not (feed.heard and abs(feed.heard[-1] - expected) < 1e-9):
        assert time.monotonic() - last < 0.45, 'the node lags behind the flood'
        feed.executor.spin_once(timeout_sec=0.01)
    assert sent > 0.5 * FLOOD_RATE * FLOOD_TIME
    process.popen.send_signal(signal.SIGINT)
    assert_clean(process)


def test_names_by_the_ten_thousand(make_bench):
    """Also where the list is another one each time, so that nothing learned helps."""
    bench = make_bench()
    others = [f'joint_{i}' for i in range(10_000)]
    for step in range(5):
        names = [*others[:1000 * step], *NAMES, *others[1000 * step:]]
        positions = [float('nan')] * len(names)
        positions[1000 * step:1000 * step + 3] = REGULAR
        begun = time.monotonic()
        assert_numbers(bench.cycle(positions, names)[0], expected_numbers(LENGTHS, REGULAR))
        assert time.monotonic() - begun < 0.5
        # Our own names by the thousand are no posture.
        assert_unknown(bench.cycle([0.0] * 9000, NAMES * 3000))
    assert_numbers(bench.cycle(ISOTROPIC)[0], expected_numbers(LENGTHS, ISOTROPIC))
