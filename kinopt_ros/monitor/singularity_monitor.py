"""The node: it wires joint states, parameters and time to the monitor, and verdicts to topics."""

import time

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import (
    Bool, Float64, Float64MultiArray, Header, MultiArrayDimension, MultiArrayLayout)

from kinopt_ros.monitor.diagnostics import diagnostic_array, InputRate
from kinopt_ros.monitor.optimum_services import OptimumServices
from kinopt_ros.monitor.parameters import MonitorParameters
from kinopt_ros.monitor.posture_monitor import PostureMonitor
from kinopt_ros.monitor.process import run

# Deep enough that the parts of a split JointState do not overwrite each other, too shallow
# for a lag; a late reading is worth nothing, so it is not sent again.
JOINT_STATES_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


# A clock that no pause of simulated time and no jump of the wall clock moves; unlike the
# monotonic clock this one also counts the time for which the machine was suspended.
_STEADY_CLOCK = getattr(time, 'CLOCK_BOOTTIME', time.CLOCK_MONOTONIC)


def steady_time():
    """Time in s on a clock that neither goes back nor stops."""
    return time.clock_gettime(_STEADY_CLOCK)


class SingularityMonitor(Node):
    """Watch a planar arm's joint states and say how far it is from a singularity."""

    def __init__(self, **node_options):
        super().__init__('singularity_monitor', **node_options)
        self._settings = MonitorParameters(self, self._on_configuration)
        self._monitor = PostureMonitor(self._settings.configuration, steady_time())
        self._input_rate = InputRate()
        self._header = None
        self._published = None
        self._create_publishers()
        self._create_timers()
        self._optimum = OptimumServices(self, self._monitor)
        self._optimum.announce()
        self._typed = self._offer_typed_interfaces()
        self.create_subscription(
            JointState, 'joint_states', self._on_joint_state, JOINT_STATES_QOS,
            qos_overriding_options=QoSOverridingOptions.with_default_policies())
        self._log_configuration()

    def _create_publishers(self):
        self._z = self.create_publisher(Float64, '~/z', 10)
        self._conditioning_length = self.create_publisher(Float64, '~/conditioning_length', 10)
        self._margin = self.create_publisher(Float64, '~/margin', 10)
        self._near_singularity = self.create_publisher(Bool, '~/near_singularity', 10)
        self._gradient = self.create_publisher(Float64MultiArray, '~/gradient', 10)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)

    def _offer_typed_interfaces(self):
        try:
            from kinopt_ros.monitor.typed_interfaces import TypedInterfaces
        except ImportError as error:
            self.get_logger().info(
                f'without ~/state and ~/solve_optimal_posture ({error}); to have them: '
                'colcon build --packages-select kinopt_interfaces')
            return None
        return TypedInterfaces(self, self._monitor, self._optimum)

    def _create_timers(self):
        configuration = self._settings.configuration
        steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._watchdog = self.create_timer(
            configuration.stale_timeout, self._on_watchdog, clock=steady_clock)
        self._heartbeat = self.create_timer(
            configuration.diagnostics_period or 1.0, self._publish_diagnostics,
            clock=steady_clock)
        self._set_heartbeat(configuration)

    def _on_joint_state(self, message):
        now = steady_time()
        header = message.header
        verdict = self._monitor.on_joint_state(
            message.name, message.position, now, message.velocity,
            header.stamp.sec + 1e-9 * header.stamp.nanosec)
        if verdict is None:
            return
        self._header = header
        self._input_rate.tick(now)
        self._publish(verdict, is_cycle=True)

    def _on_watchdog(self):
        verdict = self._monitor.on_time(steady_time())
        if verdict is not None:
            self._publish(verdict, is_cycle=False)
        # The next look is due exactly when the posture would become stale.
        timeout = self._settings.configuration.stale_timeout
        remaining = self._monitor.time_to_stale(steady_time())
        self._set_period(self._watchdog, remaining if remaining > 0.0 else timeout)

    def _publish(self, verdict, is_cycle):
        self._z.publish(Float64(data=verdict.index.z))
        self._conditioning_length.publish(Float64(data=verdict.index.conditioning_length))
        self._margin.publish(Float64(data=verdict.index.margin))
        self._near_singularity.publish(Bool(data=verdict.near_singularity))
        if self._gradient.get_subscription_count() > 0:
            self._gradient.publish(_gradient_message(self._monitor.gradient()))
        if self._typed is not None:
            self._typed.publish_state(self._header or Header())
        each_cycle = is_cycle and self._settings.configuration.diagnostics_period == 0.0
        if each_cycle or (verdict.level, verdict.reason) != self._published:
            self._publish_diagnostics()

    def _publish_diagnostics(self):
        verdict = self._monitor.verdict
        self._published = (verdict.level, verdict.reason)
        stamp = self._header.stamp if self._header else self.get_clock().now().to_msg()
        self._diagnostics.publish(diagnostic_array(
            self._monitor, self.get_fully_qualified_name(),
            self._input_rate.per_second(steady_time()), stamp))

    def _on_configuration(self, configuration):
        self._monitor.configuration = configuration
        self._set_heartbeat(configuration)
        self._on_watchdog()
        self._optimum.announce()

    def destroy_node(self):
        """End the solver, then what belongs to the node."""
        self._optimum.close()
        super().destroy_node()

    def _set_heartbeat(self, configuration):
        if configuration.diagnostics_period == 0.0:
            self._heartbeat.cancel()
        elif self._heartbeat.is_canceled() or (
                self._heartbeat.timer_period_ns != _nanoseconds(configuration.diagnostics_period)):
            self._set_period(self._heartbeat, configuration.diagnostics_period)

    def _set_period(self, timer, period):
        timer.timer_period_ns = _nanoseconds(period)
        timer.reset()

    def _log_configuration(self):
        configuration = self._settings.configuration
        thresholds = configuration.thresholds
        self.get_logger().info(
            f'monitoring {", ".join(configuration.arm.joint_names)} with link lengths '
            f'{", ".join(f"{a:g}" for a in configuration.arm.planar_arm.link_lengths)} m; flag at '
            f'z > {thresholds.z_max:g} or margin < {thresholds.margin_min:g}')


def _gradient_message(gradient):
    """Give dz/dtheta by measured joint positions; empty while the posture is not known."""
    values = [] if gradient is None else gradient.z.tolist()
    dimension = MultiArrayDimension(
        label='dz/dtheta (1/rad), by joint_names', size=len(values), stride=len(values))
    return Float64MultiArray(layout=MultiArrayLayout(dim=[dimension]), data=values)


def _nanoseconds(seconds):
    return max(1, round(seconds * 1e9))


def main(args=None):
    """Run the node until it is told to end; the exit status is returned."""
    return run(SingularityMonitor, args)
