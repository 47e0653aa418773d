"""A node that hears what a monitor publishes and keeps it, cycle by cycle."""

import time
from typing import NamedTuple

import rclpy
from rclpy.node import Node
from std_msgs.msg import Bool, Float64


class Row(NamedTuple):
    """What was published in one cycle; time in s on the monotonic clock, lengths in m."""

    time: float
    z: float
    conditioning_length: float
    margin: float
    near_singularity: bool


class Recorder:
    """
    Record the topics of a monitor, in a ROS context of its own.

    Parameters
    ----------
    monitor : str
        Name of the monitor's node.

    Attributes
    ----------
    rows : list of Row
    """

    def __init__(self, monitor):
        self.rows = []
        self._latest = {}
        self._context = rclpy.Context()
        self._context.init()
        self._node = Node('recorder', context=self._context)
        self._executor = rclpy.executors.SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        for name in ('z', 'conditioning_length', 'margin'):
            self._node.create_subscription(
                Float64, f'{monitor}/{name}', self._keeper(name), 100)
        self._node.create_subscription(
            Bool, f'{monitor}/near_singularity', self._end_of_cycle, 100)

    def _keeper(self, name):
        def keep(message):
            self._latest[name] = message.data
        return keep

    def _end_of_cycle(self, message):
        # The flag is published last.
        if len(self._latest) == 3:
            self.rows.append(Row(
                time.monotonic(), **self._latest, near_singularity=message.data))

    def spin_for(self, seconds):
        """Listen for a while."""
        end = time.monotonic() + seconds
        while (remaining := end - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=remaining)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()
