"""
The verdict on a posture: is it near a singularity, and what level of alarm is that.

Nothing here knows of a node. A verdict is made from an index, from a bad message or from
silence, and the node turns it into messages.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
import enum
from functools import partial
import math
from typing import NamedTuple

from kinopt_ros.kinetostatics.index import KinetostaticIndex

UNKNOWN_INDEX = KinetostaticIndex(math.nan, math.nan, math.nan)


class Level(enum.IntEnum):
    """Levels of a diagnostic_msgs/DiagnosticStatus (REP-107)."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True)
class Thresholds:
    """
    When the proximity flag rises and clears.

    Attributes
    ----------
    z_max : float
        The flag rises when z exceeds it (the paper's z_M), 0..1.
    margin_min : float
        The flag rises when the margin falls below it, 0..1.
    hysteresis : float
        The flag clears at margin > margin_min (1 + hysteresis) together with
        1 - z > (1 - z_max) (1 + hysteresis); >= 0.
    min_dwell : float
        Time in s since the last crossing before which a raised flag does not clear; >= 0.

    Raises
    ------
    ValueError
        If a value is out of its range, or if the flag, once up, could never clear.
    """

    z_max: float = 0.9
    margin_min: float = 0.05
    hysteresis: float = 0.1
    min_dwell: float = 0.0

    def __post_init__(self):
        for name in ('z_max', 'margin_min'):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise ValueError(f'{name} = {value}: must be within 0..1')
        for name in ('hysteresis', 'min_dwell'):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f'{name} = {value}: must be finite and not negative')
        if self.clearing_margin >= 1.0:
            raise ValueError(
                f'hysteresis = {self.hysteresis} with margin_min = {self.margin_min}: the flag '
                'could never clear, margin_min (1 + hysteresis) must be below 1')
        if self.clearing_closeness >= 1.0:
            raise ValueError(
                f'hysteresis = {self.hysteresis} with z_max = {self.z_max}: the flag could '
                'never clear, (1 - z_max) (1 + hysteresis) must be below 1')

    @property
    def clearing_margin(self):
        """Margin above which a raised flag may clear."""
        return self.margin_min * (1.0 + self.hysteresis)

    @property
    def clearing_closeness(self):
        """Value of 1 - z above which a raised flag may clear."""
        return (1.0 - self.z_max) * (1.0 + self.hysteresis)

    def crossed(self, index):
        """Names of the thresholds that an index has crossed; empty when there are none."""
        names = ()
        if index.z > self.z_max:
            names += ('z_max',)
        if index.margin < self.margin_min:
            names += ('margin_min',)
        return names

    def not_cleared(self, index):
        """Names of the thresholds that still hold a raised flag up."""
        names = ()
        if not 1.0 - index.z > self.clearing_closeness:
            names += ('z_max',)
        if not index.margin > self.clearing_margin:
            names += ('margin_min',)
        return names


@dataclass
class ProximityFlag:
    """
    The proximity-to-singularity flag with its hysteresis and minimum dwell.

    Attributes
    ----------
    raised : bool
    causes : tuple of str
        What keeps it up: 'z_max', 'margin_min', or 'min_dwell' when only the dwell does.
    crossed : bool
        Whether a threshold is crossed at this very index.
    """

    raised: bool = False
    causes: tuple = ()
    crossed: bool = False
    _last_raised: float = field(default=-math.inf, repr=False)

    def update(self, index, thresholds, now):
        """
        Judge an index.

        Parameters
        ----------
        index : KinetostaticIndex
        thresholds : Thresholds
        now : float
            Time in s on a clock that never goes back.

        Returns
        -------
        raised : bool
        """
        crossed = thresholds.crossed(index)
        self.crossed = bool(crossed)
        if crossed:
            self.raise_at(now, crossed)
        elif self.raised:
            self._hold_or_clear(thresholds, index, now)
        return self.raised

    def raise_at(self, now, causes=()):
        """Raise the flag, or keep it raised, for the causes given."""
        self._last_raised = now
        self.raised = True
        self.causes = causes

    def _hold_or_clear(self, thresholds, index, now):
        self.causes = thresholds.not_cleared(index)
        if not self.causes and now - self._last_raised < thresholds.min_dwell:
            self.causes = ('min_dwell',)
        self.raised = bool(self.causes)


class Verdict(NamedTuple):
    """
    What the monitor says of one cycle.

    Attributes
    ----------
    level : Level
    reason : tuple
        Identity of the reason: two verdicts of equal level and reason tell no news, although
        the numbers in their messages may differ.
    near_singularity : bool
        True also whenever the posture is not known.
    wording : callable
        Gives the message: most cycles end without anybody asking for it.
    index : KinetostaticIndex
        NaN where the posture is not known.
    """

    level: Level
    reason: tuple
    near_singularity: bool
    wording: Callable[[], str]
    index: KinetostaticIndex = UNKNOWN_INDEX

    @property
    def message(self):
        """The reason in words, with the values."""
        return self.wording()


def verdict_on_index(index, flag, thresholds):
    """Verdict on a known posture, from the flag just updated with its index."""
    if not flag.raised:
        return Verdict(Level.OK, (), False, _clear, index)
    wording = partial(_near_singularity, flag.crossed, flag.causes, index, thresholds)
    return Verdict(Level.WARN, (flag.crossed, *flag.causes), True, wording, index)


def _clear():
    return 'clear of singularities'


def _near_singularity(crossed, causes, index, thresholds):
    return 'near singularity: ' + '; '.join(
        _CAUSE_TEXTS[cause, crossed].format(index=index, thresholds=thresholds)
        for cause in causes)


def verdict_on_bad_message(error):
    """Verdict on a JointState that cannot be believed."""
    return Verdict(Level.ERROR, (str(error.reason), error.joint), True,
                   partial(str, str(error)))


def verdict_on_silence(late_joints, timeout, waiting):
    """
    Verdict when there is no complete, fresh posture.

    Parameters
    ----------
    late_joints : sequence of str
        The joints without a fresh position.
    timeout : float
        stale_timeout in s.
    waiting : bool
        True before the first timeout has passed.
    """
    joints = ', '.join(late_joints)
    if waiting:
        message = f'waiting for the first position of: {joints}'
    else:
        message = f'no fresh position for {timeout:g} s of: {joints}'
    return Verdict(Level.STALE, (waiting, *late_joints), True, partial(str, message))


def verdict_without_arm(message):
    """Verdict while the arm itself is not known."""
    return Verdict(Level.STALE, (message,), True, partial(str, message))


_CAUSE_TEXTS = {
    ('z_max', True): 'z {index.z:.6g} above z_max {thresholds.z_max:g}',
    ('margin_min', True): 'margin {index.margin:.6g} below margin_min {thresholds.margin_min:g}',
    ('z_max', False): 'z {index.z:.6g} has not cleared z_max {thresholds.z_max:g} by the '
                      'hysteresis {thresholds.hysteresis:g}',
    ('margin_min', False): 'margin {index.margin:.6g} has not cleared margin_min '
                           '{thresholds.margin_min:g} by the hysteresis '
                           '{thresholds.hysteresis:g}',
    ('min_dwell', False): 'within min_dwell {thresholds.min_dwell:g} s of the crossing',
}
