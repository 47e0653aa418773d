"""Model sets: the isotropic sets of points that a posture is compared with."""

from itertools import accumulate
import math
from operator import mul
from typing import NamedTuple

import numpy as np

from kinopt_ros.kinetostatics.index import kinetostatic_index
from kinopt_ros.kinetostatics.isotropic_chains import checked_numbering
from kinopt_ros.kinetostatics.isotropic_sets import regular_polygon
from kinopt_ros.kinetostatics.planar_arm import links_from_tip, unit_vector, unit_vectors

# Largest error, relative to n, of the sums that define a model set: K may be typed by hand.
_MODEL_SET_TOLERANCE = 1e-6

# Postures per block of a batch.
_BLOCK = 8192


class ModelSetIndex(NamedTuple):
    """
    What a posture scores against a given model set; floats for one posture, arrays for many.

    Attributes
    ----------
    z : float or array
        Half the squared distance of the normalised Jacobian to the model matrix in its best
        rotation, dimensionless, in [0, 1]; never below the z against the closest set.
    conditioning_length : float or array
        Conditioning length l_P in m of this model set; never below the one of the closest
        set, and infinite where no rotation brings the set closer (z = 1).
    margin : float or array
        Distance of the Jacobian, normalised by this l_P, to the nearest singular one with the
        same first row. It is 0 at singular postures and also where l_P is infinite; never
        above the margin of the closest set, nor above sqrt(1 - z).
    alpha : float or array
        Rotation in rad of the model set, in [-pi, pi], that attains z.
    mirrored : bool or array
        Whether the mirror image of the model set is the one rotated by alpha.
    """

    z: float
    conditioning_length: float
    margin: float
    alpha: float
    mirrored: bool

    @property
    def reciprocal_length(self):
        """Give the paper's lambda = 1 / l_P in 1/m."""
        return 1.0 / self.conditioning_length


def index_against(arm, joint_angles, model_set, mirror=False):
    """
    Index z, conditioning length, margin and rotation of a posture against a given model set.

    Parameters
    ----------
    arm : PlanarArm
    joint_angles : sequence of float, shape (n,), or array, shape (..., n)
        Relative joint angles in rad.
    model_set : array-like, complex, shape (n,)
        Points k_1 ... k_n, as `regular_polygon` or `model_set_of_matrix` give them.
    mirror : bool
        Whether the mirror image of the set may be used where it is closer.

    Returns
    -------
    index : ModelSetIndex
        Of floats for shape (n,), of arrays of shape (...) otherwise.

    Raises
    ------
    ValueError
        If the last axis does not hold n angles, an angle is not finite, or the model set does
        not hold n points with sum k_i = 0, sum k_i^2 = 0 and sum |k_i|^2 = 2 n.

    References
    ----------
    Chablat and Angeles, eqs. "l_P", "alpha-opt", "z-l_P"; docs/mathematics.md.
    """
    model_set = checked_model_set(model_set, arm.n_joints)
    closest = kinetostatic_index(arm, joint_angles)
    if isinstance(closest.z, float):
        z, length, alpha, mirrored = (value.item() for value in _index_of_block(
            arm, joint_angles, model_set, mirror, unit_vector))
    else:
        postures = np.asarray(joint_angles, dtype=float).reshape(-1, arm.n_joints)
        blocks = [_index_of_block(
            arm, postures[start:start + _BLOCK].T, model_set, mirror, unit_vectors)
            for start in range(0, max(len(postures), 1), _BLOCK)]
        z, length, alpha, mirrored = (
            np.concatenate(parts).reshape(closest.z.shape) for parts in zip(*blocks))
    # s2 does not depend on the model set, so that margin l_P is the same for all of them.
    margin = closest.margin * closest.conditioning_length / length
    return ModelSetIndex(z, length, margin, alpha, mirrored)


def model_polygon(n, numbering=None):
    """
    Regular polygon of radius sqrt(2) as a model set, in a given numbering.

    Parameters
    ----------
    n : int
        Number of joints, at least 3.
    numbering : sequence of int, length n, optional
        Entry i is the vertex, counted counterclockwise from 0, that joint i + 1 is compared
        with; without it 0 ... n - 1.

    Returns
    -------
    model_set : array, complex, shape (n,)

    Raises
    ------
    ValueError
        If n is below 3 or the numbering is not a permutation of 0 ... n - 1.

    References
    ----------
    Chablat and Angeles, Definition "Trivial isotropic set", sections "Example 1", "Example 2".
    """
    polygon = regular_polygon(n)
    return polygon[list(checked_numbering(numbering, n))]


def model_set_of_matrix(matrix):
    """
    Points k_1 ... k_n of a model matrix K, the inverse of `matrix_of_vectors`.

    Parameters
    ----------
    matrix : array-like, shape (3, n)
        First row ones, the other two the vectors E k_i.

    Returns
    -------
    model_set : array, complex, shape (n,)

    Raises
    ------
    ValueError
        If the matrix is not of shape (3, n) and finite, with n >= 3, or its first row is not
        ones, or K K^T is not n times the identity.

    References
    ----------
    Chablat and Angeles, eqs. "K", "KK^T", "k^2".
    """
    try:
        matrix = np.asarray(matrix, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError(f'matrix = {matrix!r}: must be real numbers') from error
    if matrix.ndim != 2 or matrix.shape[0] != 3 or matrix.shape[1] < 3:
        raise ValueError(f'matrix has shape {matrix.shape}: must be (3, n) with n >= 3')
    if not (matrix[0] == 1.0).all():
        raise ValueError(f'matrix[0] = {matrix[0].tolist()}: the first row must be ones')
    points = matrix[2] - 1j * matrix[1]
    checked_model_set(points, len(points))
    return points


def checked_model_set(model_set, n_joints):
    """
    Model set as a list of n complex numbers.

    Raises
    ------
    ValueError
        If it does not hold n finite points with sum k_i = 0, sum k_i^2 = 0 and
        sum |k_i|^2 = 2 n (each to a relative 1e-6).
    """
    try:
        points = [complex(point) for point in model_set]
    except (TypeError, ValueError) as error:
        raise ValueError(f'model_set = {model_set!r}: must be complex numbers x + i y') from error
    if len(points) != n_joints:
        raise ValueError(f'model_set has length {len(points)}: must hold n = {n_joints} points, '
                         'one per joint')
    rules = [('sum k_i', sum(points), 0.0),
             ('sum k_i^2', sum(map(mul, points, points)), 0.0),
             ('sum |k_i|^2', sum([abs(point) ** 2 for point in points]), 2.0 * n_joints)]
    for name, value, wanted in rules:
        # Written so that a NaN does not pass.
        if not abs(value - wanted) <= _MODEL_SET_TOLERANCE * n_joints:
            raise ValueError(f'model_set has {name} = {value:.6g}: must be {wanted:g} for an '
                             f'isotropic set of n = {n_joints} points')
    return points


def closest_model_set(arm, joint_angles):
    """
    Isotropic set k_1 ... k_n closest to a posture, the one that attains its index z.

    It is the polar factor of the centred vectors c_i (orthogonal Procrustes problem). At a
    singular posture the centred vectors lie on a line and the set is not unique: one of the
    closest is returned.

    Parameters
    ----------
    arm : PlanarArm
    joint_angles : array-like, shape (n,)
        Relative joint angles in rad of one posture.

    Returns
    -------
    model_set : array, complex, shape (n,)
        Dimensionless points with sum k_i = 0, sum k_i^2 = 0 and sum |k_i|^2 = 2 n, which is
        the paper's K K^T = n 1.

    Raises
    ------
    ValueError
        If there are not n angles, or an angle is not finite.

    References
    ----------
    Chablat and Angeles, eqs. "K", "KK^T", "k^2"; docs/mathematics.md.
    """
    vectors = arm.operation_point_vectors(joint_angles) / arm.longest_link
    if vectors.ndim != 1:
        raise ValueError(f'joint_angles has shape {np.shape(joint_angles)}: must be one '
                         f'posture of n = {arm.n_joints} angles')
    n = arm.n_joints
    centred = vectors - vectors.mean()
    axis = np.exp(0.5j * np.angle(np.sum(centred * centred)))
    along, across = (centred / axis).real, (centred / axis).imag
    along /= np.linalg.norm(along)
    across -= along * (along @ across)
    if np.linalg.norm(across) <= 1e-12 * np.linalg.norm(centred):
        across = _direction_outside(along)
    across /= np.linalg.norm(across)
    return math.sqrt(n) * axis * (along + 1j * across)


def _index_of_block(arm, joint_angles, model_set, mirror, unit_vector):
    """Give z, l_P, alpha and mirrored; joint angles along the first axis."""
    last_link, *links = links_from_tip(arm.unit_lengths, joint_angles, unit_vector)
    # Vectors from joint n ... joint 1 to the last joint: as the points k_i sum to zero the
    # last link drops out of the projections, in which a long one would only cost digits.
    to_last_joint = list(accumulate(links, initial=0j * last_link))
    r_squared = sum([_abs_squared(vector + last_link) for vector in to_last_joint])
    # The sum of conj(k_i) r_i is D + i N of the paper: its phase is alpha, not arctan(N / D),
    # which is off by half a turn where D is negative.
    model_set = model_set[::-1]
    projection = sum([k.conjugate() * vector for k, vector in zip(model_set, to_last_joint)])
    mirrored = np.zeros(np.shape(projection), dtype=bool)
    if mirror:
        of_mirror_image = sum(map(mul, model_set, to_last_joint))
        mirrored = np.abs(of_mirror_image) > np.abs(projection)
        projection = np.where(mirrored, of_mirror_image, projection)
    size = np.abs(projection)
    with np.errstate(divide='ignore', over='ignore'):
        length = arm.longest_link * r_squared / size
    return (np.abs(1.0 - size * size / (2.0 * arm.n_joints * r_squared)), length,
            np.angle(projection), mirrored)


def _abs_squared(vector):
    return vector.real * vector.real + vector.imag * vector.imag


def _direction_outside(along):
    """Give a direction of R^n orthogonal to the ones and to `along` (a unit vector)."""
    n = len(along)
    residuals = np.eye(n) - 1.0 / n - np.outer(along, along)
    return residuals[np.argmax(np.linalg.norm(residuals, axis=1))]
