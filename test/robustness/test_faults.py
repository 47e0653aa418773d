"""A process among all faults at once: hostile messages, and what else may happen to a node."""

import random
import resource
import signal
import time

from diagnostic_msgs.msg import DiagnosticArray
from hostile import good_postures, hostile, joint_state
from processes import ARM, assert_clean
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from support import assert_numbers, DEADLINE, expected_numbers, LENGTHS, NAMES, REGULAR
from visualization_msgs.msg import MarkerArray

from kinopt_ros.monitor.verdict import Level, Thresholds

MESSAGES = 4000
PER_FAULT = 200
# Fewer than the depth of the subscription.
BATCH = 5
TIMEOUT = 0.2
LINKS = [LENGTHS, [0.7, 0.9, 0.5]]
# The sum of positions beyond this keeps no digits for the oracle.
MODERATE = 1e3


class World:
    """What surrounds a monitor: it sends, asks, listens, comes and goes, all at random."""

    def __init__(self, feed, process, seed):
        self.rng = random.Random(seed)
        self.process = process
        self.statuses = []
        self.links = LENGTHS
        self._allowed_links = [LENGTHS]
        self._sent = {name: {f'{position:.12g}'} for name, position in zip(NAMES, REGULAR)}
        self._feed = feed
        self._visitors = []
        self._pending = []
        self._postures = good_postures(self.rng)
        self._publisher = feed.publisher
        node = feed.node
        node.create_subscription(DiagnosticArray, '/diagnostics', self._hear, 1000)
        self._setter = node.create_client(SetParameters, '/singularity_monitor/set_parameters')
        self._solver = node.create_client(Trigger, '/singularity_monitor/get_optimal_posture')
        self._faults = [self._change_links, self._come_and_go, self._ask, self._stop,
                        self._replace_publisher, self._send_rubbish]

    def _hear(self, array):
        for status in array.status:
            self.statuses.append(status)

    def wait(self, condition, what):
        deadline = time.monotonic() + DEADLINE
        while not condition():
            assert self.process.popen.poll() is None, 'the process has ended'
            assert time.monotonic() < deadline, f'nothing of this within {DEADLINE} s: {what}'
            self._feed.executor.spin_once(timeout_sec=0.01)

    def live_through_a_fault(self, messages):
        """One fault amid so many messages; then a good message is believed again."""
        fault = self.rng.choice(self._faults)
        moment = self.rng.randrange(messages)
        for i in range(0, messages, BATCH):
            if i <= moment < i + BATCH:
                fault()
            for _ in range(BATCH):
                names, positions = hostile(self.rng, self._postures)
                self._send(names, positions)
            self._feed.executor.spin_once(timeout_sec=0.002)
        self._settle()
        self._expect_recovery()

    def _send(self, names, positions):
        # Never 0: who takes it for what is missing is to be found out.
        positions = [position or 1e-5 for position in positions]
        for name, position in zip(names, positions):
            self._sent.get(name, set()).add(f'{position:.12g}')
        self._publisher.publish(joint_state(self.rng, names, positions))

    def _settle(self):
        """All that was asked for is answered; from then on only the latest links count."""
        self.wait(lambda: all(future.done() for future in self._pending), 'answers')
        self._pending.clear()

    def _expect_recovery(self):
        posture = self.rng.choice(self._postures)
        expected = expected_numbers(self.links, posture)

        def is_known():
            self._send(NAMES, posture)
            self._feed.linger(0.005)
            return any(abs(_number(status, 'z') - expected.z) < 1e-9 for status in self.statuses)

        self.wait(is_known, f'the posture {posture}')
        self._check()
        self._allowed_links = [self.links]

    def _check(self):
        """No status that was heard says what is not so."""
        for status in self.statuses:
            check(status, self._allowed_links, self._sent)
        self.statuses.clear()

    def _change_links(self):
        self.links = self.rng.choice(LINKS)
        self._allowed_links.append(self.links)
        self._call(self._setter, SetParameters.Request(parameters=[
            Parameter('link_lengths', value=self.links).to_parameter_msg(),
            Parameter('z_max', value=-7.0).to_parameter_msg()]))

    def _ask(self):
        for _ in range(3):
            self._call(self._solver, Trigger.Request())

    def _call(self, client, request):
        self.wait(client.service_is_ready, client.srv_name)
        self._pending.append(client.call_async(request))

    def _come_and_go(self):
        node = self._feed.node
        while self._visitors:
            node.destroy_subscription(self._visitors.pop())
        for kind, topic in ((MarkerArray, 'markers'), (Float64MultiArray, 'gradient')):
            self._visitors.append(node.create_subscription(
                kind, f'/singularity_monitor/{topic}', lambda _: None, 1))

    def _stop(self):
        self.process.popen.send_signal(signal.SIGSTOP)
        self._feed.linger(self.rng.choice([0.01, 2.0 * TIMEOUT]))
        self.process.popen.send_signal(signal.SIGCONT)

    def _replace_publisher(self):
        self._feed.node.destroy_publisher(self._publisher)
        self._publisher = self._feed.node.create_publisher(JointState, 'joint_states', 10)
        self.wait(self._publisher.get_subscription_count, 'the subscription')

    def _send_rubbish(self):
        for _ in range(BATCH):
            self._publisher.publish(b'\x00\x01\x00\x00' + self.rng.randbytes(
                self.rng.randrange(60)))


def check(status, allowed_links, sent):
    """OK and WARN only of angles that were sent, by their numbers, OK only within thresholds."""
    level = int.from_bytes(status.level, 'little')
    numbers = [_number(status, key) for key in ('z', 'conditioning length (m)', 'margin')]
    angles = [_number(status, f'angle of {name} (rad)') for name in NAMES]
    if level not in (Level.OK, Level.WARN):
        assert all(number != number for number in numbers), status
        return
    assert all(number == number for number in (*numbers, *angles)), status
    for name, angle in zip(NAMES, angles):
        assert f'{angle:.12g}' in sent[name], (name, status)
    if sum(map(abs, angles)) < MODERATE:
        candidates = [expected_numbers(links, angles) for links in allowed_links]
        expected = min(candidates, key=lambda candidate: abs(candidate.z - numbers[0]))
        # The diagnostics show twelve digits, of the angles too.
        assert_numbers(numbers, expected, 1e-7)
    thresholds = Thresholds()
    assert level == Level.WARN or (
        numbers[0] <= thresholds.z_max and numbers[2] >= thresholds.margin_min), status


def _number(status, key):
    return next(float(pair.value) for pair in status.values if pair.key == key)


def resident_megabytes(process):
    with open(f'/proc/{process.popen.pid}/statm') as file:
        return int(file.read().split()[1]) * resource.getpagesize() / 1e6


@pytest.mark.parametrize('executor_name', ['events', 'single'])
def test_among_all_faults(start, feed, soak, executor_name):
    process = start(*ARM, '-p', f'executor:={executor_name}', '-p', f'stale_timeout:={TIMEOUT}',
                    '-p', 'diagnostics_period:=0.0')
    world = World(feed, process, seed=executor_name)
    feed.until(lambda: world.statuses)
    faults, resident = soak(MESSAGES // PER_FAULT), []
    for _ in range(faults):
        world.live_through_a_fault(PER_FAULT)
        resident.append(resident_megabytes(process))
    growth = max(resident[-faults // 10:]) - max(resident[:max(10, faults // 10)])
    print(f'{executor_name}: {faults} faults in {faults * PER_FAULT} messages; resident memory '
          f'grew by {growth:.2f} MB to {resident[-1]:.1f} MB')
    assert growth < 3.0
    process.popen.send_signal(signal.SIGINT)
    assert_clean(process)
