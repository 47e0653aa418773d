"""SIGINT and SIGTERM at random moments: status 0, nothing on stderr but the log, no orphan."""

import contextlib
import os
import random
import signal
import subprocess
import sys
import time

from diagnostic_msgs.msg import DiagnosticArray
from processes import ARM, group_ends
import pytest
from sensor_msgs.msg import JointState
from support import DEADLINE, expected_numbers, LENGTHS, NAMES, REGULAR

SIGNALS = 20
LATEST = 1.2
# Of the moments that are counted from the first answer on, when every message is answered.
LATEST_ANSWERED = 0.1
FEED_PERIOD = 0.001

STARTS = 10
LATEST_IN_START = 0.6

# The executable, which tells when its main has begun, and whether anything slow came before it.
EXECUTABLE = """
import sys
from kinopt_ros import executables
from kinopt_ros.monitor import signals

def begin(end_at_once=signals.end_at_once):
    end_at_once()
    print('begun', *{'numpy', 'rclpy'}.intersection(sys.modules), flush=True)

signals.end_at_once = begin
sys.exit(executables.singularity_monitor())
"""


@pytest.fixture(autouse=True)
def interrupts():
    """Have SIGINT not ignored: a shell's background job is, and hands that on to its children."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def spawned(*arguments):
    """Give the executable as a process that ends with the block."""
    node = subprocess.Popen(
        [sys.executable, '-c', EXECUTABLE, '--ros-args', *ARM, *arguments],
        text=True, start_new_session=True, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE)
    try:
        yield node
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(node.pid, signal.SIGKILL)
        node.communicate()


def end_of(node, number, delay):
    """Wait for its end; give standard output and standard error."""
    try:
        return node.communicate(timeout=DEADLINE)
    except subprocess.TimeoutExpired:
        pytest.fail(f'{number!r} at {delay} s: no end within {DEADLINE} s')


def assert_ended(node, error, number, delay):
    """Assert an end as it has to be once main has begun."""
    assert node.returncode == 0, (number, delay, node.returncode, error)
    assert all(line.startswith('[INFO]') for line in error.splitlines()), (number, delay, error)
    assert group_ends(node.pid, within=5.0), (number, delay)


@pytest.mark.parametrize('spun_by', ['events', 'single'])
def test_at_random_moments(soak, spun_by):
    rng = random.Random(8)
    for _ in range(soak(SIGNALS // 4)):
        number = rng.choice([signal.SIGINT, signal.SIGTERM])
        with spawned('-p', f'executor:={spun_by}') as node:
            assert node.stdout.readline() == 'begun\n'
            delay = rng.uniform(0.0, LATEST)
            time.sleep(delay)
            node.send_signal(number)
            _, error = end_of(node, number, delay)
            assert_ended(node, error, number, delay)


class FastFeed:
    """Joint states at 1 kHz for a process of which all that each cycle says is listened to."""

    def __init__(self, feed):
        self.feed = feed
        self.due = time.monotonic()
        feed.node.create_subscription(DiagnosticArray, '/diagnostics', lambda _: None, 10)

    def until(self, condition, positions):
        deadline = time.monotonic() + DEADLINE
        while not condition():
            assert time.monotonic() < deadline, 'the process neither answers nor ends'
            if time.monotonic() >= self.due:
                self.due = time.monotonic() + FEED_PERIOD
                self.feed.publisher.publish(JointState(name=NAMES, position=positions))
            self.feed.executor.spin_once(timeout_sec=FEED_PERIOD / 4.0)

    def has_answer(self, positions):
        """Tell whether the answer to these is what was heard last."""
        z = expected_numbers(LENGTHS, positions).z
        return lambda: bool(self.feed.heard) and abs(self.feed.heard[-1] - z) < 1e-9


@pytest.mark.parametrize('spun_by', ['events', 'single'])
def test_at_random_moments_while_fed(soak, feed, spun_by):
    """
    Callbacks publish numbers, flag and diagnostics all the time, for somebody.

    Every other moment is counted from the first answer on, for the start takes a good part of
    the others.
    """
    fast, rng = FastFeed(feed), random.Random(9)
    for step in range(soak(SIGNALS // 4)):
        number, from_answer = rng.choice([signal.SIGINT, signal.SIGTERM]), step % 2 == 0
        # A posture for each process: what was left unread of the one before is no answer.
        positions = [REGULAR[0], REGULAR[1] + 0.001 * step, REGULAR[2]]
        delay = rng.uniform(0.0, LATEST_ANSWERED if from_answer else LATEST)
        with spawned('-p', f'executor:={spun_by}', '-p', 'diagnostics_period:=0.0') as node:
            assert node.stdout.readline() == 'begun\n'
            if from_answer:
                fast.until(fast.has_answer(positions), positions)
            moment = time.monotonic() + delay
            fast.until(lambda moment=moment: time.monotonic() >= moment, positions)
            node.send_signal(number)
            fast.until(lambda node=node: node.poll() is not None, positions)
            _, error = end_of(node, number, delay)
            assert_ended(node, error, number, delay)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_at_random_moments_of_the_start(soak, number):
    """
    Counted from the spawn: clean as soon as main has begun.

    Before that no line of ours has run, and the interpreter ends by its own rules. It is the
    interpreter alone: what takes long to import comes after main has begun.
    """
    rng, begun = random.Random(f'start {number.name}'), 0
    for _ in range(soak(STARTS // 2)):
        delay = rng.uniform(0.0, LATEST_IN_START)
        with spawned() as node:
            time.sleep(delay)
            node.send_signal(number)
            output, error = end_of(node, number, delay)
            if output:
                begun += 1
                assert output == 'begun\n', (delay, output)
                assert_ended(node, error, number, delay)
            else:
                assert_ended_by_interpreter(node, error, number, delay)
    assert begun, f'no process began within {LATEST_IN_START} s: too slow a machine for this test'


def assert_ended_by_interpreter(node, error, number, delay):
    """Assert an end before main: of SIGTERM silent, of SIGINT perhaps with its traceback."""
    statuses = {signal.SIGTERM: (0, -number), signal.SIGINT: (0, 1, -number)}[number]
    assert node.returncode in statuses, (number, delay, node.returncode, error)
    assert not error or 'KeyboardInterrupt' in error, (number, delay, error)
    assert group_ends(node.pid, within=5.0), (number, delay)
