"""The installed executable as a process of its own, and a node that feeds it."""

import contextlib
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from support import DEADLINE, LENGTHS, NAMES, REGULAR

EXECUTABLE = Path(sys.executable).parent / 'singularity_monitor'
ARM = ['-p', f'joint_names:=[{", ".join(NAMES)}]',
       '-p', f'link_lengths:=[{", ".join(map(repr, LENGTHS))}]']


class Process:
    """The executable in a process group of its own."""

    def __init__(self, *arguments):
        self.popen = subprocess.Popen(
            [EXECUTABLE, '--ros-args', *arguments], text=True, start_new_session=True,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    def end(self):
        """Wait for its end; give status, standard output and standard error."""
        output, error = self.popen.communicate(timeout=DEADLINE)
        return self.popen.returncode, output, error

    def kill_group(self):
        """End whatever is left of it, and tell whether anything was."""
        try:
            os.killpg(self.popen.pid, signal.SIGKILL)
        except ProcessLookupError:
            return False
        return True

    def group_is_empty(self):
        try:
            os.killpg(self.popen.pid, 0)
        except ProcessLookupError:
            return True
        return False


class Feed:
    """A node that publishes joint states and hears z."""

    def __init__(self, context, executor):
        self.executor = executor
        self.heard = []
        self.node = Node('feed', context=context)
        self.publisher = self.node.create_publisher(JointState, 'joint_states', 10)
        self.subscription = self.node.create_subscription(
            Float64, '/singularity_monitor/z', lambda message: self.heard.append(message.data), 10)
        executor.add_node(self.node)

    def close(self):
        self.executor.remove_node(self.node)
        self.node.destroy_node()

    def until(self, condition, positions=REGULAR, period=0.01):
        """Publish until the condition holds."""
        deadline = time.monotonic() + DEADLINE
        while not condition():
            assert time.monotonic() < deadline, 'nothing heard of the process'
            self.publisher.publish(JointState(name=NAMES, position=positions))
            self.executor.spin_once(timeout_sec=period)


def assert_clean(process):
    status, _, error = process.end()
    assert 'Traceback' not in error and 'Error' not in error, error
    assert status == 0, (status, error)
    deadline = time.monotonic() + DEADLINE
    while not process.group_is_empty():
        assert time.monotonic() < deadline, 'a process was left behind'
        time.sleep(0.01)


def answer_of(feed):
    return [z for z in feed.heard if z == z]


def children_of(pid):
    children = []
    for task in Path(f'/proc/{pid}/task').iterdir():
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):
            children += (task / 'children').read_text().split()
    return list(map(int, children))
