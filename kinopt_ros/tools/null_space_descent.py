"""
The example that closes the loop: null-space motion down the gradient that the monitor publishes.

Two simulated arms do one task, tip along a straight line at constant tool angle, from one first
posture. Each has a monitor of its own, a process beside this one. The arm `plain` moves by the
least joint rates; the arm `descending` adds null-space motion against the gradient of z that it
hears of its monitor. The tool angle is part of the task because it makes the task's Jacobian
the one whose singularities the monitor measures.
"""

import argparse
import math
from pathlib import Path
import sys
import time
from typing import NamedTuple

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64, Float64MultiArray

from kinopt_ros.kinetostatics.planar_arm import PlanarArm
from kinopt_ros.monitor.verdict import Thresholds
from kinopt_ros.tools.child_processes import run_with_children, use_private_domain
from kinopt_ros.tools.resolved_rate import LineFollower

JOINT_NAMES = ['joint_1', 'joint_2', 'joint_3', 'joint_4']
ARM = PlanarArm((0.5, 0.4, 0.3, 0.2))
START = [math.radians(angle) for angle in (134.0, 92.0, -17.0, -92.0)]
DISPLACEMENT = 0.8 + 0.0j
DURATION = 12.0
RATE_LIMIT = 1.0

# Gain in rad/s per 1/rad of the gradient of z.
DESCENT_GAIN = 2.0
# A gradient older than this (s) moves nothing.
GRADIENT_TIMEOUT = 0.1
PERIOD = 0.01
START_DEADLINE = 20.0
# How long (s) the arms are still heard at the end of the line.
AFTERMATH = 0.5


class Row(NamedTuple):
    """What a monitor said at time t (s) from the start of the line."""

    time: float
    z: float
    margin: float
    near_singularity: bool


class Step(NamedTuple):
    """Where a controller brought its arm by time t (s): rad, rad/s and m."""

    time: float
    joint_angles: list
    joint_rates: list
    demand: float
    distance: float
    angle_error: float


class Controller:
    """
    Move one simulated arm along the line and keep what its monitor says.

    Parameters
    ----------
    node : rclpy.node.Node
    namespace : str
        Of the joint states and of the monitor.
    duration : float
        Of the line in s.
    gain : float
        Gain of the null-space motion; with 0 the gradient is not even subscribed to.

    Attributes
    ----------
    heard : list of Row
    steps : list of Step
    """

    def __init__(self, node, namespace, duration, gain):
        self.heard, self.steps = [], []
        self.time = 0.0
        self._node = node
        self._gain = gain
        self._follower = LineFollower(ARM, START, DISPLACEMENT, duration, RATE_LIMIT)
        self._latest = {}
        self._gradient, self._gradient_time = [], -math.inf
        self._joint_states = node.create_publisher(JointState, f'{namespace}/joint_states', 10)
        monitor = f'{namespace}/singularity_monitor'
        for name in ('z', 'margin'):
            node.create_subscription(Float64, f'{monitor}/{name}', self._keeper(name), 10)
        node.create_subscription(Bool, f'{monitor}/near_singularity', self._on_flag, 10)
        if gain > 0.0:
            node.create_subscription(
                Float64MultiArray, f'{monitor}/gradient', self._on_gradient, 10)

    def _keeper(self, name):
        def keep(message):
            self._latest[name] = message.data
        return keep

    def _on_flag(self, message):
        # The flag comes after the numbers of its cycle; before the first posture they are NaN.
        if len(self._latest) == 2 and math.isfinite(self._latest['z']):
            self.heard.append(Row(
                self.time, **self._latest, near_singularity=message.data))

    def _on_gradient(self, message):
        self._gradient, self._gradient_time = message.data, time.monotonic()

    @property
    def is_ready(self):
        """Whether the monitor answers."""
        return bool(self.heard) and (self._gain == 0.0 or self._has_gradient())

    def _has_gradient(self):
        # It is empty while the monitor does not know the posture.
        return (len(self._gradient) == ARM.n_joints
                and time.monotonic() - self._gradient_time < GRADIENT_TIMEOUT)

    def hold(self):
        """Publish the posture, at rest."""
        self._publish([0.0] * ARM.n_joints)

    def step(self):
        """Move for one period and publish."""
        descent = [0.0] * ARM.n_joints
        if self._gain > 0.0 and self._has_gradient():
            descent = [-self._gain * slope for slope in self._gradient]
        follower = self._follower
        follower.step(self.time, PERIOD, descent)
        self.time += PERIOD
        self.steps.append(Step(
            self.time, follower.joint_angles, follower.joint_rates, follower.demand,
            follower.distance, follower.angle_error))
        self._publish(follower.joint_rates)

    def _publish(self, joint_rates):
        message = JointState(
            name=JOINT_NAMES, position=self._follower.joint_angles, velocity=joint_rates)
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._joint_states.publish(message)


def main(args=None):
    """Run the example; the exit status is returned."""
    parser = argparse.ArgumentParser(
        description='Follow a line with a redundant arm, with and without null-space motion '
                    'down the gradient of z that the monitor publishes.')
    parser.add_argument('--picture', type=Path, default=Path('output/null_space_descent.png'),
                        help='where the picture goes (default: %(default)s)')
    parser.add_argument('--seconds', type=float, default=DURATION,
                        help='time for the line (default: %(default)s)')
    options = parser.parse_args(args)
    if not 1.0 <= options.seconds <= 3600.0:
        parser.error(f'argument --seconds: {options.seconds:g} is not within 1..3600')
    use_private_domain()
    arm = ['-p', f'joint_names:=[{", ".join(JOINT_NAMES)}]',
           '-p', f'link_lengths:=[{", ".join(map(repr, ARM.link_lengths))}]']

    def follow(processes):
        for namespace in ('plain', 'descending'):
            processes.start('singularity_monitor', '-r', f'__ns:=/{namespace}', *arm)
        return _run(options.seconds, processes)

    return run_with_children(follow, lambda arms: _report(*arms, options.picture))


def _report(plain, descending, path):
    print(_table(plain, descending))
    return _draw(plain, descending, path)


def _run(duration, processes):
    """Bring both arms along the line; give their controllers."""
    context = rclpy.Context()
    context.init()
    node = Node('null_space_descent', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)

    def repeat(action, is_done):
        timer = node.create_timer(
            PERIOD, lambda: [action(controller) for controller in controllers],
            clock=Clock(clock_type=ClockType.STEADY_TIME))
        while not is_done():
            executor.spin_once(timeout_sec=1.0)
            processes.check()
        node.destroy_timer(timer)

    try:
        controllers = plain, descending = (Controller(node, '/plain', duration, 0.0),
                                           Controller(node, '/descending', duration, DESCENT_GAIN))
        deadline = time.monotonic() + START_DEADLINE
        repeat(Controller.hold, lambda: _are_ready(controllers, deadline))
        print(f'following a line of {abs(DISPLACEMENT):g} m for {duration:g} s', flush=True)
        repeat(Controller.step, lambda: plain.time > duration + AFTERMATH)
        return plain, descending
    finally:
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()


def _are_ready(controllers, deadline):
    if time.monotonic() > deadline:
        raise TimeoutError(f'a monitor was not heard for {START_DEADLINE:g} s')
    return all(controller.is_ready for controller in controllers)


def _time_flagged(rows):
    return sum(after.time - row.time for row, after in zip(rows, rows[1:])
               if row.near_singularity)


# What is told of each arm: name, decimals, and the number.
FIGURES = (
    ('worst margin', 3, lambda arm: min(row.margin for row in arm.heard)),
    ('largest z', 3, lambda arm: max(row.z for row in arm.heard)),
    ('time flagged (s)', 2, lambda arm: _time_flagged(arm.heard)),
    ('largest position error (mm)', 2,
     lambda arm: 1000.0 * max(step.distance for step in arm.steps)),
    ('largest error of the tool angle (deg)', 2,
     lambda arm: math.degrees(max(step.angle_error for step in arm.steps))),
    ('largest joint rate needed (rad/s)', 2, lambda arm: max(step.demand for step in arm.steps)),
    ('largest joint rate (rad/s)', 2,
     lambda arm: max(max(map(abs, step.joint_rates)) for step in arm.steps)),
)


def _table(plain, descending):
    """Give the results of both arms side by side, as text."""
    return '\n'.join([
        f'{"":38}{"plain":>8}{"descending":>13}',
        *(f'{name:38}{figure(plain):8.{decimals}f}{figure(descending):13.{decimals}f}'
          for name, decimals, figure in FIGURES)])


def _draw(plain, descending, path):
    try:
        from kinopt_ros.tools.pictures.null_space import null_space_figure
        from kinopt_ros.tools.pictures.style import draw
    except ImportError as error:
        print(f'error: no picture without matplotlib ({error})', file=sys.stderr)
        return 1
    draw(path, null_space_figure, ARM, plain, descending, Thresholds())
    print(f'picture: {path}')
    return 0
