"""
From JointState messages to postures: positions taken by name, merged, each with its age.

Nothing here knows of a node or of a message type: it is given names, positions and the time.
"""

import math


class BadJointStateError(ValueError):
    """
    A JointState that names a joint of ours and cannot be believed.

    Attributes
    ----------
    reason : str
        The rule that was broken.
    joint : str
        The joint concerned; the first of several.
    """

    def __init__(self, joint, reason, value):
        super().__init__(f"joint '{joint}': {reason} ({value})")
        self.reason = reason
        self.joint = joint


class PostureAssembler:
    """
    Positions of the joints of one arm, gathered from messages that may hold only some.

    Parameters
    ----------
    joint_names : sequence of str
        The arm's joints, base to tip.

    Attributes
    ----------
    velocities : list of float
        Latest velocities in rad/s, base to tip; NaN where a joint's publisher gives none.
    """

    def __init__(self, joint_names):
        self._joint_names = tuple(joint_names)
        self._slots = {name: slot for slot, name in enumerate(self._joint_names)}
        self._positions = [math.nan] * len(self._joint_names)
        self.velocities = [math.nan] * len(self._joint_names)
        self._received = [-math.inf] * len(self._joint_names)
        self._layout_names = None
        self._layout = ()
        self._repeated = None

    def update(self, names, positions, now, stale_timeout, velocities=()):
        """
        Take a message in.

        Parameters
        ----------
        names : list of str
            Joint names of the message, in any order, others than ours among them.
        positions : sequence of float
            Joint positions in rad, one per name.
        now : float
            Time of reception in s on a clock that never goes back.
        stale_timeout : float
            Age in s beyond which a position no longer counts.
        velocities : sequence of float
            Joint velocities in rad/s, one per name; anything else counts as none.

        Returns
        -------
        posture : tuple of float or None
            The measured positions in rad, base to tip, if this message concerns us and every
            joint's position is fresh; None otherwise.

        Raises
        ------
        BadJointStateError
            If the message names a joint of ours twice, has not one position per name, or
            holds a position of ours that is not finite. What was known of the joints that it
            names is forgotten: their latest reading is not known.
        """
        if names != self._layout_names:
            self._learn_layout(names)
        if not self._layout:
            return None
        try:
            self._store(len(names), positions, velocities, now)
        except BadJointStateError:
            self._forget()
            raise
        if len(self._layout) < len(self._slots) and self.late_joints(now, stale_timeout):
            return None
        return tuple(self._positions)

    def late_joints(self, now, stale_timeout):
        """Names of the joints whose position is missing or older than stale_timeout (s)."""
        oldest = now - stale_timeout
        return tuple(name for name, received in zip(self._joint_names, self._received)
                     if received < oldest)

    def _learn_layout(self, names):
        """Find our joints in a list of names; publishers seldom change theirs."""
        self._layout_names = list(names)
        self._layout = tuple((self._slots[name], place) for place, name in enumerate(names)
                             if name in self._slots)
        self._repeated = self._first_repeated()

    def _first_repeated(self):
        seen = set()
        for slot, _ in self._layout:
            if slot in seen:
                return slot
            seen.add(slot)
        return None

    def _store(self, name_count, positions, velocities, now):
        if self._repeated is not None:
            raise self._error(self._repeated, 'named more than once', f'{name_count} names')
        if len(positions) != name_count:
            without = [slot for slot, place in self._layout if place >= len(positions)]
            raise self._error((without or [self._layout[0][0]])[0],
                              'the message must hold one position per name',
                              f'{len(positions)} positions, {name_count} names')
        has_velocities = len(velocities) == name_count
        for slot, place in self._layout:
            position = positions[place]
            if not math.isfinite(position):
                raise self._error(slot, 'position must be finite', position)
            self._positions[slot] = position
            self._received[slot] = now
            self.velocities[slot] = velocities[place] if has_velocities else math.nan

    def _error(self, slot, reason, value):
        return BadJointStateError(self._joint_names[slot], reason, value)

    def _forget(self):
        for slot, _ in self._layout:
            self._positions[slot] = math.nan
            self._received[slot] = -math.inf
