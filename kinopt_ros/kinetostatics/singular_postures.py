"""
Singular postures of an arm, and the least z among them.

The Jacobian loses rank exactly where the n joint centres lie on a line, that is where each of
theta_2 ... theta_(n-1) is 0 or pi; theta_1 and theta_n are free. So the singular set is
2^(n-2) curves in the space of theta_2 ... theta_n, each a full turn of theta_n.
"""

import math
from operator import index
from typing import NamedTuple

import numpy as np

from kinopt_ros.kinetostatics.planar_arm import MIN_JOINTS

# 2^18 folded shapes of twenty joints take about a hundred megabytes.
MAX_JOINTS = 20


class CriticalPosture(NamedTuple):
    """
    The singular posture that looks best to z.

    Attributes
    ----------
    z : float
        Index z at the posture, z_crit.
    joint_angles : array, shape (n,)
        In rad, theta_1 = 0.
    """

    z: float
    joint_angles: np.ndarray


def z_crit(arm):
    """
    Least index z over the singular postures of an arm, dimensionless, in [1/2, 1).

    A flag z > z_max marks every singular posture only if z_max < z_crit.

    Parameters
    ----------
    arm : PlanarArm

    Returns
    -------
    z_crit : float

    Raises
    ------
    ValueError
        If the arm has more than `MAX_JOINTS` joints.

    References
    ----------
    Chablat and Angeles, section "Applications to Design and Control" (the choice of z_M);
    docs/mathematics.md.
    """
    return critical_posture(arm).z


def critical_posture(arm):
    """
    Singular posture of least z, by the closed form over all foldings of the arm.

    Parameters
    ----------
    arm : PlanarArm

    Returns
    -------
    posture : CriticalPosture

    Raises
    ------
    ValueError
        If the arm has more than `MAX_JOINTS` joints.
    """
    folds = folded_directions(arm.n_joints)
    links = np.asarray(arm.unit_lengths)
    n = arm.n_joints
    # Joint centres along the line, from the first, then from their centroid.
    joints = np.zeros((len(folds), n))
    np.cumsum(folds * links[:-1], axis=1, out=joints[:, 1:])
    joints -= joints.mean(axis=1, keepdims=True)
    moment = np.sum(joints * joints, axis=1)
    # P is best on the ray from the last joint through the centroid of the joint centres.
    overshoot = links[-1] - np.abs(joints[:, -1])
    z = 1.0 - moment / (2.0 * (moment + n * overshoot * overshoot))
    best = int(np.argmin(z))
    towards_centroid = -1.0 if joints[best, -1] > 0.0 else 1.0
    directions = np.append(folds[best], towards_centroid)
    turned_back = directions[1:] != directions[:-1]
    angles = np.concatenate([[0.0], np.where(turned_back, math.pi, 0.0)])
    return CriticalPosture(float(z[best]), angles)


def singular_postures(n_joints, samples=361):
    """
    Singular postures of every arm with n joints, sampled along their curves.

    Parameters
    ----------
    n_joints : int
        From 3 to `MAX_JOINTS`.
    samples : int
        Number of values of theta_n, from -pi to pi inclusive, along each curve.

    Returns
    -------
    joint_angles : array, shape (2^(n-2), samples, n)
        In rad, theta_1 = 0. For n = 3 these are the lines theta_2 = 0 and theta_2 = pi.

    Raises
    ------
    ValueError
        If a number is out of range.
    """
    folds = folded_directions(n_joints)
    if index(samples) < 1:
        raise ValueError(f'samples = {samples}: must be at least 1')
    angles = np.zeros((len(folds), samples, n_joints))
    folded_back = folds[:, 1:] != folds[:, :-1]
    angles[:, :, 1:-1] = np.where(folded_back, math.pi, 0.0)[:, np.newaxis, :]
    angles[:, :, -1] = np.linspace(-math.pi, math.pi, samples)
    return angles


def folded_directions(n_joints):
    """
    Directions +1 or -1 of links 1 ... n - 1 in every folding onto a line, link 1 forward.

    Returns
    -------
    directions : array, shape (2^(n-2), n - 1)

    Raises
    ------
    ValueError
        If n_joints is not from 3 to `MAX_JOINTS`.
    """
    n = index(n_joints)
    if not MIN_JOINTS <= n <= MAX_JOINTS:
        raise ValueError(f'n = {n}: foldings are listed for {MIN_JOINTS} to {MAX_JOINTS} joints')
    foldings = np.arange(2 ** (n - 2))
    backward = foldings[:, np.newaxis] >> np.arange(n - 2) & 1
    return np.concatenate([np.ones((len(foldings), 1)), 1.0 - 2.0 * backward], axis=1)
