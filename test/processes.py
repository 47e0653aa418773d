"""The installed executables as processes of their own, and a node that feeds them."""

import contextlib
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64
from support import DEADLINE, LENGTHS, linger, NAMES, REGULAR

EXECUTABLES = Path(sys.executable).parent
ARM = ['-p', f'joint_names:=[{", ".join(NAMES)}]',
       '-p', f'link_lengths:=[{", ".join(map(repr, LENGTHS))}]']


class Process:
    """An executable in a process group of its own."""

    def __init__(self, *arguments, executable='singularity_monitor'):
        self.popen = subprocess.Popen(
            [EXECUTABLES / executable, '--ros-args', *arguments], text=True,
            start_new_session=True, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE)

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

    def hear_flags(self):
        """Hear the proximity flag too; give the list that it goes to."""
        flags = []
        self.node.create_subscription(
            Bool, '/singularity_monitor/near_singularity',
            lambda message: flags.append(message.data), 100)
        return flags

    def until(self, condition, positions=REGULAR, period=0.01):
        """Publish until the condition holds."""
        deadline = time.monotonic() + DEADLINE
        while not condition():
            assert time.monotonic() < deadline, 'nothing heard of the process'
            self.publisher.publish(JointState(name=NAMES, position=positions))
            self.executor.spin_once(timeout_sec=period)

    def linger(self, seconds):
        """Spin for a time without publishing."""
        linger(self.executor, seconds)


def assert_clean(process):
    status, _, error = process.end()
    assert 'Traceback' not in error and 'Error' not in error, error
    assert status == 0, (status, error)
    assert group_ends(process.popen.pid), 'a process was left behind'


def group_ends(group, within=DEADLINE):
    """Tell whether every process of a group is gone in time."""
    deadline = time.monotonic() + within
    while time.monotonic() < deadline:
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.005)
    return False


def answer_of(feed):
    return [z for z in feed.heard if z == z]


def children_of(pid):
    children = []
    for task in Path(f'/proc/{pid}/task').iterdir():
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):
            children += (task / 'children').read_text().split()
    return list(map(int, children))
