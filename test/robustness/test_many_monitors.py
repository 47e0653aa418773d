"""Many monitors on one machine do not hear each other, nor speak for each other."""

import math
import signal
import time

from diagnostic_msgs.msg import DiagnosticArray
from processes import assert_clean
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64
from support import assert_numbers, expected_numbers, NAMES

MONITORS = 20
PROCESSES = 4
TOPICS = {'z': Float64, 'margin': Float64, 'near_singularity': Bool}
# One answer could come from the own robot by chance, so many hardly.
ANSWERS = 20
PERIOD = 0.05


def lengths(i):
    return [1.0, 0.4 + 0.05 * i, 0.3 + 0.02 * i]


def posture(i):
    """Give a posture of robot i's own; those of robots 0, 6, 11 and 17 are near-singular."""
    return [0.3, 0.02 + 1.1 * i, 2.0 - 0.05 * i]


def own_numbers(i):
    return expected_numbers(lengths(i), posture(i))


def own_flag(i):
    """Tell the flag at the default thresholds."""
    numbers = own_numbers(i)
    return bool(numbers.z > 0.9 or numbers.margin < 0.05)


def known(values):
    return [value for value in values if not math.isnan(value)]


def names_and_z(arrays):
    """Give the (name, z) pairs of all statuses heard."""
    return [(status.name, float({pair.key: pair.value for pair in status.values}['z']))
            for array in arrays for status in array.status]


def all_told(arrays, count):
    """Tell whether so many names have come with a z that is known."""
    return len({name for name, z in names_and_z(arrays) if not math.isnan(z)}) >= count


def assert_statuses(arrays, count):
    """Assert that of each robot there is a status, and in it never the z of another."""
    own = {f'robot_{i}/singularity_monitor: posture': own_numbers(i).z for i in range(count)}
    heard = {name: [] for name in own}
    for name, z in names_and_z(arrays):
        heard[name].append(z)
    for name, values in heard.items():
        assert known(values), f'no z of {name}'
        assert all(abs(z - own[name]) < 1e-9 for z in known(values)), (name, own[name], values)


def test_no_robot_has_the_numbers_of_a_mixture():
    """What makes the tests below tell: lengths of one, posture of another show in z."""
    for i in range(MONITORS):
        for j in set(range(MONITORS)) - {i}:
            assert abs(expected_numbers(lengths(i), posture(j)).z - own_numbers(i).z) > 1e-4
    assert {own_flag(i) for i in range(PROCESSES)} == {False, True}


def test_in_one_process(make_bench):
    benches = [make_bench({'link_lengths': lengths(i)}, namespace=f'/robot_{i}',
                          name=f'/robot_{i}/singularity_monitor',
                          joint_states=f'/robot_{i}/joint_states') for i in range(MONITORS)]
    for _ in range(3):
        for i, bench in enumerate(benches):
            bench.send(posture(i))
        for i, bench in enumerate(benches):
            bench.wait(lambda bench=bench: bench.cycles, f'robot {i}')
    for i, bench in enumerate(benches):
        bench.wait(lambda bench=bench: len(bench.cycles) >= 3, f'robot {i}')
    diagnostics = benches[0].diagnostics
    benches[0].wait(lambda: all_told(diagnostics, MONITORS), 'diagnostics of all')
    for i, bench in enumerate(benches):
        assert len(bench.cycles) == 3
        for numbers, flag in bench.cycles:
            assert_numbers(numbers, own_numbers(i))
            assert flag is own_flag(i)
    assert_statuses(diagnostics, MONITORS)


class Robot:
    """A monitor in a process and namespace of its own; what is sent to it and heard of it."""

    def __init__(self, i, start, node):
        self.i = i
        self.heard = {topic: [] for topic in TOPICS}
        for topic, heard in self.heard.items():
            node.create_subscription(
                TOPICS[topic], f'/robot_{i}/singularity_monitor/{topic}',
                lambda message, heard=heard: heard.append(message.data), 100)
        self.publisher = node.create_publisher(JointState, f'/robot_{i}/joint_states', 10)
        self.process = start(
            '-r', f'__ns:=/robot_{i}', '-p', f'joint_names:=[{", ".join(NAMES)}]',
            '-p', f'link_lengths:={lengths(i)}', '-p', 'stale_timeout:=30.0')

    def send(self):
        self.publisher.publish(JointState(name=NAMES, position=posture(self.i)))

    @property
    def has_answered(self):
        return (all(len(known(self.heard[topic])) > ANSWERS for topic in ('z', 'margin'))
                and len(self.heard['near_singularity']) > ANSWERS)

    def assert_own(self):
        expected = own_numbers(self.i)
        for topic in ('z', 'margin'):
            for value in known(self.heard[topic]):
                assert abs(value - getattr(expected, topic)) < 1e-9, (self.i, topic, value)
        # Raised before the first posture; once cleared, only another's posture could raise it.
        flags = self.heard['near_singularity']
        assert flags == sorted(flags, reverse=True), (self.i, flags)
        assert flags[-1] is own_flag(self.i), (self.i, flags)


def test_each_in_a_process(start, feed, soak):
    count = min(MONITORS, soak(PROCESSES))
    diagnostics = []
    feed.node.create_subscription(DiagnosticArray, '/diagnostics', diagnostics.append, 100)
    robots, due = [], time.monotonic()

    def all_answer():
        nonlocal due
        if time.monotonic() < due:
            return False
        due = time.monotonic() + PERIOD
        for robot in robots:
            robot.send()
        return (all(robot.has_answered for robot in robots)
                and all_told(diagnostics, len(robots)))

    # Few at a time: twenty that start at once take a small machine longer than the deadline.
    for first in range(0, count, PROCESSES):
        robots += [Robot(i, start, feed.node)
                   for i in range(first, min(first + PROCESSES, count))]
        feed.until(all_answer)
    for robot in robots:
        robot.assert_own()
    assert_statuses(diagnostics, count)
    for robot in robots:
        robot.process.popen.send_signal(signal.SIGINT)
    for robot in robots:
        assert_clean(robot.process)
