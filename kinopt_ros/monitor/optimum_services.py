"""Optimal postures for others: the service, and the latched topic that follows the parameters."""

from concurrent.futures import Future
import json

from rclpy.exceptions import InvalidHandle
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from kinopt_ros.kinetostatics.posture_record import optimal_posture_record
from kinopt_ros.monitor.deferred_service import create_deferred_service
from kinopt_ros.monitor.solver_process import SolverProcess

LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)

# Requests that may wait for the solver; more are refused at once.
MOST_WAITING = 8


class OptimumServices:
    """
    Offer the optimal posture of a monitored arm on a node.

    Parameters
    ----------
    node : rclpy.node.Node
    monitor : PostureMonitor
        Tells the arm and its present posture.
    """

    def __init__(self, node, monitor):
        self._node = node
        self._monitor = monitor
        self._solver = SolverProcess()
        self._latest_arm = self._announcement = None
        # An arm with its radius in one piece, as the solver's thread writes it.
        self._circle = (None, None)
        self._publisher = node.create_publisher(JointState, '~/optimal_posture', LATCHED)
        create_deferred_service(node, Trigger, '~/get_optimal_posture', self._on_trigger)

    def announce(self):
        """Publish the optimum of the arm as it is now, once the solver has found it."""
        arm = self._monitor.configuration.arm
        if arm == self._latest_arm:
            return
        self._latest_arm = arm
        if self._announcement is not None:
            # Of several changes in a row only the last is worth solving for.
            self._announcement.cancel()
        self._announcement = self._solve_for(arm)
        self._announcement.add_done_callback(lambda done: self._publish(arm, done))

    def close(self):
        """End the solver."""
        self._latest_arm = None
        self._solver.close()

    @property
    def circle_radius(self):
        """Radius in m of the conditioning circle of the arm; None while it is not known."""
        arm, radius = self._circle
        return radius if arm is self._latest_arm else None

    @property
    def is_busy(self):
        """Whether so many requests wait that more are to be refused."""
        return self._solver.waiting >= MOST_WAITING

    @property
    def busy_reason(self):
        """Reason of such a refusal."""
        return f'busy: {self._solver.waiting} requests are waiting for the solver'

    def solve(self, *arguments):
        """Ask the solver; see `SolverProcess.submit`."""
        return self._solver.submit(*arguments)

    def _solve_for(self, arm):
        return self.solve(
            arm.planar_arm.link_lengths, *arm.angles_between(arm.joint_lower, arm.joint_upper),
            arm.joint_angles(self._monitor.reference_positions))

    def _publish(self, arm, done):
        if done.cancelled() or arm is not self._latest_arm:
            return
        if done.exception() is not None:
            self._node.get_logger().error(f'no optimal posture: {done.exception()}')
            return
        self._circle = (arm, done.result().circle_radius)
        message = JointState(
            name=arm.joint_names, position=arm.joint_positions(done.result().joint_angles))
        message.header.stamp = self._node.get_clock().now().to_msg()
        try:
            self._publisher.publish(message)
        except (InvalidHandle, rclpy_implementation.RCLError):
            pass  # The node is on its way out.

    def _on_trigger(self, _):
        arm = self._monitor.configuration.arm
        if self.is_busy:
            return completed(Trigger.Response(success=False, message=self.busy_reason))
        return mapped(self._solve_for(arm), lambda solved: _trigger_response(arm, solved))


def _trigger_response(arm, solved):
    if solved.exception() is not None:
        return Trigger.Response(success=False, message=str(solved.exception()))
    record = optimal_posture_record(arm.joint_names, solved.result(), arm.joint_positions)
    return Trigger.Response(success=True, message=json.dumps(record))


def completed(result):
    """Give a future that has its result already."""
    future = Future()
    future.set_result(result)
    return future


def mapped(future, function):
    """Give a future of function(future), made as soon as that one is done."""
    result = Future()

    def finish(done):
        if done.cancelled():
            result.cancel()
        else:
            result.set_result(function(done))

    future.add_done_callback(finish)
    return result
