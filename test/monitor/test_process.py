"""The installed executable as a process of its own, over DDS."""

import os
import signal
import subprocess
import sys
import time

from processes import answer_of, ARM, assert_clean, children_of, group_ends
import pytest
from support import DEADLINE, expected_numbers, LENGTHS, NAMES, REGULAR


@pytest.mark.parametrize('signals', [
    [signal.SIGINT], [signal.SIGTERM], [signal.SIGINT, signal.SIGINT],
    [signal.SIGTERM, signal.SIGTERM], [signal.SIGINT, signal.SIGTERM],
    [signal.SIGTERM, signal.SIGINT, signal.SIGINT]],
    ids=lambda signals: ' '.join(s.name for s in signals))
def test_fed_over_dds_and_stopped(start, feed, signals):
    process = start(*ARM)
    feed.until(lambda: answer_of(feed))
    assert answer_of(feed)[0] == pytest.approx(expected_numbers(LENGTHS, REGULAR).z, abs=1e-9)
    for number in signals:
        process.popen.send_signal(number)
    assert_clean(process)


@pytest.mark.parametrize('gap', [0.0005, 0.005, 0.02, 0.05, 0.1])
def test_second_signal_at_any_moment_of_the_end(start, feed, gap):
    process = start(*ARM)
    feed.until(lambda: answer_of(feed))
    process.popen.send_signal(signal.SIGINT)
    deadline = time.monotonic() + gap
    while process.popen.poll() is None and time.monotonic() < deadline:
        time.sleep(0.0005)
    process.popen.send_signal(signal.SIGTERM)
    assert_clean(process)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_stopped_while_it_publishes(start, feed, number):
    """Flooded, the process is almost always within a callback; diagnostics each cycle too."""
    process = start(*ARM, '-p', 'diagnostics_period:=0.0')
    feed.until(lambda: len(answer_of(feed)) > 50, period=0.0)
    process.popen.send_signal(number)
    feed.until(lambda: process.popen.poll() is not None, period=0.0)
    assert_clean(process)


def test_interrupt_from_the_terminal_reaches_the_whole_group(start, feed):
    process = start(*ARM)
    feed.until(lambda: answer_of(feed))
    os.killpg(process.popen.pid, signal.SIGINT)
    os.killpg(process.popen.pid, signal.SIGINT)
    assert_clean(process)


@pytest.mark.parametrize('delay', [0.15, 0.25, 0.35, 0.5])
def test_stopped_while_it_starts(start, delay):
    process = start(*ARM)
    deadline = time.monotonic() + delay
    while time.monotonic() < deadline:
        time.sleep(0.005)
    process.popen.send_signal(signal.SIGTERM)
    status, _, error = process.end()
    assert 'Traceback' not in error, error
    # Before the interpreter has run any line of the package the signal ends it by itself.
    assert status in (0, -signal.SIGTERM), (status, error)
    assert status == 0 or delay < 0.2


def test_nothing_is_left_when_it_is_killed(start):
    """
    Killed while its solver runs.

    No node listens here: a node of rclpy that was destroyed right after its peer had been
    killed crashed once in some twenty runs.
    """
    process = start(*ARM)
    deadline = time.monotonic() + DEADLINE
    while not children_of(process.popen.pid):
        assert time.monotonic() < deadline, 'no solver was started'
        time.sleep(0.01)
    process.popen.kill()
    process.end()
    assert group_ends(process.popen.pid), 'a process was left behind'


def complaints(error):
    """Give the lines on stderr that are not a log record of a level of ROS's own choice."""
    return [line for line in error.strip().splitlines()
            if not line.startswith('[INFO]') and '[rcl]: ' not in line]


BAD_START = {
    'no parameters': ([], ['joint_names', 'required']),
    'no link lengths': (ARM[:2], ['link_lengths', 'required']),
    'two links': ([*ARM[:2], '-p', 'link_lengths:=[1.0, 1.0]'], ['link_lengths', '3']),
    'negative link': ([*ARM, '-p', 'link_lengths:=[1.0, -1.0, 1.0]'], ['link_lengths', '-1.0']),
    'nan': ([*ARM, '-p', 'link_lengths:=[1.0, .nan, 1.0]'], ['link_lengths', 'nan']),
    'integers': ([*ARM, '-p', 'link_lengths:=[1, 1, 1]'], ['link_lengths', '1.0, not 1']),
    'duplicate': ([*ARM, '-p', 'joint_names:=[a, b, a]'], ['joint_names', "'a'"]),
    'one number': ([*ARM, '-p', 'joint_names:=7'], ['joint_names', '7']),
    'out of range': ([*ARM, '-p', 'z_max:=1.5'], ['z_max', '1.5']),
    'word': ([*ARM, '-p', 'hysteresis:=much'], ['hysteresis', 'much']),
    'integer': ([*ARM, '-p', 'stale_timeout:=1'], ['stale_timeout', '1']),
    'negative time': ([*ARM, '-p', 'diagnostics_period:=-1.0'], ['diagnostics_period', '-1']),
    'direction': ([*ARM, '-p', 'joint_directions:=[1, 1, 0]'], ['joint_directions', '0']),
    'offset': ([*ARM, '-p', 'joint_offsets:=[.inf, 0.0, 0.0]'], ['joint_offsets', 'inf']),
    'no such file': (['--params-file', '/nonexistent/arm.yaml'], ['/nonexistent/arm.yaml']),
    'bad argument': (['-p', 'z_max'], ['z_max']),
    'quality of service': (
        [*ARM, '-p', 'qos_overrides./joint_states.subscription.reliability:=sometimes'],
        ['reliability', 'sometimes']),
    'negative depth': (
        [*ARM, '-p', 'qos_overrides./joint_states.subscription.depth:=-1'], ['joint_states']),
    'depth': ([*ARM, '-p', 'qos_overrides./joint_states.subscription.depth:=many'],
              ['depth', 'many']),
    'sim time': ([*ARM, '-p', 'use_sim_time:=maybe'], ['use_sim_time', 'maybe']),
}


@pytest.mark.parametrize('case', BAD_START)
def test_bad_start_is_one_line_and_status_1(start, case):
    arguments, words = BAD_START[case]
    status, output, error = start(*arguments).end()
    assert 'Traceback' not in output + error, error
    assert status == 1, error
    line, = complaints(error)
    for word in words:
        assert word in line, error


def test_parameter_file(start, feed, tmp_path):
    path = tmp_path / 'arm.yaml'
    path.write_text(
        '/**:\n  ros__parameters:\n'
        f'    joint_names: [{", ".join(NAMES)}]\n    link_lengths: [0.5, 0.4, 0.3]\n')
    process = start('--params-file', str(path))
    feed.until(lambda: answer_of(feed))
    expected = expected_numbers([0.5, 0.4, 0.3], REGULAR).z
    assert answer_of(feed)[0] == pytest.approx(expected, abs=1e-9)
    process.popen.send_signal(signal.SIGINT)
    assert_clean(process)


def test_bad_parameter_file_is_one_line_and_status_1(start, tmp_path):
    path = tmp_path / 'arm.yaml'
    path.write_text('singularity_monitor:\n  ros__parameters:\n    joint_names: [a, b\n')
    status, output, error = start('--params-file', str(path)).end()
    assert 'Traceback' not in output + error
    assert (status, len(complaints(error))) == (1, 1), error
    assert str(path) in error


@pytest.mark.parametrize('text', ['link_lengths: []', 'link_lengths: [1.0, 1, 1.0]'])
def test_odd_parameter_file(start, tmp_path, text):
    path = tmp_path / 'arm.yaml'
    path.write_text(f'/**:\n  ros__parameters:\n    joint_names: [a, b, c]\n    {text}\n')
    status, output, error = start('--params-file', str(path)).end()
    assert 'Traceback' not in output + error
    assert (status, len(complaints(error))) == (1, 1), error


RUN = """
import signal
import sys
import rclpy
from rclpy.node import Node
from std_msgs.msg import Float64
from kinopt_ros.monitor import process

def interrupted():
    # Of a signal to the whole process another thread may take note, and later than the error.
    signal.raise_signal(signal.SIGINT)
    {error}

def defective():
    {error}

def shut_down_elsewhere():
    node = Node('node')
    node.declare_parameter('executor', 'single')
    publisher = node.create_publisher(Float64, 'x', 1)
    def shut_down():
        rclpy.shutdown()
        publisher.publish(Float64())
    node.create_timer(0.01, shut_down)
    return node

def broken_callback():
    node = Node('node')
    def fail():
        {error}
    node.create_timer(0.01, fail)
    return node

sys.exit(process.run({make_node}))
"""


def run_node(make_node, error='pass'):
    return subprocess.run(
        [sys.executable, '-c', RUN.format(make_node=make_node, error=error)],
        capture_output=True, text=True, timeout=DEADLINE)


@pytest.mark.parametrize('error', ["raise ValueError('of a context that is gone')",
                                   "raise RuntimeError('context is invalid')"])
def test_error_of_an_interrupted_start_is_no_error(error):
    """Whatever fails while the context goes down under it: the user wanted it to end."""
    done = run_node('interrupted', error)
    assert (done.returncode, done.stderr) == (0, '')


def test_shutdown_of_the_context_ends_it_cleanly():
    """
    No signal at all, and a callback that publishes on the way out.

    The EventsExecutor ends cleanly too, but logs the error of that callback by itself.
    """
    done = run_node('shut_down_elsewhere')
    assert (done.returncode, done.stderr) == (0, '')


@pytest.mark.parametrize('make_node', ['defective', 'broken_callback'])
@pytest.mark.parametrize('error', ["raise RuntimeError('a defect')", "raise KeyError('a defect')"])
def test_defect_is_not_hidden(make_node, error):
    done = run_node(make_node, error)
    assert done.returncode != 0
    assert 'Traceback' in done.stderr and 'a defect' in done.stderr


def test_value_error_of_a_callback_is_not_told_as_bad_input():
    """Bad input ends the start in one line; a defect later shows where it is."""
    done = run_node('broken_callback', "raise ValueError('a defect')")
    assert done.returncode != 0
    assert 'Traceback' in done.stderr
