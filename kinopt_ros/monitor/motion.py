"""
Where the arm is going: joint rates, and with them approaching a threshold or leaving it.

Nothing here knows of a node.
"""

from collections import deque
from dataclasses import dataclass
import enum
import math
from operator import mul

# Joint rates without velocities come from positions this far apart in time (s): long enough
# that a repeated sample or jitter in the stamps matters little, short enough to follow an arm.
WINDOW = 0.1
# Positions further apart than this (s) tell nothing about the present rate.
LONGEST_GAP = 1.5
# Rates (1/s) of z and of the margin below which an arm counts as steady.
STEADY_RATE = 1e-3
# Upper bound (s) of the time to a threshold: nobody extrapolates a motion further.
LONGEST_TIME = 60.0


class Trend(enum.IntEnum):
    """Whether the arm moves towards a threshold; numbers as in KinetostaticState."""

    UNKNOWN = 0
    STEADY = 1
    APPROACHING = 2
    LEAVING = 3


@dataclass(frozen=True)
class Motion:
    """
    The motion of an arm in terms of its index.

    Attributes
    ----------
    z_rate, margin_rate : float
        dz/dt and d(margin)/dt in 1/s; NaN when unknown.
    trend : Trend
    time_to_threshold : float
        Time in s to the first threshold at the present rates, 0 when it is crossed already, at
        most 60; NaN unless approaching.
    """

    z_rate: float = math.nan
    margin_rate: float = math.nan
    trend: Trend = Trend.UNKNOWN
    time_to_threshold: float = math.nan


UNKNOWN_MOTION = Motion()


class PositionHistory:
    """
    Joint rates from successive stamped positions.

    Repeated samples and stamps that stand still are passed over; when stamps run backwards or
    leave a gap the history starts again.
    """

    def __init__(self):
        self._samples = deque()

    def add(self, stamp, positions):
        """Take in positions (rad) with their stamp (s)."""
        samples = self._samples
        if samples:
            since = stamp - samples[-1][0]
            if since == 0.0:
                return
            if not 0.0 < since <= LONGEST_GAP:
                samples.clear()
        samples.append((stamp, positions))
        # The oldest is the last one that is a whole window old.
        while len(samples) > 2 and stamp - samples[1][0] >= WINDOW:
            samples.popleft()

    def clear(self):
        """Forget all positions."""
        self._samples.clear()

    def joint_rates(self):
        """Rates in rad/s over the window; None while the positions do not span half of it."""
        if len(self._samples) < 2:
            return None
        (start, old), (end, new) = self._samples[0], self._samples[-1]
        if end - start < 0.5 * WINDOW:
            return None
        # A continuous joint may report its angle within one turn, and jump at its end.
        return [_within_a_turn(_within_a_turn(b) - _within_a_turn(a)) / (end - start)
                for a, b in zip(old, new)]


def motion_at(index, gradient, joint_rates, thresholds):
    """
    Judge a motion.

    Parameters
    ----------
    index : KinetostaticIndex
    gradient : IndexGradient
        Of z and margin in 1/rad, in the coordinates of the joint rates.
    joint_rates : sequence of float, shape (n,)
        In rad/s.
    thresholds : Thresholds

    Returns
    -------
    motion : Motion
    """
    z_rate = sum(map(mul, gradient.z.tolist(), joint_rates))
    margin_rate = sum(map(mul, gradient.margin.tolist(), joint_rates))
    if not math.isfinite(z_rate + margin_rate):
        return UNKNOWN_MOTION
    if max(abs(z_rate), abs(margin_rate)) < STEADY_RATE:
        return Motion(z_rate, margin_rate, Trend.STEADY)
    time = min(_time_to(thresholds.z_max - index.z, z_rate),
               _time_to(index.margin - thresholds.margin_min, -margin_rate))
    if time == math.inf:
        return Motion(z_rate, margin_rate, Trend.LEAVING)
    return Motion(z_rate, margin_rate, Trend.APPROACHING, min(time, LONGEST_TIME))


def _within_a_turn(angle):
    return math.remainder(angle, 2.0 * math.pi)


def _time_to(distance, closing_rate):
    """Time in s until a distance is used up; inf unless it is closing."""
    if closing_rate < STEADY_RATE:
        return math.inf
    return max(distance, 0.0) / closing_rate
