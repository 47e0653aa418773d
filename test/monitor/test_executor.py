"""The two executors: their choice, their fall-back, and what a defect in a callback does."""

import signal
import subprocess
import sys
import time

import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Float64
from support import DEADLINE, LENGTHS, NAMES

from kinopt_ros.monitor import process

EXECUTORS = ('events', 'single')
ARM = ['--ros-args', '-p', f'joint_names:=[{", ".join(NAMES)}]',
       '-p', f'link_lengths:=[{", ".join(map(repr, LENGTHS))}]']

START = """
import sys
{before}
from kinopt_ros.monitor.singularity_monitor import SingularityMonitor
from kinopt_ros.monitor import process
{behind}
sys.exit(process.run(SingularityMonitor, {arguments!r}))
"""

WITHOUT_EVENTS = "sys.modules['rclpy.experimental.events_executor'] = None"

# Each of these raises in a callback that an executor calls.
DEFECTS = {
    'timer': 'SingularityMonitor._on_watchdog = defect',
    'subscription': 'SingularityMonitor._on_joint_state = defect',
    'parameter service': 'SingularityMonitor._on_configuration = defect',
}
DEFECT = """
import rclpy
from rclpy.parameter import Parameter
from rcl_interfaces.srv import SetParameters
from sensor_msgs.msg import JointState

def defect(*_):
    raise ValueError('a defect')

class SingularityMonitor(SingularityMonitor):
    def __init__(self, **options):
        super().__init__(**options)
        publisher = self.create_publisher(JointState, 'joint_states', 1)
        client = self.create_client(SetParameters, '~/set_parameters')
        change = Parameter('z_max', value=0.8).to_parameter_msg()
        def trigger():
            publisher.publish(JointState())
            client.call_async(SetParameters.Request(parameters=[change]))
        self._steady_timer(0.05, trigger)

"""


class Log:
    """What an executor's choice logs."""

    def __init__(self):
        self.lines = []

    def warning(self, line):
        self.lines.append(line)


@pytest.fixture
def start():
    """Give a factory of processes that all end with the test."""
    processes = []

    def make(before='', behind='', arguments=()):
        code = START.format(before=before, behind=behind, arguments=['node', *ARM, *arguments])
        processes.append(subprocess.Popen(
            [sys.executable, '-c', code], text=True, stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE, stdin=subprocess.DEVNULL))
        return processes[-1]

    yield make
    for node in processes:
        node.kill()
        node.communicate()


def test_events_is_the_default(bench):
    assert bench.get('executor') == 'events'
    descriptor, = bench.describe('executor')
    assert descriptor.read_only
    assert not bench.set(executor='single')[0].successful


def test_choice(context, monkeypatch):
    made = []
    monkeypatch.setattr(process, '_EXECUTORS', {name: lambda name=name: made.append(name) or name
                                                for name in EXECUTORS})
    for name in EXECUTORS:
        assert process.make_executor(name, Log()) == name
    assert made == ['events', 'single']


def test_kinds():
    import rclpy
    rclpy.init(args=[])
    try:
        for name in EXECUTORS:
            executor = process.make_executor(name, Log())
            assert isinstance(executor, SingleThreadedExecutor) is (name == 'single')
            executor.shutdown()
    finally:
        rclpy.shutdown()


@pytest.mark.parametrize('error', [ImportError('not there'), RuntimeError('refused')])
@pytest.mark.parametrize('name', EXECUTORS)
def test_fall_back_is_told_in_one_line(monkeypatch, name, error):
    def refuse():
        raise error
    other, = set(EXECUTORS) - {name}
    monkeypatch.setattr(process, '_EXECUTORS', {name: refuse, other: lambda: other})
    log = Log()
    assert process.make_executor(name, log) == other
    line, = log.lines
    assert name in line and other in line and str(error) in line


@pytest.mark.parametrize('name', ['', 'multi', 'Events'])
def test_unknown_executor_is_one_line_and_status_1(start, name):
    node = start(arguments=['-p', f"executor:='{name}'"])
    _, error = node.communicate(timeout=DEADLINE)
    assert node.returncode == 1
    line, = (line for line in error.splitlines() if not line.startswith('[INFO]'))
    assert 'executor' in line and f"'{name}'" in line and 'single' in line


def test_runs_where_rclpy_has_no_events_executor(start):
    node = start(before=WITHOUT_EVENTS)
    lines = []
    deadline = time.monotonic() + DEADLINE
    while not any("no executor 'events'" in line for line in lines):
        assert time.monotonic() < deadline
        lines.append(node.stderr.readline())
    node.send_signal(signal.SIGINT)
    _, error = node.communicate(timeout=DEADLINE)
    assert node.returncode == 0
    assert 'Traceback' not in error


@pytest.mark.parametrize('place', DEFECTS)
@pytest.mark.parametrize('name', EXECUTORS)
def test_defect_in_a_callback_ends_the_process_with_status_1(start, name, place):
    """Neither a crash of the interpreter nor a node that lives on half dead."""
    node = start(behind=DEFECT + DEFECTS[place], arguments=['-p', f'executor:={name}'])
    _, error = node.communicate(timeout=DEADLINE)
    assert node.returncode == 1, error
    assert 'Traceback' in error and 'ValueError: a defect' in error


def test_topics_that_come_and_go_while_it_runs(context, executor, soak):
    """Upstream a crash is reported; with both made and destroyed in callbacks there is none."""
    node = Node('node', context=context)
    cycles, heard = [], []

    def come_and_go():
        publisher = node.create_publisher(Float64, 'topic', 10)
        subscription = node.create_subscription(Float64, 'topic', heard.append, 10)
        publisher.publish(Float64())
        node.destroy_publisher(publisher)
        node.destroy_subscription(subscription)
        cycles.append(len(heard))

    node.create_subscription(Float64, 'topic', heard.append, 10)
    node.create_timer(0.001, come_and_go)
    executor.add_node(node)
    deadline = time.monotonic() + soak(DEADLINE)
    while len(cycles) < soak(200):
        assert time.monotonic() < deadline
        executor.spin_once(timeout_sec=0.01)
    executor.remove_node(node)
    node.destroy_node()


def test_timer_that_is_set_anew_while_it_runs(make_bench):
    """The node moves its watchdog so; here with whatever executor spins the tests."""
    bench = make_bench({'stale_timeout': 3600.0})
    fired = []
    timer = bench.monitor._steady_timer(3600.0, lambda: fired.append(time.monotonic()))
    bench.linger(0.05)
    assert not fired
    timer.timer_period_ns = 20_000_000
    timer.reset()
    bench.wait(lambda: len(fired) >= 3, 'three ticks')
    timer.timer_period_ns = 3600 * 10**9
    timer.reset()
    count = len(fired)
    bench.linger(0.1)
    assert len(fired) <= count + 1
    assert bench.set(stale_timeout=0.05)[0].successful
    bench.wait(lambda: bench.cycles, 'staleness at the new time-out')
