"""Verdicts as diagnostic_msgs, by REP-107."""

from collections import deque

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

_LEVELS = (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR,
           DiagnosticStatus.STALE)


class InputRate:
    """Rate of the accepted messages over the latest of them."""

    def __init__(self, window=100):
        self._times = deque(maxlen=window)

    def tick(self, now):
        """Count a message at time now (s)."""
        self._times.append(now)

    def per_second(self, now):
        """Rate in Hz; it falls towards 0 when messages stop."""
        if len(self._times) < 2:
            return 0.0
        return (len(self._times) - 1) / max(now - self._times[0], 1e-9)


def diagnostic_array(monitor, node_name, input_rate, stamp):
    """
    Make the diagnostics of a monitor's latest verdict.

    Parameters
    ----------
    monitor : PostureMonitor
    node_name : str
        Fully qualified name of the node.
    input_rate : float
        In Hz.
    stamp : builtin_interfaces.msg.Time
        The JointState's.

    Returns
    -------
    array : diagnostic_msgs.msg.DiagnosticArray
        With one status.
    """
    configuration = monitor.configuration
    verdict, motion = monitor.verdict, monitor.motion()
    values = [
        ('z', _digits(verdict.index.z)),
        ('conditioning length (m)', _digits(verdict.index.conditioning_length)),
        ('margin', _digits(verdict.index.margin)),
        ('z_max', _digits(configuration.thresholds.z_max)),
        ('margin_min', _digits(configuration.thresholds.margin_min)),
        *((f'angle of {name} (rad)', _digits(angle))
          for name, angle in zip(configuration.arm.joint_names, monitor.joint_angles)),
        ('trend', motion.trend.name.lower()),
        ('dz/dt (1/s)', _digits(motion.z_rate)),
        ('d(margin)/dt (1/s)', _digits(motion.margin_rate)),
        ('time_to_threshold (s)', _digits(motion.time_to_threshold)),
        ('input rate (Hz)', f'{input_rate:.1f}'),
        ('messages accepted', str(monitor.accepted)),
        ('messages rejected', str(monitor.rejected)),
    ]
    status = DiagnosticStatus(
        level=_LEVELS[verdict.level],
        name=f'{node_name.lstrip("/")}: posture',
        message=verdict.message,
        hardware_id=configuration.hardware_id,
        values=[KeyValue(key=key, value=value) for key, value in values])
    array = DiagnosticArray(status=[status])
    array.header.stamp = stamp
    return array


def _digits(value):
    return f'{value:.12g}'
