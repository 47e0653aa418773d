"""Joint limits and the turns of an angle: which of its equivalents lies where."""

from dataclasses import dataclass
import math

import numpy as np

# Beyond so many rad the turns of an angle lose the digits that an optimum is judged by.
LARGEST_REFERENCE = 1e6

_TURN = 2.0 * math.pi
# Rounding of an angle that was brought to a limit.
_SLACK = 1e-9


@dataclass(frozen=True)
class JointLimits:
    """
    The box that a posture must lie in and the reference that tells which turn is meant.

    Attributes
    ----------
    lower, upper : array, shape (n,)
        In rad, may be infinite.
    reference : array, shape (n,)
        In rad; zeros, the stretched arm, unless one is given.
    wrapped : bool
        Whether angles are to be given in (-pi, pi], which is so where there are no limits.
    """

    lower: np.ndarray
    upper: np.ndarray
    reference: np.ndarray
    wrapped: bool

    @classmethod
    def checked(cls, n_joints, lower, upper, reference):
        """
        Limits from what a user gives; None stands for no limits and for no reference.

        Raises
        ------
        ValueError
            If an argument does not hold n numbers, the reference is not finite, or no angle of
            a joint is within its limits.
        """
        wrapped = lower is None and upper is None
        lower = _numbers('lower', lower, n_joints, -math.inf)
        upper = _numbers('upper', upper, n_joints, math.inf)
        reference = _numbers('reference', reference, n_joints, 0.0)
        for i in range(n_joints):
            if not (lower[i] <= upper[i] and lower[i] < math.inf and upper[i] > -math.inf):
                raise ValueError(f'limits of joint {i + 1}: no angle lies within '
                                 f'lower[{i}] = {lower[i]} and upper[{i}] = {upper[i]}')
            if not abs(reference[i]) <= LARGEST_REFERENCE:
                raise ValueError(f'reference[{i}] = {reference[i]}: must be finite, within '
                                 f'+-{LARGEST_REFERENCE:g} rad')
        return cls(lower, upper, reference, wrapped)

    @property
    def search_box(self):
        """
        Lower and upper limits of theta_2 ... theta_n for the search.

        Those a turn or more apart are no limits, for there z repeats itself.
        """
        lower, upper = self.lower[1:], self.upper[1:]
        free = upper - lower >= _TURN
        return np.where(free, -math.inf, lower), np.where(free, math.inf, upper)

    @property
    def first_angle(self):
        """Angle theta_1: the reference's, or the limit next to it."""
        return float(np.clip(self.reference[0], self.lower[0], self.upper[0]))

    def nearest_turns(self, angles):
        """
        Turn angles theta_2 ... theta_n to the equivalents nearest to the reference.

        Parameters
        ----------
        angles : array, shape (k, n - 1)

        Returns
        -------
        turned : array, shape (k, n - 1)
            Within the limits wherever that is possible.
        inside : array of bool, shape (k,)
            Where it is.
        """
        lower, upper, reference = self.lower[1:], self.upper[1:], self.reference[1:]
        least = np.ceil((lower - _SLACK - angles) / _TURN)
        most = np.floor((upper + _SLACK - angles) / _TURN)
        turns = np.clip(np.round((reference - angles) / _TURN), least, most)
        turned = np.clip(angles + _TURN * turns, lower, upper)
        return turned, (least <= most).all(axis=1)


def wrapped(angles):
    """Equivalents in (-pi, pi] of angles in rad."""
    angles = np.asarray(angles)
    return angles - _TURN * np.ceil((angles - math.pi) / _TURN)


def _numbers(name, values, n_joints, default):
    if values is None:
        return np.full(n_joints, default)
    try:
        numbers = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError(f'{name} = {values!r}: must be real numbers') from error
    if numbers.shape != (n_joints,):
        raise ValueError(f'{name} has shape {numbers.shape}: must hold n = {n_joints} angles, '
                         'one per link length')
    if np.isnan(numbers).any():
        i = int(np.argmax(np.isnan(numbers)))
        raise ValueError(f'{name}[{i}] = nan: must be a number')
    return numbers
