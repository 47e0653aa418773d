"""The rate of the messages that gave a posture."""

from collections import deque

# Messages of so many seconds count, and never more than the latest 100.
_WINDOW = 5.0
_MOST_MESSAGES = 100


class InputRate:
    """
    Rate of the accepted messages over the latest of them.

    Attributes
    ----------
    tick : callable
        Counts a message at the time (s) that it is given.
    """

    def __init__(self):
        self._times = deque(maxlen=_MOST_MESSAGES)
        # Each message calls it: what is too old is seen to when somebody asks.
        self.tick = self._times.append

    def forget(self):
        """Begin anew, after a gap."""
        self._times.clear()

    def per_second(self, now):
        """Rate in Hz at time now (s); it falls towards 0 when messages stop."""
        times = self._times
        while times and times[-1] - times[0] > _WINDOW:
            times.popleft()
        if len(times) < 2:
            return 0.0
        return (len(times) - 1) / max(now - times[0], 1e-9)
