"""A simulated planar arm: it publishes joint states along a path worth watching."""

import math

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from kinopt_ros.kinetostatics.optimal_posture import optimal_posture
from kinopt_ros.monitor.configuration import MeasuredArm
from kinopt_ros.monitor.parameters import ARM_TABLE, declare, EXECUTOR, ParameterRow
from kinopt_ros.monitor.process import run

TABLE = (
    EXECUTOR,
    *ARM_TABLE,
    ParameterRow(
        'rate', Parameter.Type.DOUBLE, 100.0,
        'Rate of the joint states in Hz.', 'Within 0.1..10000; read-only.',
        (0.1, 10000.0), read_only=True),
    ParameterRow(
        'period', Parameter.Type.DOUBLE, 10.0,
        'Time in s for once around the path.', 'Within 0.1..3600; read-only.',
        (0.1, 3600.0), read_only=True),
)


class ClosedPath:
    """
    A closed path from the best posture through a singular one to the mirror image and back.

    The conditioning joints follow theta_j(t) = theta*_j cos(2 pi t / period), theta* the optimal
    posture: at a quarter and three quarters of the period the arm is stretched out straight,
    which is singular. The first joint swings a quarter turn either way.

    Parameters
    ----------
    planar_arm : PlanarArm
    period : float
        In s.
    """

    def __init__(self, planar_arm, period):
        self._best = optimal_posture(planar_arm).joint_angles
        self._rate = 2.0 * math.pi / period

    def joint_angles(self, t):
        """Relative joint angles in rad at time t (s)."""
        phase = self._rate * t
        return [0.5 * math.pi * math.sin(phase),
                *(best * math.cos(phase) for best in self._best[1:])]

    def joint_rates(self, t):
        """Joint rates in rad/s at time t (s)."""
        phase = self._rate * t
        return [0.5 * math.pi * self._rate * math.cos(phase),
                *(-best * self._rate * math.sin(phase) for best in self._best[1:])]


class SimulatedArm(Node):
    """Publish the joint states of a planar arm that moves along a closed path."""

    def __init__(self, **node_options):
        super().__init__('simulated_arm', **node_options)
        values = declare(self, TABLE)
        self._arm = MeasuredArm.from_parameters(values)
        self._path = ClosedPath(self._arm.planar_arm, values['period'])
        self._steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._start = self._steady_clock.now()
        self._joint_states = self.create_publisher(JointState, 'joint_states', 10)
        self.create_timer(1.0 / values['rate'], self._publish, clock=self._steady_clock)

    def _publish(self):
        t = (self._steady_clock.now() - self._start).nanoseconds * 1e-9
        message = JointState(
            name=self._arm.joint_names,
            position=self._arm.joint_positions(self._path.joint_angles(t)),
            velocity=[direction * rate for direction, rate in zip(
                self._arm.joint_directions, self._path.joint_rates(t))])
        message.header.stamp = self.get_clock().now().to_msg()
        self._joint_states.publish(message)


def main(args=None):
    """Run the node until it is told to end; the exit status is returned."""
    return run(SimulatedArm, args)
