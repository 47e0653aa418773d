"""The index over a grid of two conditioning joints, and the shape of z around an optimum."""

import math
from operator import index
from typing import NamedTuple

import numpy as np

from kinopt_ros.kinetostatics.hessian import index_expansion
from kinopt_ros.kinetostatics.index import kinetostatic_index, KinetostaticIndex
from kinopt_ros.kinetostatics.planar_arm import checked_joint_angles


class IndexGrid(NamedTuple):
    """
    The index over a rectangle of two joint angles.

    Attributes
    ----------
    first, second : array, shape (samples,)
        The two angles in rad.
    index : KinetostaticIndex
        Of arrays of shape (samples, samples): first angle along the first axis.
    """

    first: np.ndarray
    second: np.ndarray
    index: KinetostaticIndex


def index_over_grid(arm, samples=361, joints=(2, 3), posture=None, first=None, second=None):
    """
    Index of an arm over a grid of two conditioning joints, the other joints held.

    Parameters
    ----------
    arm : PlanarArm
    samples : int
        Number of values of each angle, at least 2.
    joints : pair of int
        The two joints, of 2 ... n, counted from 1 at the base.
    posture : array-like, shape (n,), optional
        Joint angles in rad at which the other joints are held; zeros without it.
    first, second : pair of float, optional
        Range of each angle in rad, 0 to 2 pi without it; both ends are sampled.

    Returns
    -------
    grid : IndexGrid

    Raises
    ------
    ValueError
        If the joints are not two different ones of 2 ... n, or an argument is out of range.

    References
    ----------
    Chablat and Angeles, section "The Isocontours of the Objective Function".
    """
    n = arm.n_joints
    check_joints(joints, n)
    if index(samples) < 2:
        raise ValueError(f'samples = {samples}: must be at least 2')
    held = np.zeros(n) if posture is None else checked_joint_angles(posture, n)
    if held.ndim != 1:
        raise ValueError(f'posture has shape {held.shape}: must be one posture, ({n},)')
    full_turn = (0.0, 2.0 * math.pi)
    first = np.linspace(*(full_turn if first is None else first), samples)
    second = np.linspace(*(full_turn if second is None else second), samples)
    angles = np.empty((samples, samples, n))
    angles[...] = held
    angles[..., joints[0] - 1] = first[:, np.newaxis]
    angles[..., joints[1] - 1] = second
    return IndexGrid(first, second, kinetostatic_index(arm, angles))


def principal_curvatures(arm, joint_angles):
    """
    Eigenvalues of the Hessian of z by theta_2 ... theta_n at a posture.

    At an optimum the isocontours are ellipses (ellipsoids) whose semiaxes are in the ratio of
    the square roots of these, circles if they are equal.

    Parameters
    ----------
    arm : PlanarArm
    joint_angles : array-like, shape (n,)
        A regular posture, in rad; z has a crease at singular ones.

    Returns
    -------
    curvatures : array, shape (n - 1,)
        Ascending, in 1/rad^2.

    Raises
    ------
    ValueError
        If there are not n finite angles of one posture.

    References
    ----------
    Chablat and Angeles, figures "cercle" and "elipse".
    """
    angles = checked_joint_angles(joint_angles, arm.n_joints)
    if angles.ndim != 1:
        raise ValueError(f'joint_angles has shape {angles.shape}: must be one posture of '
                         f'n = {arm.n_joints} angles')
    return np.linalg.eigvalsh(index_expansion(arm, angles[np.newaxis, 1:]).hessian[0])


def check_joints(joints, n_joints):
    """
    Check the joints of a grid.

    Raises
    ------
    ValueError
        If they are not two different ones of 2 ... n.
    """
    if len(set(joints)) != 2 or not set(joints) <= set(range(2, n_joints + 1)):
        raise ValueError(f'joints = {tuple(joints)}: must be two different ones of '
                         f'2 ... {n_joints}')
