"""
A planar serial arm with revolute joints: its link lengths and what follows from a posture.

Vectors of the plane are complex numbers x + i y throughout this package, so that a rotation is
a product and the paper's matrix E, a quarter turn counterclockwise, is the factor i.
"""

import cmath
from dataclasses import dataclass, field
from functools import partial
from itertools import accumulate
import math

import numpy as np

MIN_JOINTS = 3
# Far beyond any arm, and near enough for squares of ratios to stay within floating point.
SHORTEST_LINK, LONGEST_LINK = 1e-50, 1e50


@dataclass(frozen=True)
class PlanarArm:
    """
    A planar arm given by its link lengths, from the base to the tip.

    Link i carries joints i and i + 1; the last link carries joint n and the operation point P.

    Parameters
    ----------
    link_lengths : sequence of float, shape (n,)
        Link lengths a_1 ... a_n in m, n >= 3, each within 1e-50..1e50.

    Attributes
    ----------
    longest_link : float
        Length in m of the longest link.
    unit_lengths : tuple of float, shape (n,)
        Link lengths divided by the longest, dimensionless: squares of lengths neither overflow
        nor underflow in this unit.

    Raises
    ------
    ValueError
        If there are fewer than three link lengths or one is not positive or out of range.

    References
    ----------
    Chablat and Angeles, "On the Kinetostatic Optimization of Revolute-Coupled Planar
    Manipulators", sections "An Outline of Kinematic Chains" and "Algebraic Background".
    """

    link_lengths: tuple
    longest_link: float = field(init=False, repr=False, compare=False)
    unit_lengths: tuple = field(init=False, repr=False, compare=False)

    def __post_init__(self):
        lengths = checked_link_lengths(self.link_lengths)
        longest = max(lengths)
        object.__setattr__(self, 'link_lengths', lengths)
        object.__setattr__(self, 'longest_link', longest)
        object.__setattr__(self, 'unit_lengths', tuple(length / longest for length in lengths))

    @property
    def n_joints(self):
        """Number of joints n."""
        return len(self.link_lengths)

    def operation_point_vectors(self, joint_angles):
        """
        Vectors r_i from each joint centre to the operation point.

        Parameters
        ----------
        joint_angles : array-like, shape (n,) or (..., n)
            Relative joint angles theta_1 ... theta_n in rad, of one posture or of many.

        Returns
        -------
        vectors : array, complex, shape (n,) or (..., n)
            r_1 ... r_n in m, in the base frame.

        Raises
        ------
        ValueError
            If the last axis does not hold n angles, or an angle is not finite.
        """
        angles = checked_joint_angles(joint_angles, self.n_joints)
        links = links_from_tip(self.link_lengths, np.moveaxis(angles, -1, 0), unit_vectors)
        return np.stack(list(accumulate(links))[::-1], axis=-1)

    def jacobian(self, joint_angles):
        """
        Jacobian matrix J of a posture, the paper's eq. "jacobian_matrix".

        Parameters
        ----------
        joint_angles : array-like, shape (n,) or (..., n)
            Relative joint angles in rad.

        Returns
        -------
        jacobian : array, shape (3, n) or (..., 3, n)
            First row ones (dimensionless), the other two the vectors E r_i in m: it maps joint
            rates to the angular velocity of the end-effector and the velocity of P.

        Raises
        ------
        ValueError
            If the last axis does not hold n angles, or an angle is not finite.
        """
        return matrix_of_vectors(self.operation_point_vectors(joint_angles))

    def rms_distance(self, joint_angles):
        """
        Root-mean-square distance d_rms in m of the joint centres from the operation point.

        Parameters
        ----------
        joint_angles : array-like, shape (n,) or (..., n)
            Relative joint angles in rad.

        Returns
        -------
        d_rms : float or array, shape (...)
            sqrt(sum |r_i|^2 / n), the length in the paper's eq. "l_P".
        """
        vectors = self.operation_point_vectors(joint_angles) / self.longest_link
        return self.longest_link * np.sqrt(np.mean(np.abs(vectors) ** 2, axis=-1))


def matrix_of_vectors(vectors):
    """
    Give the 3 x n matrix with a row of ones over the vectors turned by a quarter turn.

    It is the Jacobian for the vectors r_i (m) and a model matrix K for a model set k_i
    (dimensionless), the paper's eqs. "jacobian_matrix" and "K".

    Parameters
    ----------
    vectors : array, complex, shape (..., n)

    Returns
    -------
    matrix : array, shape (..., 3, n)
    """
    turned = 1j * np.asarray(vectors)
    return np.stack([np.ones(turned.shape), turned.real, turned.imag], axis=-2)


def links_from_tip(link_lengths, joint_angles, unit_vector):
    """
    Link vectors a_i exp(i phi_i) from the last to the first, without validation.

    Works for one posture and for arrays of postures alike. A product of unit vectors rather
    than a sum of angles keeps the accuracy when an angle counts many turns.

    Parameters
    ----------
    link_lengths : sequence of float, length n
    joint_angles : sequence of n floats (rad), or of n equally shaped arrays of them
    unit_vector : callable
        exp(i t) for a float, or for an array.

    Returns
    -------
    links : list of n complex numbers or arrays, in the unit of the link lengths
        Their partial sums are r_n ... r_1.
    """
    links = []
    direction = 1.0
    for length, angle in zip(link_lengths, joint_angles):
        direction = direction * unit_vector(angle)
        links.append(length * direction)
    links.reverse()
    return links


unit_vector = partial(cmath.rect, 1.0)


def unit_vectors(angles):
    """Unit vectors exp(i t) in the directions of an array of angles t in rad."""
    return np.exp(1j * angles)


def norm_of_arrays(*components):
    """Norms of vectors given by arrays of their components."""
    return np.sqrt(sum(component * component for component in components))


def phase(vector):
    """Phase in rad of one vector; cmath's own raises OverflowError where it underflows to 0."""
    return math.atan2(vector.imag, vector.real)


def checked_link_lengths(link_lengths):
    """
    Link lengths as a tuple of floats.

    Raises
    ------
    ValueError
        If there are fewer than three link lengths or one is not positive or out of range.
    """
    try:
        lengths = np.asarray(link_lengths, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f'link_lengths = {link_lengths!r}: must be real numbers') from error
    if lengths.ndim != 1 or lengths.size < MIN_JOINTS:
        raise ValueError(f'link_lengths has shape {lengths.shape}: must hold n >= {MIN_JOINTS} '
                         'lengths, one per joint')
    for i, length in enumerate(lengths.tolist()):
        if not SHORTEST_LINK <= length <= LONGEST_LINK:
            raise ValueError(f'link_lengths[{i}] = {length}: must be finite and positive, '
                             f'{SHORTEST_LINK:g} to {LONGEST_LINK:g} m')
    return tuple(lengths.tolist())


def checked_joint_angles(joint_angles, n_joints):
    """
    Joint angles as an array of floats with n on its last axis.

    Raises
    ------
    ValueError
        If the last axis does not hold n angles, or an angle is not finite.
    """
    try:
        angles = np.asarray(joint_angles, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f'joint_angles = {joint_angles!r}: must be real numbers') from error
    if angles.ndim < 1 or angles.shape[-1] != n_joints:
        raise ValueError(f'joint_angles has shape {angles.shape}: the last axis must hold '
                         f'n = {n_joints} angles, one per link length')
    finite = np.isfinite(angles)
    if not finite.all():
        where = tuple(int(i) for i in np.argwhere(~finite)[0])
        raise ValueError(f'joint_angles{list(where)} = {angles[where]}: must be finite')
    return angles
