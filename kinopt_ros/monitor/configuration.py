"""
The monitor's configuration: all parameters judged together into one frozen object.

Nothing here knows of a node: `Configuration.from_parameters` takes plain values by name.
"""

from dataclasses import dataclass
from functools import lru_cache
import math

import numpy as np

from kinopt_ros.kinetostatics.gradient import index_gradient, IndexGradient
from kinopt_ros.kinetostatics.gradient_against import gradient_against
from kinopt_ros.kinetostatics.index import kinetostatic_index
from kinopt_ros.kinetostatics.model_set import closest_model_set, index_against, model_polygon
from kinopt_ros.kinetostatics.planar_arm import MIN_JOINTS, PlanarArm
from kinopt_ros.kinetostatics.singular_postures import z_crit
from kinopt_ros.monitor.verdict import Thresholds

# Value of z_max that stands for the least z over the singular postures of the arm.
USE_Z_CRIT = -1.0
# The threshold is this much lower, or rounding could leave the critical posture unflagged.
Z_CRIT_SLACK = 1e-9

# Offsets count turns at most; with this bound no finite position overflows when one is added.
LARGEST_OFFSET = 1e5


@dataclass(frozen=True)
class MeasuredArm:
    """
    A planar arm together with the joint coordinates in which it is measured and commanded.

    Attributes
    ----------
    joint_names : tuple of str, shape (n,)
        Base to tip.
    planar_arm : PlanarArm
    joint_offsets, joint_directions : tuple of float, shape (n,)
        theta_i = direction_i * position_i + offset_i, in rad.
    joint_lower, joint_upper : tuple of float, shape (n,)
        Limits of the measured positions in rad; infinite where a joint is free.
    """

    joint_names: tuple
    planar_arm: PlanarArm
    joint_offsets: tuple
    joint_directions: tuple
    joint_lower: tuple
    joint_upper: tuple

    @classmethod
    def from_parameters(cls, values):
        """
        Judge the parameters of the arm together.

        Parameters
        ----------
        values : dict of str to value
            By the names of the parameters; None where a parameter has no value.

        Raises
        ------
        ValueError
            If a value, or several together, break a rule: names the parameter, its value and
            the rule.
        """
        try:
            joint_names = _joint_names(values['joint_names'])
            n = len(joint_names)
            return cls(
                joint_names,
                PlanarArm(_one_per_joint('link_lengths', values['link_lengths'], n)),
                _offsets(values['joint_offsets'], n),
                _directions(values['joint_directions'], n),
                *_limits(values['joint_lower'], values['joint_upper'], joint_names))
        except ValueError as error:
            raise ValueError(f'parameter {error}') from error

    def joint_angles(self, positions):
        """Relative joint angles theta_i (rad) of measured joint positions (rad)."""
        return [direction * position + offset for direction, position, offset
                in zip(self.joint_directions, positions, self.joint_offsets)]

    @property
    def n_joints(self):
        """Number of joints n."""
        return len(self.joint_names)

    def angles_between(self, lower, upper):
        """Lower and upper theta_i (rad) of the limits of measured positions (rad)."""
        ends = zip(self.joint_angles(lower), self.joint_angles(upper))
        return tuple(zip(*(sorted(pair) for pair in ends)))

    def nearest_limit(self, positions):
        """
        Give the smallest distance (rad) of measured positions to a limit, and its joint.

        The distance is negative beyond the limit; None where no joint has a limit.
        """
        distance, joint = min(
            (min(position - lower, upper - position), name) for name, position, lower, upper
            in zip(self.joint_names, positions, self.joint_lower, self.joint_upper))
        return (distance, joint) if math.isfinite(distance) else None

    def joint_positions(self, joint_angles):
        """Measured joint positions (rad) that make relative joint angles theta_i (rad)."""
        return [direction * (angle - offset) for direction, angle, offset
                in zip(self.joint_directions, joint_angles, self.joint_offsets)]


@dataclass(frozen=True)
class Configuration:
    """
    What the monitor works with between two changes of its parameters.

    Attributes
    ----------
    arm : MeasuredArm
    thresholds : Thresholds
    model_set : array, complex, shape (n,), or None
        The model set to compare with; None for the closest of all.
    model_mirror : bool
        Whether the mirror image of the model set may be used where it is closer.
    stale_timeout : float
        Age in s beyond which a position no longer counts.
    diagnostics_period : float
        Period of the diagnostics in s; 0 for each cycle.
    marker_rate : float
        Most markers per second.
    base_frame : str
        Frame of the markers.
    """

    arm: MeasuredArm
    thresholds: Thresholds
    model_set: np.ndarray
    model_mirror: bool
    stale_timeout: float
    diagnostics_period: float
    marker_rate: float
    base_frame: str

    @classmethod
    def from_parameters(cls, values):
        """
        Judge a whole set of parameter values.

        Parameters and errors as of `MeasuredArm.from_parameters`.
        """
        arm = MeasuredArm.from_parameters(values)
        try:
            return cls(
                arm=arm,
                thresholds=Thresholds(_z_max(values['z_max'], arm.planar_arm),
                                      values['margin_min'], values['hysteresis'],
                                      values['min_dwell']),
                model_set=_model_set(values['model_set'], values['model_numbering'],
                                     arm.n_joints),
                model_mirror=values['model_mirror'],
                stale_timeout=_duration('stale_timeout', values['stale_timeout'], zero=False),
                diagnostics_period=_duration('diagnostics_period', values['diagnostics_period'],
                                             zero=True),
                marker_rate=values['marker_rate'],
                base_frame=values['base_frame'])
        except ValueError as error:
            raise ValueError(f'parameter {error}') from error

    def index(self, positions):
        """Index of measured joint positions (rad) against the model set."""
        angles = self.arm.joint_angles(positions)
        if self.model_set is None:
            return kinetostatic_index(self.arm.planar_arm, angles)
        return index_against(self.arm.planar_arm, angles, self.model_set, self.model_mirror)

    def attained_model_set(self, positions, index):
        """Give the model set, turned as it attains the index of measured positions (rad)."""
        if self.model_set is None:
            return closest_model_set(self.arm.planar_arm, self.arm.joint_angles(positions))
        points = np.conj(self.model_set) if index.mirrored else self.model_set
        return points * np.exp(1j * index.alpha)

    def gradient(self, positions):
        """Gradients of that index's z and margin by measured joint positions, in 1/rad."""
        angles = self.arm.joint_angles(positions)
        if self.model_set is None:
            gradient = index_gradient(self.arm.planar_arm, angles)
        else:
            gradient = gradient_against(
                self.arm.planar_arm, angles, self.model_set, self.model_mirror)
        return IndexGradient(*(self.arm.joint_directions * values for values in gradient))


def _z_max(value, planar_arm):
    return _just_below_z_crit(planar_arm) if value == USE_Z_CRIT else value


# Judged at every change of any parameter, and for twenty joints it takes most of a second.
@lru_cache(maxsize=2)
def _just_below_z_crit(planar_arm):
    return z_crit(planar_arm) - Z_CRIT_SLACK


def _model_set(kind, numbering, n):
    if kind == 'closest':
        return None
    if kind != 'polygon':
        raise ValueError(f"model_set = '{kind}': must be 'closest' or 'polygon'")
    try:
        return model_polygon(n, numbering or None)
    except ValueError as error:
        raise ValueError(f'model_numbering = {list(numbering)}: must hold each of 0 to {n - 1} '
                         'once') from error


def _joint_names(names):
    if not names:
        raise ValueError(f"joint_names is required: the arm's joints, base to tip, at least "
                         f'{MIN_JOINTS}')
    if len(names) < MIN_JOINTS:
        raise ValueError(f'joint_names = {list(names)}: must name at least {MIN_JOINTS} joints')
    for name in names:
        if not name:
            raise ValueError(f'joint_names = {list(names)}: a name must not be empty')
        if list(names).count(name) > 1:
            raise ValueError(f"joint_names = {list(names)}: '{name}' stands there more than once")
    return tuple(names)


def _one_per_joint(name, values, n):
    if values is None or len(values) == 0:
        raise ValueError(f'{name} is required: one value per joint name')
    if len(values) != n:
        raise ValueError(f'{name} = {list(values)}: must hold {n} values, one per joint name')
    return tuple(values)


def _offsets(values, n):
    for i, offset in enumerate(_one_per_joint('joint_offsets', values, n)):
        if not abs(offset) <= LARGEST_OFFSET:
            raise ValueError(f'joint_offsets[{i}] = {offset}: must be within '
                             f'+-{LARGEST_OFFSET:g} rad')
    return tuple(values)


def _directions(values, n):
    for i, direction in enumerate(_one_per_joint('joint_directions', values, n)):
        if direction not in (1, -1):
            raise ValueError(f'joint_directions[{i}] = {direction}: must be +1 or -1')
    return tuple(float(direction) for direction in values)


def _limits(lower, upper, joint_names):
    n = len(joint_names)
    lower = _one_per_joint('joint_lower', lower, n)
    upper = _one_per_joint('joint_upper', upper, n)
    for i, name in enumerate(joint_names):
        if not lower[i] <= upper[i]:
            raise ValueError(f'joint_lower[{i}] = {lower[i]} with joint_upper[{i}] = {upper[i]}: '
                             f"the lower limit of '{name}' must not exceed the upper")
        if lower[i] == math.inf or upper[i] == -math.inf:
            raise ValueError(f'joint_lower[{i}] = {lower[i]} with joint_upper[{i}] = {upper[i]}: '
                             f"no position of '{name}' is within")
    return lower, upper


def _duration(name, value, zero):
    if not math.isfinite(value) or value < 0.0 or (value == 0.0 and not zero):
        raise ValueError(f'{name} = {value}: must be a finite time in s, '
                         f'{"not negative" if zero else "above 0"}')
    return value
