"""
The monitor without ROS: joint states and time in, verdicts out.

    message -> posture -> index -> verdict
"""

import math

from kinopt_ros.kinetostatics.joint_limits import LARGEST_REFERENCE
from kinopt_ros.monitor.input_rate import InputRate
from kinopt_ros.monitor.motion import motion_at, PositionHistory, UNKNOWN_MOTION
from kinopt_ros.monitor.posture import BadJointStateError, PostureAssembler
from kinopt_ros.monitor.verdict import (
    Level,
    ProximityFlag,
    verdict_on_bad_message,
    verdict_on_index,
    verdict_on_silence,
)

# The monitor looks at the clock at least once per stale_timeout. When it comes later than this
# (s), its process did not run meanwhile: it was stopped, or the machine was suspended.
PAUSE_SLACK = 0.05
# For so long (s) after such a pause messages may be met that had waited in the queues.
SETTLING_TIME = 0.1


class PostureMonitor:
    """
    Judge each posture of an arm, and its absence.

    Times are in s on a clock that neither goes back nor stops.

    Parameters
    ----------
    configuration : Configuration
    now : float
        Time at which the watch begins.

    Attributes
    ----------
    configuration : Configuration
    verdict : Verdict
        The latest.
    positions : tuple of float
        Measured positions (rad) of the latest complete posture; NaN while it is not known.
    accepted, rejected : int
        Messages that gave a posture, and bad ones.
    input_rate : InputRate
        Of those that gave one.
    """

    def __init__(self, configuration, now):
        self.configuration = configuration
        self.accepted = 0
        self.rejected = 0
        self.input_rate = InputRate()
        self._unknown = (math.nan,) * len(configuration.arm.joint_names)
        self.positions = self._unknown
        self._assembler = PostureAssembler(configuration.arm.joint_names)
        self._history = PositionHistory()
        self._gradient = self._motion = None
        self._flag = ProximityFlag()
        self._quiet_since = now
        self._is_stale = False
        self._stale_since_posture = False
        self._pause = _Pause()
        self.verdict = self._verdict_on_silence(now)

    def configure(self, configuration, now):
        """Go on with another configuration of the same joints; what is known is judged again."""
        self.configuration = configuration
        if self.knows_posture:
            self._judge(self.positions, now)

    def look(self, now):
        """
        Look at the clock, before all else that a live process does at a time.

        Returns
        -------
        verdict : Verdict or None
            That the posture is stale, when the process has just come out of a pause; what has
            waited in its queues meanwhile is not believed.
        """
        if not self._pause.ends(now, self.configuration.stale_timeout) or self._is_stale:
            return None
        return self._become_stale(now)

    def on_joint_state(self, names, positions, now, velocities=(), stamp=0.0):
        """
        Judge a message.

        Parameters
        ----------
        names : list of str
        positions : sequence of float
            Joint positions in rad.
        now : float
        velocities : sequence of float
            Joint velocities in rad/s; empty where the publisher gives none.
        stamp : float
            The message's own time in s.

        Returns
        -------
        verdict : Verdict or None
            None if the message does not concern the arm or completes no posture.
        """
        stale_timeout = self.configuration.stale_timeout
        # Here and below without further functions: each message comes this way.
        pause = self._pause
        if now < pause.settled_at and pause.may_predate(stamp, now, stale_timeout):
            return None
        try:
            posture = self._assembler.update(names, positions, now, stale_timeout, velocities)
        except BadJointStateError as error:
            self.rejected += 1
            if self._stale_since_posture:
                # Bad messages are no silence; when they end too, that is worth saying again.
                self._quiet_since = now
                self._is_stale = False
            return self._lose_posture(verdict_on_bad_message(error), now)
        if posture is None:
            self._name_late_joints(now)
            return None
        self.accepted += 1
        self._quiet_since = now
        self._is_stale = self._stale_since_posture = False
        self.input_rate.tick(now)
        self._history.add(stamp, posture)
        if stamp - now > pause.lead:
            pause.lead = stamp - now
        return self._judge(posture, now)

    def on_time(self, now):
        """Give a verdict when the posture has just become stale, None otherwise."""
        if self._is_stale or self.time_to_stale(now) > 0.0:
            self._name_late_joints(now)
            return None
        return self._become_stale(now)

    def time_to_stale(self, now):
        """Time in s until the posture becomes stale unless another one comes."""
        return self._quiet_since + self.configuration.stale_timeout - now

    @property
    def knows_posture(self):
        """Whether there is a complete, fresh posture."""
        return self.positions is not self._unknown

    @property
    def reference_positions(self):
        """Measured positions (rad) near which an optimum is wanted: the present ones, or 0."""
        known = self.knows_posture and all(
            abs(position) < 0.5 * LARGEST_REFERENCE for position in self.positions)
        return self.positions if known else (0.0,) * len(self.positions)

    @property
    def joint_angles(self):
        """Relative joint angles theta_i (rad) that were judged; NaN while they are not known."""
        return self.configuration.arm.joint_angles(self.positions)

    def gradient(self):
        """
        Gradients of z and margin in measured joint coordinates; None without a posture.

        Computed on demand, once per posture, as is `motion`.
        """
        if self._gradient is None and self.knows_posture:
            self._gradient = self.configuration.gradient(self.positions)
        return self._gradient

    def motion(self):
        """Motion in terms of the index, unknown without a posture or joint rates."""
        if self._motion is None:
            self._motion = self._judged_motion()
        return self._motion

    def _judged_motion(self):
        joint_rates = self._assembler.velocities
        if not all(map(math.isfinite, joint_rates)):
            joint_rates = self._history.joint_rates()
        if joint_rates is None or not self.knows_posture:
            return UNKNOWN_MOTION
        return motion_at(self.verdict.index, self.gradient(), joint_rates,
                         self.configuration.thresholds)

    def _judge(self, posture, now):
        thresholds = self.configuration.thresholds
        self.positions = posture
        self._gradient = self._motion = None
        index = self.configuration.index(posture)
        self._flag.update(index, thresholds, now)
        self.verdict = verdict_on_index(index, self._flag, thresholds)
        return self.verdict

    def _name_late_joints(self, now):
        """While nothing is known, keep naming the joints that are late now."""
        if self.verdict.level is Level.STALE:
            self.verdict = self._verdict_on_silence(now)

    def _verdict_on_silence(self, now):
        timeout = self.configuration.stale_timeout
        late = self._assembler.late_joints(now, timeout)
        return verdict_on_silence(late or self.configuration.arm.joint_names, timeout,
                                  waiting=not self._is_stale)

    def _become_stale(self, now):
        self._is_stale = self._stale_since_posture = True
        self.input_rate.forget()
        return self._lose_posture(self._verdict_on_silence(now), now)

    def _lose_posture(self, verdict, now):
        self.positions = self._unknown
        self._history.clear()
        self._gradient = self._motion = None
        self._flag.raise_at(now)
        self.verdict = verdict
        return verdict


class _Pause:
    """
    A pause of the whole process, and the messages that had waited for its end.

    Attributes
    ----------
    settled_at : float
        Time in s from which on no message is met that had waited.
    lead : float
        By how much (s) the stamps that were believed run ahead of the clock. Several publishers
        may go by several clocks: the one furthest ahead makes a message look oldest.
    """

    def __init__(self):
        self._last_look = math.inf
        self.settled_at = -math.inf
        self.lead = -math.inf

    def ends(self, now, stale_timeout):
        """Look at the clock; tell whether the process has just come out of a pause."""
        length = now - self._last_look
        self._last_look = now
        if length <= stale_timeout + PAUSE_SLACK:
            return False
        self.settled_at = now + SETTLING_TIME
        return True

    def may_predate(self, stamp, now, stale_timeout):
        """
        Tell whether a message may have waited for the end of a pause, and be stale by now.

        Not if its stamp has gone on as the clock has. Before the first that was believed
        nobody knows.
        """
        return self.lead == -math.inf or not now + self.lead - stamp <= stale_timeout
