"""Many monitors on one machine do not hear each other."""

import signal

from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from support import assert_numbers, expected_numbers, NAMES, REGULAR

MONITORS = 20
PROCESSES = 4


def lengths(i):
    return [1.0, 0.4 + 0.05 * i, 0.3 + 0.02 * i]


def test_in_one_process(make_bench):
    benches = [make_bench({'link_lengths': lengths(i)}, namespace=f'/robot_{i}',
                          name=f'/robot_{i}/singularity_monitor',
                          joint_states=f'/robot_{i}/joint_states') for i in range(MONITORS)]
    for _ in range(3):
        for bench in benches:
            bench.send(REGULAR)
        for i, bench in enumerate(benches):
            bench.wait(lambda bench=bench: bench.cycles, f'robot {i}')
    for i, bench in enumerate(benches):
        bench.wait(lambda bench=bench: len(bench.cycles) == 3, f'robot {i}')
        for numbers, _ in bench.cycles:
            assert_numbers(numbers, expected_numbers(lengths(i), REGULAR))


def test_each_in_a_process(start, feed, soak):
    count = min(MONITORS, soak(PROCESSES))
    heard = [[] for _ in range(count)]
    publishers, processes = [], []
    for i in range(count):
        feed.node.create_subscription(
            Float64, f'/robot_{i}/singularity_monitor/z', heard[i].append, 100)
        publishers.append(feed.node.create_publisher(JointState, f'/robot_{i}/joint_states', 10))
        processes.append(start(
            '-r', f'__ns:=/robot_{i}', '-p', f'joint_names:=[{", ".join(NAMES)}]',
            '-p', f'link_lengths:={lengths(i)}'))

    def all_answer():
        for publisher in publishers:
            publisher.publish(JointState(name=NAMES, position=REGULAR))
        return all(sum(message.data == message.data for message in h) > 20 for h in heard)

    feed.until(all_answer)
    for i, messages in enumerate(heard):
        expected = expected_numbers(lengths(i), REGULAR).z
        for message in messages:
            assert message.data != message.data or abs(message.data - expected) < 1e-9
    for process in processes:
        process.popen.send_signal(signal.SIGINT)
    for process in processes:
        assert process.end()[0] == 0
