"""
Resolved-rate control of a redundant planar arm, with null-space motion.

A pose is (tool angle, x, y) in rad and m, a twist its rate: the order of the Jacobian's rows.
"""

from typing import NamedTuple

import numpy as np

# Gain (1/s) by which the deviation from the line is taken back.
TRACKING_GAIN = 5.0


class StraightLine(NamedTuple):
    """
    A straight line at constant tool angle, from rest to rest.

    Attributes
    ----------
    start : array, shape (3,)
        First pose.
    displacement : complex
        From the first to the last point, in m.
    duration : float
        In s; before it the start is held, after it the end.
    """

    start: np.ndarray
    displacement: complex
    duration: float

    def pose(self, t):
        """Pose at time t (s)."""
        s = min(max(t / self.duration, 0.0), 1.0)
        # The polynomial of least degree with neither speed nor acceleration at both ends.
        return self.start + s ** 3 * (10.0 - 15.0 * s + 6.0 * s * s) * self._direction

    def twist(self, t):
        """Rate of the pose at time t (s)."""
        s = min(max(t / self.duration, 0.0), 1.0)
        return 30.0 * (s * (1.0 - s)) ** 2 / self.duration * self._direction

    @property
    def _direction(self):
        return np.array([0.0, self.displacement.real, self.displacement.imag])


class ResolvedRates(NamedTuple):
    """
    What resolved-rate control commands.

    Attributes
    ----------
    joint_rates : array, shape (n,)
        Within the limit, in rad/s.
    demand : float
        Largest joint rate (rad/s) that the twist alone would take.
    """

    joint_rates: np.ndarray
    demand: float


def resolved_rates(jacobian, twist, secondary, rate_limit):
    """
    Joint rates of least norm for a twist, with as much null-space motion as the limit allows.

    Parameters
    ----------
    jacobian : array, shape (m, n)
        With m < n.
    twist : array-like, shape (m,)
    secondary : array-like, shape (n,)
        Joint rates wanted besides, in rad/s; only their part in the null space is used.
    rate_limit : float
        Largest joint rate in rad/s. A twist that demands more is slowed down as a whole, and
        the null-space motion gets what the twist leaves over.

    Returns
    -------
    rates : ResolvedRates
    """
    inverse = np.linalg.pinv(jacobian)
    primary = inverse @ twist
    demand = np.max(np.abs(primary))
    if demand > rate_limit:
        primary = primary * (rate_limit / demand)
    self_motion = np.asarray(secondary) - inverse @ (jacobian @ secondary)
    return ResolvedRates(
        primary + _largest_share(primary, self_motion, rate_limit) * self_motion, float(demand))


def _largest_share(primary, self_motion, rate_limit):
    """Largest factor up to 1 with |primary + factor self_motion| within the limit."""
    room = rate_limit - np.sign(self_motion) * primary
    moving = self_motion != 0.0
    return np.min(room[moving] / np.abs(self_motion[moving]), initial=1.0)


def tool_pose(arm, joint_angles):
    """Pose (tool angle in rad, x and y in m) of a posture."""
    tip = arm.operation_point_vectors(joint_angles)[0]
    return np.array([np.sum(joint_angles), tip.real, tip.imag])


class LineFollower:
    """
    A simulated arm, exactly as fast as it is told to be, whose tool follows a straight line.

    Parameters
    ----------
    arm : PlanarArm
    joint_angles : sequence of float, shape (n,)
        First posture in rad; the line starts there.
    displacement : complex
        From the first to the last point of the line, in m.
    duration : float
        In s.
    rate_limit : float
        Largest joint rate in rad/s.

    Attributes
    ----------
    joint_angles, joint_rates : list of float, shape (n,)
        In rad and rad/s.
    demand : float
        As of `ResolvedRates`.
    distance : float
        Distance in m from where the tool should be.
    angle_error : float
        Deviation of the tool angle in rad.
    """

    def __init__(self, arm, joint_angles, displacement, duration, rate_limit):
        self._arm = arm
        self._line = StraightLine(tool_pose(arm, joint_angles), displacement, duration)
        self._rate_limit = rate_limit
        self.joint_angles = list(joint_angles)
        self.joint_rates = [0.0] * arm.n_joints
        self.demand = self.distance = self.angle_error = 0.0

    def step(self, t, period, secondary):
        """Move for a period (s) from time t (s) on, with the secondary joint rates wanted."""
        deviation = self._line.pose(t) - tool_pose(self._arm, self.joint_angles)
        rates = resolved_rates(
            self._arm.jacobian(self.joint_angles),
            self._line.twist(t) + TRACKING_GAIN * deviation, secondary, self._rate_limit)
        self.demand = rates.demand
        self.joint_rates = rates.joint_rates.tolist()
        self.joint_angles = [angle + period * rate for angle, rate
                             in zip(self.joint_angles, self.joint_rates)]
        angle, x, y = tool_pose(self._arm, self.joint_angles) - self._line.pose(t + period)
        self.distance, self.angle_error = float(np.hypot(x, y)), float(abs(angle))
