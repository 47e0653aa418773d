"""The node: it wires joint states, parameters and time to the monitor, and verdicts to topics."""

import time

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import (
    InvalidQosOverridesError,
    QosCallbackResult,
    QoSOverridingOptions,
)
from sensor_msgs.msg import JointState
from std_msgs.msg import (
    Bool,
    Float64,
    Float64MultiArray,
    Header,
    MultiArrayDimension,
    MultiArrayLayout,
    String,
)

from kinopt_ros.monitor.described_arm import arm_parameters, DescribedArm
from kinopt_ros.monitor.diagnostics import diagnostic_array, key_values
from kinopt_ros.monitor.joint_state_reader import JointStateReader, UnreadableError
from kinopt_ros.monitor.marker_publisher import MarkerPublisher
from kinopt_ros.monitor.on_demand import bool_writer, float64_writer, OnDemandTopics
from kinopt_ros.monitor.optimum_services import LATCHED, OptimumServices
from kinopt_ros.monitor.parameters import (
    BEHAVIOUR_TABLE,
    CPU_AFFINITY,
    declare,
    DESCRIPTION_TABLE,
    EXECUTOR,
    given_joint_names,
    MonitorParameters,
)
from kinopt_ros.monitor.posture_monitor import PostureMonitor
from kinopt_ros.monitor.process import run
from kinopt_ros.monitor.verdict import verdict_without_arm

# Deep enough that the parts of a split JointState do not overwrite each other, too shallow
# for a lag; a late reading is worth nothing, so it is not sent again.
JOINT_STATES_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)

# Of messages that cannot be read one is told in so many s, by this clock.
_WARNING_PERIOD = 10.0
_WARNING_CLOCK = Clock(clock_type=ClockType.STEADY_TIME)

# A clock that no pause of simulated time and no jump of the wall clock moves; unlike the
# monotonic clock this one also counts the time for which the machine was suspended.
_STEADY_CLOCK = getattr(time, 'CLOCK_BOOTTIME', time.CLOCK_MONOTONIC)


def steady_time():
    """Time in s on a clock that neither goes back nor stops."""
    return time.clock_gettime(_STEADY_CLOCK)


class SingularityMonitor(Node):
    """
    Watch a planar arm's joint states and say how far it is from a singularity.

    Where the arm comes from the topic robot_description, the watch begins with that message;
    until then nothing is known, and that is what the diagnostics say.

    Attributes
    ----------
    start_error : ValueError or None
        What was found to be bad when that message came; nothing is watched then.
    """

    def __init__(self, **node_options):
        super().__init__('singularity_monitor', **node_options)
        self.start_error = None
        self._monitor = None
        self._optimum = None
        self._reading = None
        self._reader = JointStateReader()
        self._published = None
        values = declare(self, (EXECUTOR, CPU_AFFINITY, *DESCRIPTION_TABLE, *BEHAVIOUR_TABLE))
        self._hardware_id = values['hardware_id']
        self._create_publishers()
        described_arm = DescribedArm.from_parameters(values, given_joint_names(self))
        if described_arm is None:
            self._start_monitoring()
        elif values['robot_description']:
            self._start_monitoring(described_arm.subchain(values['robot_description']))
        else:
            self._wait_for_description(described_arm)

    def _create_publishers(self):
        def add(topics, message_type, name, make_message):
            topics.add(self.create_publisher(message_type, name, 10), make_message)

        number, flag = float64_writer(), bool_writer()
        # Those of each cycle are made of its verdict and time, the diagnostics of a verdict.
        self._topics, self._diagnostics = OnDemandTopics(), OnDemandTopics()
        add(self._topics, Float64, '~/z', lambda verdict, _: number(verdict.index.z))
        add(self._topics, Float64, '~/conditioning_length',
            lambda verdict, _: number(verdict.index.conditioning_length))
        add(self._topics, Float64, '~/margin', lambda verdict, _: number(verdict.index.margin))
        add(self._topics, Bool, '~/near_singularity',
            lambda verdict, _: flag(verdict.near_singularity))
        add(self._topics, Float64MultiArray, '~/gradient',
            lambda *_: _gradient_of(self._monitor) if self._monitor else None)
        add(self._diagnostics, DiagnosticArray, '/diagnostics', self._diagnostics_of)

    def _wait_for_description(self, described_arm):
        self._verdict_without_arm = verdict_without_arm('waiting for robot_description')
        waiting = self._steady_timer(1.0, self._publish_diagnostics)
        self._topics.publish(self._verdict_without_arm, steady_time())
        self._publish_diagnostics()

        def on_description(message):
            if self._monitor is not None:
                self.get_logger().warning(
                    'another robot_description has come; restart to have it used')
                return
            try:
                subchain = described_arm.subchain(message.data)
            except ValueError as error:
                self._verdict_without_arm = verdict_without_arm(f'robot_description: {error}')
                self.get_logger().error(self._verdict_without_arm.message)
                self._publish_diagnostics()
                return
            try:
                self._start_monitoring(subchain)
            except ValueError as error:
                self.start_error = error
            else:
                # The heartbeat keeps the period from here on, and looks at the clock first.
                waiting.cancel()

        self.create_subscription(String, 'robot_description', on_description, LATCHED)

    def _start_monitoring(self, subchain=None):
        self._settings = MonitorParameters(
            self, self._on_configuration, arm_parameters(subchain) if subchain else None)
        configuration = self._settings.configuration
        self._monitor = PostureMonitor(configuration, steady_time())
        self._watchdog = self._steady_timer(configuration.stale_timeout, self._on_watchdog)
        self._heartbeat = self._steady_timer(
            configuration.diagnostics_period or 1.0, self._on_heartbeat)
        self._set_heartbeat(configuration)
        self._optimum = OptimumServices(self, self._monitor)
        self._optimum.announce()
        self._typed = self._offer_typed_interfaces()
        self._markers = MarkerPublisher(
            self, self._topics, self._monitor, self._optimum, subchain, self._header)
        self._subscribe()
        self._log_configuration()
        if subchain is not None and subchain.tip_movers:
            self.get_logger().warning(
                f'{", ".join(subchain.tip_movers)} would move the operation point; the index '
                f'takes them to stand at {subchain.held_positions}')

    def _subscribe(self):
        try:
            self.create_subscription(
                JointState, 'joint_states', self._on_joint_state, JOINT_STATES_QOS, raw=True,
                qos_overriding_options=QoSOverridingOptions.with_default_policies(
                    callback=_judge_qos))
        except (InvalidQosOverridesError, RuntimeError) as error:
            raise ValueError(f'parameters qos_overrides of joint_states: {error}') from error

    def _steady_timer(self, period, callback):
        return self.create_timer(
            period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _offer_typed_interfaces(self):
        try:
            from kinopt_ros.monitor.typed_interfaces import TypedInterfaces
        except ImportError as error:
            self.get_logger().info(
                f'without ~/state and ~/solve_optimal_posture ({error}); to have them: '
                'colcon build --packages-select kinopt_interfaces')
            return None
        return TypedInterfaces(
            self, self._topics, self._monitor, self._optimum, self._header)

    def _on_joint_state(self, data):
        now = steady_time()
        try:
            reading = self._reader.read(data)
        except UnreadableError as error:
            self.get_logger().warning(
                f'joint_states: {error}', throttle_duration_sec=_WARNING_PERIOD,
                throttle_time_source_type=_WARNING_CLOCK)
            return
        verdict = self._monitor.look(now) or self._monitor.on_joint_state(
            reading.names, reading.positions, now, reading.velocities, reading.stamp)
        if verdict is None:
            self._publish_news()
            return
        self._reading = reading
        self._topics.publish(verdict, now)
        if self._settings.configuration.diagnostics_period == 0.0:
            self._publish_diagnostics()
        else:
            self._publish_news()

    def _on_watchdog(self):
        now = steady_time()
        verdict = self._monitor.look(now) or self._monitor.on_time(now)
        if verdict is not None:
            self._topics.publish(verdict, now)
        self._publish_news()
        # The next look is due exactly when the posture would become stale.
        timeout = self._settings.configuration.stale_timeout
        remaining = self._monitor.time_to_stale(steady_time())
        _set_period(self._watchdog, remaining if remaining > 0.0 else timeout)

    def _on_heartbeat(self):
        # After a long pause of the process both timers are due, in no certain order.
        self._on_watchdog()
        self._publish_diagnostics()

    def _publish_news(self):
        """Publish the diagnostics at once when the level or its reason is another."""
        verdict = self._monitor.verdict
        if (verdict.level, verdict.reason) != self._published:
            self._publish_diagnostics()

    def _publish_diagnostics(self):
        verdict = (self._verdict_without_arm if self._monitor is None
                   else self._monitor.verdict)
        self._published = (verdict.level, verdict.reason)
        self._diagnostics.publish(verdict)

    def _diagnostics_of(self, verdict):
        values = ()
        if self._monitor is not None:
            values = key_values(self._monitor, steady_time())
        stamp = self._header().stamp if self._reading else self.get_clock().now().to_msg()
        return diagnostic_array(
            verdict, values, self.get_fully_qualified_name(), self._hardware_id, stamp)

    def _header(self):
        """Header of the JointState that was judged last."""
        return self._reading.header if self._reading else Header()

    def _on_configuration(self, configuration):
        self._on_watchdog()
        self._monitor.configure(configuration, steady_time())
        self._set_heartbeat(configuration)
        self._on_watchdog()
        self._optimum.announce()

    def _set_heartbeat(self, configuration):
        period = configuration.diagnostics_period
        if period == 0.0:
            self._heartbeat.cancel()
        elif self._heartbeat.is_canceled() or (
                self._heartbeat.timer_period_ns != _nanoseconds(period)):
            _set_period(self._heartbeat, period)

    def _log_configuration(self):
        arm, thresholds = self._settings.configuration.arm, self._settings.configuration.thresholds
        self.get_logger().info(
            f'monitoring {", ".join(arm.joint_names)} with link lengths '
            f'{", ".join(f"{a:g}" for a in arm.planar_arm.link_lengths)} m; flag at '
            f'z > {thresholds.z_max:g} or margin < {thresholds.margin_min:g}')

    def destroy_node(self):
        """End the solver, then what belongs to the node."""
        if self._optimum is not None:
            self._optimum.close()
        super().destroy_node()


def _judge_qos(profile):
    return QosCallbackResult(
        successful=profile.depth > 0, reason=f'depth = {profile.depth}: must be above 0')


def _gradient_of(monitor):
    """Give dz/dtheta by measured joint positions; empty while the posture is not known."""
    gradient = monitor.gradient()
    values = [] if gradient is None else gradient.z.tolist()
    dimension = MultiArrayDimension(
        label='dz/dtheta (1/rad), by joint_names', size=len(values), stride=len(values))
    return Float64MultiArray(layout=MultiArrayLayout(dim=[dimension]), data=values)


def _set_period(timer, period):
    timer.timer_period_ns = _nanoseconds(period)
    timer.reset()


def _nanoseconds(seconds):
    return max(1, round(seconds * 1e9))


def main(args=None):
    """Run the node until it is told to end; the exit status is returned."""
    return run(SingularityMonitor, args)
