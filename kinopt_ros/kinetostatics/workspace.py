"""
How much of the joint torus is useful, flagged, missed, by thresholds on z and on the margin.

Fractions are of the torus of the conditioning joints theta_2 ... theta_n. The last joint is
integrated in closed form: with the other joints held, s1 and s2 stay and only

    R = P + n |m|^2,    |m|^2 = a_n^2 + rho^2 + 2 a_n rho cos(psi)

changes, psi being theta_n up to a constant and rho the distance from the last joint to the
centroid of the joint centres. Both z <= z_max and margin >= margin_min bound R from above, so
the unflagged postures form one arc of psi. The other n - 2 joints are averaged over shifted
point sets (Kronecker sequences), whose scatter gives the error.
"""

import math
from typing import NamedTuple

import numpy as np

from kinopt_ros.kinetostatics.low_discrepancy import kronecker_sequence
from kinopt_ros.kinetostatics.planar_arm import unit_vectors

NEIGHBOURHOOD = math.radians(5.0)

_SHIFTS = 8


class Estimate(NamedTuple):
    """
    A fraction with the error of its numerical integration.

    Attributes
    ----------
    fraction : float
        In [0, 1].
    error : float
        Standard error of the fraction, from independently shifted point sets.
    """

    fraction: float
    error: float


class ThresholdsStudy(NamedTuple):
    """
    What thresholds mark on an arm; a posture is flagged if z > z_max or margin < margin_min.

    Attributes
    ----------
    flagged : Estimate
        Fraction of the torus of the conditioning joints that is flagged.
    missed : Estimate
        Fraction of the neighbourhood of the singular postures that is not flagged.
    false_alarms : Estimate
        Fraction of the torus outside that neighbourhood that is flagged.
    """

    flagged: Estimate
    missed: Estimate
    false_alarms: Estimate


def useful_workspace(arm, z_max, samples=4096):
    """
    Fraction of the torus of the conditioning joints with z <= z_max.

    Parameters
    ----------
    arm : PlanarArm
    z_max : float
        The paper's z_M, in [0, 1].
    samples : int
        Points of each of eight shifted point sets.

    Returns
    -------
    useful : Estimate

    Raises
    ------
    ValueError
        If z_max or samples is out of range.

    References
    ----------
    Chablat and Angeles, section "Applications to Design and Control".
    """
    unflagged = _torus_mean(arm, z_max, 0.0, samples, _whole_torus)
    return _estimate(unflagged)


def study_thresholds(arm, z_max, margin_min, neighbourhood=NEIGHBOURHOOD, samples=4096):
    """
    Fractions flagged, missed and falsely alarmed at given thresholds.

    A posture is in the neighbourhood of the singular ones when each of theta_2 ...
    theta_(n-1) is within `neighbourhood` of 0 or pi: then moving no joint further than that
    reaches a singular posture.

    Parameters
    ----------
    arm : PlanarArm
    z_max : float
        Largest z that is not flagged, in [0, 1].
    margin_min : float
        Smallest margin that is not flagged, in [0, 1].
    neighbourhood : float
        In rad, above 0 and below pi / 2.
    samples : int
        Points of each of eight shifted point sets.

    Returns
    -------
    study : ThresholdsStudy

    Raises
    ------
    ValueError
        If an argument is out of range.
    """
    if not 0.0 < neighbourhood < math.pi / 2.0:
        raise ValueError(f'neighbourhood = {neighbourhood}: must be above 0 and below pi / 2')
    if not 0.0 <= margin_min <= 1.0:
        raise ValueError(f'margin_min = {margin_min}: must be within [0, 1]')

    def near_singularities(cube):
        side, place = np.divmod(2.0 * cube, 1.0)
        return math.pi * side + neighbourhood * (2.0 * place - 1.0)

    unflagged = _torus_mean(arm, z_max, margin_min, samples, _whole_torus)
    missed = _torus_mean(arm, z_max, margin_min, samples, near_singularities)
    near = (2.0 * neighbourhood / math.pi) ** (arm.n_joints - 2)
    false_alarms = 1.0 - (unflagged - near * missed) / (1.0 - near)
    return ThresholdsStudy(_estimate(1.0 - unflagged), _estimate(missed),
                           _estimate(np.clip(false_alarms, 0.0, 1.0)))


def _torus_mean(arm, z_max, margin_min, samples, joint_angles_of):
    """Give the mean of `_unflagged_arc` over each of the shifted point sets."""
    if not 0.0 <= z_max <= 1.0:
        raise ValueError(f'z_max = {z_max}: must be within [0, 1]')
    if samples < 1:
        raise ValueError(f'samples = {samples}: must be at least 1')
    shifts = np.random.default_rng(0).random((_SHIFTS, arm.n_joints - 2))
    points = kronecker_sequence(samples, arm.n_joints - 2)
    return np.array([
        np.mean(_unflagged_arc(arm, z_max, margin_min, joint_angles_of((points + shift) % 1.0)))
        for shift in shifts])


def _whole_torus(cube):
    return 2.0 * math.pi * cube


def _unflagged_arc(arm, z_max, margin_min, inner_angles):
    """
    Fraction of the turn of theta_n that is not flagged.

    Parameters
    ----------
    inner_angles : array, shape (k, n - 2)
        theta_2 ... theta_(n-1) in rad.

    Returns
    -------
    fraction : array, shape (k,)
    """
    n = arm.n_joints
    directions = np.cumprod(unit_vectors(inner_angles), axis=1)
    joints = np.zeros((len(inner_angles), n), dtype=complex)
    joints[:, 1] = arm.unit_lengths[0]
    joints[:, 2:] = joints[:, 1:2] + np.cumsum(directions * arm.unit_lengths[1:-1], axis=1)
    joints -= joints.mean(axis=1, keepdims=True)
    joints *= unit_vectors(-0.5 * np.angle(np.sum(joints * joints, axis=1)))[:, np.newaxis]
    s1 = np.linalg.norm(joints.real, axis=1)
    s2 = np.linalg.norm(joints.imag, axis=1)
    # A division by 0 is a threshold that flags nothing: z_max = 1, margin_min = 0.
    with np.errstate(divide='ignore', invalid='ignore'):
        largest_r_squared = np.fmin((s1 + s2) ** 2 / (2.0 * (1.0 - z_max)),
                                    s2 * (s1 + s2) / margin_min)
        largest_m_squared = (largest_r_squared - s1 * s1 - s2 * s2) / n
        last, rho = arm.unit_lengths[-1], np.abs(joints[:, -1])
        cosine = (largest_m_squared - last * last - rho * rho) / (2.0 * last * rho)
    return 1.0 - np.arccos(np.clip(cosine, -1.0, 1.0)) / math.pi


def _estimate(values):
    return Estimate(float(np.mean(values)), float(np.std(values, ddof=1) / math.sqrt(_SHIFTS)))
