"""Verdicts as diagnostic_msgs, by REP-107."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

_LEVELS = (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR,
           DiagnosticStatus.STALE)


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


def key_values(monitor, now):
    """
    Give the keys and values that a monitor's diagnostics show.

    Parameters
    ----------
    monitor : PostureMonitor
    now : float
        Time in s.
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
        ('input rate (Hz)', f'{monitor.input_rate.per_second(now):.1f}'),
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
