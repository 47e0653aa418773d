"""Verdicts as diagnostic_msgs, by REP-107."""

from collections import deque

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

_LEVELS = (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR,
           DiagnosticStatus.STALE)

# Messages of so many seconds count for the input rate, and never more than the latest 100.
_RATE_WINDOW = 5.0


class InputRate:
    """Rate of the accepted messages over the latest of them."""

    def __init__(self):
        self._times = deque(maxlen=100)

    def tick(self, now):
        """Count a message at time now (s)."""
        self._times.append(now)
        while now - self._times[0] > _RATE_WINDOW:
            self._times.popleft()

    def forget(self):
        """Begin anew, after a gap."""
        self._times.clear()

    def per_second(self, now):
        """Rate in Hz; it falls towards 0 when messages stop."""
        if len(self._times) < 2:
            return 0.0
        return (len(self._times) - 1) / max(now - self._times[0], 1e-9)


def diagnostic_array(verdict, values, node_name, hardware_id, stamp):
    """
    Make the diagnostics of a verdict.

    Parameters
    ----------
    verdict : Verdict
    values : sequence of (str, str)
        Keys and values.
    node_name : str
        Fully qualified name of the node.
    hardware_id : str
    stamp : builtin_interfaces.msg.Time
        The JointState's.

    Returns
    -------
    array : diagnostic_msgs.msg.DiagnosticArray
        With one status.
    """
    status = DiagnosticStatus(
        level=_LEVELS[verdict.level],
        name=f'{node_name.lstrip("/")}: posture',
        message=verdict.message,
        hardware_id=hardware_id,
        values=[KeyValue(key=key, value=value) for key, value in values])
    array = DiagnosticArray(status=[status])
    array.header.stamp = stamp
    return array


def key_values(monitor, input_rate):
    """
    Give the keys and values that a monitor's diagnostics show.

    Parameters
    ----------
    monitor : PostureMonitor
    input_rate : float
        In Hz.
    """
    arm, thresholds = monitor.configuration.arm, monitor.configuration.thresholds
    index, motion = monitor.verdict.index, monitor.motion()
    return [
        ('z', _digits(index.z)),
        ('conditioning length (m)', _digits(index.conditioning_length)),
        ('margin', _digits(index.margin)),
        ('z_max', _digits(thresholds.z_max)),
        ('margin_min', _digits(thresholds.margin_min)),
        *((f'angle of {name} (rad)', _digits(angle))
          for name, angle in zip(arm.joint_names, monitor.joint_angles)),
        *_limit_values(arm, monitor),
        ('trend', motion.trend.name.lower()),
        ('dz/dt (1/s)', _digits(motion.z_rate)),
        ('d(margin)/dt (1/s)', _digits(motion.margin_rate)),
        ('time_to_threshold (s)', _digits(motion.time_to_threshold)),
        ('input rate (Hz)', f'{input_rate:.1f}'),
        ('messages accepted', str(monitor.accepted)),
        ('messages rejected', str(monitor.rejected)),
    ]


def _limit_values(arm, monitor):
    """Distance to the nearest joint limit: beside the index, never part of it."""
    nearest = arm.nearest_limit(monitor.positions) if monitor.knows_posture else None
    if nearest is None:
        return []
    distance, joint = nearest
    return [('distance to the nearest joint limit (rad)', _digits(distance)),
            ('joint nearest to its limit', joint)]


def _digits(value):
    return f'{value:.12g}'
