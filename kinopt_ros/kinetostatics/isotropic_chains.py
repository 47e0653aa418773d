"""
Isotropic chains: the arms that an isotropic set of points generates by numbering its points.

The points in the order of a numbering are the joint centres; the operation point is the
centroid of the set, so that the posture is isotropic.
"""

from itertools import permutations
import math
from typing import NamedTuple

import numpy as np

from kinopt_ros.kinetostatics.isotropic_sets import (
    centroid,
    checked_points,
    is_isotropic,
    regular_polygon,
    rms_distance_to_centroid,
)
from kinopt_ros.kinetostatics.planar_arm import MIN_JOINTS

# 9! numberings are 363 thousand; ten points would be 3.6 million and a hundred megabytes.
MAX_POINTS = 9

_RELATIVE_TOLERANCE = 1e-9


class IsotropicChain(NamedTuple):
    """
    An isotropic arm in its isotropic posture.

    Attributes
    ----------
    numbering : tuple of int, length n
        numbering[i] is the place in the set, from 0, of the point that is joint i + 1.
    points : array, complex, shape (n,)
        Joint centres from joint 1 to joint n, in m.
    link_lengths : tuple of float, length n
        Link lengths a_1 ... a_n in m; the last link ends at the centroid.
    joint_angles : tuple of float, length n
        Relative joint angles in rad, within (-pi, pi]; theta_1 from the x axis.
    """

    numbering: tuple
    points: np.ndarray
    link_lengths: tuple
    joint_angles: tuple

    @property
    def reach(self):
        """Largest distance in m of the operation point from joint 1: the sum of the links."""
        return math.fsum(self.link_lengths)


def all_numberings(n):
    """
    Every numbering of n points, in lexicographic order.

    Parameters
    ----------
    n : int
        From 1 to `MAX_POINTS`.

    Returns
    -------
    numberings : array of int, shape (n!, n)

    Raises
    ------
    ValueError
        If n is out of that range.

    References
    ----------
    Chablat and Angeles, section "Isotropic Kinematic Chains".
    """
    if not 1 <= n <= MAX_POINTS:
        raise ValueError(f'n = {n}: numberings are listed for 1 to {MAX_POINTS} points')
    count = math.factorial(n)
    flat = np.fromiter((i for order in permutations(range(n)) for i in order), np.int8, count * n)
    return flat.reshape(count, n)


def distinct_numberings(points, reflections=True):
    """
    Numberings of a set of points that give chains of different shape.

    Two numberings give the same shape when a symmetry of the set takes one into the other;
    the lexicographically first of each class is listed.

    Parameters
    ----------
    points : array-like, complex, shape (n,)
    reflections : bool
        True: up to congruence, so a chain and its mirror image count once. False: up to
        rotation, the paper's count of six for the square.

    Returns
    -------
    numberings : array of int, shape (m, n)

    Raises
    ------
    ValueError
        If the points are not finite and distinct, or more than `MAX_POINTS`.

    References
    ----------
    Chablat and Angeles, section "Example 2", figure "4dof_posture_isotrope".
    """
    points = _checked_set(points)
    numberings = all_numberings(len(points))
    first_of_class = np.ones(len(numberings), dtype=bool)
    for symmetry in symmetries(points, reflections):
        first_of_class &= ~_precedes(symmetry.astype(np.int8)[numberings], numberings)
    return numberings[first_of_class]


def symmetries(points, reflections=True):
    """
    Rotations (and reflections) that take a set of points into itself, as permutations.

    Parameters
    ----------
    points : array-like, complex, shape (n,)
    reflections : bool
        Whether to include the reflections.

    Returns
    -------
    symmetries : list of arrays of int, shape (n,)
        Entry i of one is the place of the point onto which point i falls.

    Raises
    ------
    ValueError
        If the points are not finite and distinct.
    """
    points = _checked_set(points)
    centred = points - centroid(points)
    size = np.abs(centred).max()
    reference = int(np.argmax(np.abs(centred)))
    found = []
    for image in [centred, np.conj(centred)] if reflections else [centred]:
        for target in centred:
            moved = image * (target / image[reference])
            apart = np.abs(moved[:, np.newaxis] - centred)
            if (apart.min(axis=1) <= _RELATIVE_TOLERANCE * size).all():
                found.append(np.argmin(apart, axis=1))
    return found


def chain_of(points, numbering=None):
    """
    Chain whose joint centres are the points in the order of a numbering.

    Parameters
    ----------
    points : array-like, complex, shape (n,)
        In m. The chain is isotropic if the set of points is.
    numbering : sequence of int, length n, optional
        Place of the point of joint 1, joint 2, ... from 0; without it the order of the points.

    Returns
    -------
    chain : IsotropicChain

    Raises
    ------
    ValueError
        If the numbering is not a permutation, two points coincide, or the last one lies on
        the centroid: a link would have no length.

    References
    ----------
    Chablat and Angeles, Definition "Isotropic kinematic chain".
    """
    points = _checked_set(points)
    order = checked_numbering(numbering, len(points))
    joints = points[list(order)]
    links = np.diff(joints, append=centroid(points))
    lengths = np.abs(links)
    if lengths[-1] <= _RELATIVE_TOLERANCE * lengths.max():
        raise ValueError(f'numbering = {order}: its last point lies on the centroid, the last '
                         'link would have no length')
    turns = links / np.concatenate([[1.0], links[:-1]])
    return IsotropicChain(order, joints, tuple(lengths.tolist()),
                          tuple(np.angle(turns).tolist()))


def isotropic_chains(points, reflections=True):
    """
    Chains of different shape that an isotropic set of points generates.

    Parameters
    ----------
    points : array-like, complex, shape (n,)
        An isotropic set, in m.
    reflections : bool
        As for `distinct_numberings`.

    Returns
    -------
    chains : list of IsotropicChain
        In the order of their numberings, without those whose last joint would lie on the
        operation point.

    Raises
    ------
    ValueError
        If the set is not isotropic, its points are not distinct, or more than `MAX_POINTS`.

    References
    ----------
    Chablat and Angeles, section "Isotropic Kinematic Chains".
    """
    points = _checked_set(points)
    if not is_isotropic(points):
        raise ValueError('points: the second moment about the centroid must be isotropic')
    from_centroid = np.abs(points - centroid(points))
    usable_last = from_centroid > _RELATIVE_TOLERANCE * from_centroid.max()
    return [chain_of(points, numbering.tolist())
            for numbering in distinct_numberings(points, reflections)
            if usable_last[numbering[-1]]]


def design_isotropic_arms(n, reach=None, d_rms=None, points=None):
    """
    Isotropic arms of n joints with a wanted size, one for each distinct numbering.

    Parameters
    ----------
    n : int
        Number of joints, 3 to `MAX_POINTS`.
    reach : float, optional
        Wanted sum of the link lengths in m.
    d_rms : float, optional
        Wanted root-mean-square distance in m of the joint centres from the operation point in
        the isotropic posture, sqrt(2) times the characteristic length. One of the two is given.
    points : array-like, complex, shape (n,), optional
        Isotropic set that gives the shape, at any scale; a regular polygon without it.

    Returns
    -------
    chains : list of IsotropicChain
        The most compact first: by the ratio of reach to d_rms.

    Raises
    ------
    ValueError
        If not exactly one of reach and d_rms is given, it is not finite and positive, n is
        out of range, or the points are not n distinct points of an isotropic set.

    References
    ----------
    Chablat and Angeles, section "Applications to Design and Control".
    """
    wanted = [(name, size) for name, size in [('reach', reach), ('d_rms', d_rms)]
              if size is not None]
    if len(wanted) != 1:
        raise ValueError(f'reach = {reach}, d_rms = {d_rms}: exactly one of the two must be given')
    name, size = wanted[0]
    if not (math.isfinite(size) and size > 0.0):
        raise ValueError(f'{name} = {size}: must be finite and positive')
    if not MIN_JOINTS <= n <= MAX_POINTS:
        raise ValueError(f'n = {n}: must be from {MIN_JOINTS} to {MAX_POINTS}')
    shape = regular_polygon(n) if points is None else checked_points(points)
    if len(shape) != n:
        raise ValueError(f'points has shape {shape.shape}: must hold n = {n} points')
    shape = shape / rms_distance_to_centroid(shape)
    chains = sorted(isotropic_chains(shape), key=lambda chain: chain.reach)
    if name == 'd_rms':
        return [_scaled(chain, size) for chain in chains]
    return [_scaled(chain, size / chain.reach) for chain in chains]


def checked_numbering(numbering, n):
    """
    Numbering as a tuple of n ints; None stands for 0 ... n - 1.

    Raises
    ------
    ValueError
        If it is not a permutation of 0 ... n - 1.
    """
    if numbering is None:
        return tuple(range(n))
    order = tuple(numbering)
    if sorted(order) != list(range(n)):
        raise ValueError(f'numbering = {order}: must hold each of 0 ... {n - 1} once')
    return tuple(int(i) for i in order)


def _scaled(chain, factor):
    return chain._replace(points=chain.points * factor,
                          link_lengths=tuple(factor * a for a in chain.link_lengths))


def _checked_set(points):
    """Give the points as an array, if they are distinct."""
    points = checked_points(points)
    apart = np.abs(points[:, np.newaxis] - points)
    largest = apart.max()
    apart[np.diag_indices(len(points))] = np.inf
    if apart.min() <= _RELATIVE_TOLERANCE * largest:
        i, k = sorted(int(place) for place in np.unravel_index(np.argmin(apart), apart.shape))
        raise ValueError(f'points[{i}] and points[{k}] coincide: the points must be distinct')
    return points


def _precedes(first, second):
    """Tell for each row of two arrays whether the first is lexicographically smaller."""
    differs = first != second
    place = np.argmax(differs, axis=1)
    rows = np.arange(len(first))
    return first[rows, place] < second[rows, place]
