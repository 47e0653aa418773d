"""
A straight seam: the postures that trace it with the tool at a given angle, and its best place.

For arms with three joints, whose pose has two postures, one for each side of the elbow.
"""

import cmath
import math
from typing import NamedTuple

import numpy as np

from kinopt_ros.kinetostatics.index import kinetostatic_index
from kinopt_ros.kinetostatics.planar_arm import phase

# The search starts from a grid over all places in reach and zooms in on the best.
_GRID = 61
_ZOOMED_GRID = 9
_ZOOMS = 24
_SEAM_SAMPLES = 33


class SeamPlacement(NamedTuple):
    """
    Where a straight seam lies best, with the base at the origin and the seam along +x.

    Turning base and seam together by theta_1 changes nothing.

    Attributes
    ----------
    middle : complex
        Middle of the seam in m from the centre of joint 1; its imaginary part is the distance
        of the seam's line.
    elbow : int
        Sign of theta_2, 1 or -1, along the seam.
    largest_z : float
        Largest index z along the seam there.
    joint_angles : array, shape (k, 3)
        Postures in rad, equally spaced along the seam from its start to its end.
    """

    middle: complex
    elbow: int
    largest_z: float
    joint_angles: np.ndarray


def trace_seam(arm, start, end, tool_angle, elbow=1, samples=201):
    """
    Postures of a three-joint arm that trace a straight seam with the tool at a given angle.

    Parameters
    ----------
    arm : PlanarArm
        With n = 3.
    start, end : complex
        Ends of the seam in m, in the base frame (centre of joint 1 at the origin).
    tool_angle : float
        Angle in rad from the direction of the seam to the last link.
    elbow : int
        Sign of theta_2, 1 or -1.
    samples : int
        Number of postures, equally spaced along the seam.

    Returns
    -------
    joint_angles : array, shape (samples, 3)
        In rad. The largest z along the seam is the maximum of `kinetostatic_index` of these.

    Raises
    ------
    ValueError
        If the arm does not have three joints, elbow is not 1 or -1, the seam has no length,
        or a point of it is out of reach at that tool angle.

    References
    ----------
    Chablat and Angeles, section "Applications to Design and Control" (arc welding).
    """
    _check_joints(arm)
    if elbow not in (1, -1):
        raise ValueError(f'elbow = {elbow}: must be 1 or -1')
    length = abs(end - start)
    if not (math.isfinite(length) and length > 0.0):
        raise ValueError(f'start = {start}, end = {end}: the ends must be finite and distinct')
    along = np.linspace(0.0, 1.0, samples)
    direction = (end - start) / length
    angles = _inverse_kinematics(
        arm, start + along * (end - start), phase(direction) + tool_angle, elbow)
    reached = np.isfinite(angles).all(axis=-1)
    if not reached.all():
        where = along[np.argmin(reached)] * length
        raise ValueError(f'the seam from {start:.6g} to {end:.6g} is out of reach at '
                         f'{where:.6g} m from its start with tool_angle = {tool_angle:.6g} rad')
    return angles


def place_seam(arm, length, tool_angle, samples=201):
    """
    Place of a straight seam at which the largest z along it is least.

    Parameters
    ----------
    arm : PlanarArm
        With n = 3.
    length : float
        Length of the seam in m.
    tool_angle : float
        Angle in rad from the direction of the seam to the last link, held along the seam.
    samples : int
        Number of postures along the seam in the answer.

    Returns
    -------
    placement : SeamPlacement
        The best place found by a grid over all places in reach, zoomed in on the best; not a
        certificate. Both sides of the elbow are tried.

    Raises
    ------
    ValueError
        If the arm does not have three joints, length is not finite and positive, or no place
        lets the arm trace all of the seam.

    References
    ----------
    Chablat and Angeles, section "Applications to Design and Control": the seam should lie as
    close as possible to the conditioning circle.
    """
    _check_joints(arm)
    if not (math.isfinite(length) and length > 0.0):
        raise ValueError(f'length = {length}: must be finite and positive')
    reach = math.fsum(arm.link_lengths)
    placements = []
    for elbow in (1, -1):
        middle, worst = _best_middle(arm, length, tool_angle, elbow, 0j, reach, _GRID)
        step = 2.0 * reach / (_GRID - 1)
        for _ in range(_ZOOMS):
            candidate, its_worst = _best_middle(
                arm, length, tool_angle, elbow, middle, step, _ZOOMED_GRID)
            if its_worst < worst:
                middle, worst = candidate, its_worst
            step *= 0.5
        placements.append((worst, middle, elbow))
    worst, middle, elbow = min(placements, key=lambda placement: placement[0])
    if not math.isfinite(worst):
        raise ValueError(f'length = {length}: the arm, of reach {reach:.6g} m, cannot trace a '
                         f'seam that long with tool_angle = {tool_angle:.6g} rad')
    angles = trace_seam(arm, middle - length / 2.0, middle + length / 2.0, tool_angle, elbow,
                        samples)
    return SeamPlacement(middle, elbow, float(kinetostatic_index(arm, angles).z.max()), angles)


def _best_middle(arm, length, tool_angle, elbow, centre, half_width, count):
    """Give the best middle of the seam on a square grid, and the largest z of that seam."""
    ticks = np.linspace(-half_width, half_width, count)
    middles = centre + (ticks + 1j * ticks[:, np.newaxis]).ravel()
    along = np.linspace(-0.5 * length, 0.5 * length, _SEAM_SAMPLES)
    angles = _inverse_kinematics(arm, middles[:, np.newaxis] + along, tool_angle, elbow)
    traced = np.isfinite(angles).all(axis=(1, 2))
    if not traced.any():
        return centre, math.inf
    largest_z = kinetostatic_index(arm, angles[traced]).z.max(axis=1)
    best = np.argmin(largest_z)
    return complex(middles[traced][best]), float(largest_z[best])


def _inverse_kinematics(arm, operation_points, tool_direction, elbow):
    """Give theta_1, theta_2, theta_3 on a new last axis; NaN where out of reach."""
    first, second, last = arm.link_lengths
    wrists = operation_points - cmath.rect(last, tool_direction)
    cosine = (np.abs(wrists) ** 2 - first * first - second * second) / (2.0 * first * second)
    with np.errstate(invalid='ignore'):
        theta_2 = elbow * np.arccos(cosine)
    theta_1 = np.angle(wrists) - np.angle(first + second * np.exp(1j * theta_2))
    return np.stack([theta_1, theta_2, tool_direction - theta_1 - theta_2], axis=-1)


def _check_joints(arm):
    if arm.n_joints != 3:
        raise ValueError(f'arm has n = {arm.n_joints} joints: must have 3, a redundant arm '
                         'traces a seam in infinitely many ways')
