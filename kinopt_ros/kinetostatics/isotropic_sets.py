"""Isotropic sets of points in the plane: their moments, and what keeps them isotropic."""

import cmath
import math
from operator import index

import numpy as np

# Circumradius at which any regular polygon has the second moment n 1 of a model set.
MODEL_RADIUS = math.sqrt(2.0)


def centroid(points):
    """
    Centroid C of a set of points.

    Parameters
    ----------
    points : array-like, complex, shape (n,)
        Points of the plane as x + i y, in any unit of length.

    Returns
    -------
    centroid : complex
        In the unit of the points.

    Raises
    ------
    ValueError
        If the points are not a non-empty sequence of finite complex numbers.

    References
    ----------
    Chablat and Angeles, section "Isotropic Sets of Points", eq. "centroid".
    """
    return complex(checked_points(points).mean())


def second_moment(points):
    """
    Second moment M of a set of points about its centroid.

    Parameters
    ----------
    points : array-like, complex, shape (n,)

    Returns
    -------
    moment : array, shape (2, 2)
        Sum of (p_k - c) (p_k - c)^T, in the unit of the points squared.

    Raises
    ------
    ValueError
        As for `centroid`.

    References
    ----------
    Chablat and Angeles, eq. "second".
    """
    rows = _centred_rows(points)
    return rows @ rows.T


def rms_distance_to_centroid(points):
    """
    Root-mean-square distance d_rms of the points from their centroid, in their unit.

    Raises
    ------
    ValueError
        As for `centroid`.

    References
    ----------
    Chablat and Angeles, eq. "d_rms".
    """
    return float(np.sqrt(np.mean(np.sum(_centred_rows(points) ** 2, axis=0))))


def geometric_moment_of_inertia(points):
    """
    Moment of inertia of unit masses at the points, about their centroid.

    Parameters
    ----------
    points : array-like, complex, shape (n,)

    Returns
    -------
    inertia : array, shape (2, 2)
        tr(M) 1 - M with the second moment M, in the unit of the points squared.

    Raises
    ------
    ValueError
        As for `centroid`.

    References
    ----------
    Chablat and Angeles, eqs. "inertia" and "inertia-alt".
    """
    moment = second_moment(points)
    return np.trace(moment) * np.eye(2) - moment


def is_isotropic(points, tolerance=1e-9):
    """
    Tell whether the second moment of a set of points is a positive multiple of the identity.

    Parameters
    ----------
    points : array-like, complex, shape (n,)
    tolerance : float
        Largest relative difference of the two principal moments, dimensionless.

    Returns
    -------
    isotropic : bool
        False for points that all coincide: their second moment is zero.

    Raises
    ------
    ValueError
        As for `centroid`.

    References
    ----------
    Chablat and Angeles, Definition "Isotropic Set".
    """
    centred = checked_points(points) - centroid(points)
    largest = np.abs(centred).max()
    if largest == 0.0:
        return False
    centred = centred / largest
    # The sum of the complex squares is M_xx - M_yy + 2 i M_xy.
    return bool(abs(np.sum(centred ** 2)) <= tolerance * np.sum(np.abs(centred) ** 2))


def union(first, second, tolerance=1e-9):
    """
    Union of two sets of points that share their centroid: isotropic if both are.

    Parameters
    ----------
    first, second : array-like, complex, shapes (n,) and (m,)
    tolerance : float
        Largest distance between the centroids, relative to the d_rms of the larger set.

    Returns
    -------
    points : array, complex, shape (n + m,)
        A point that both sets hold is there twice, as in the paper's example.

    Raises
    ------
    ValueError
        If the centroids differ, or the points are not finite complex numbers.

    References
    ----------
    Chablat and Angeles, section "Union of Two Isotropic Sets of Points".
    """
    apart = abs(centroid(first) - centroid(second))
    size = max(rms_distance_to_centroid(first), rms_distance_to_centroid(second))
    if apart > tolerance * size:
        raise ValueError(f'the centroids of first and second are {apart:.6g} apart: the sets '
                         'must share their centroid')
    return np.concatenate([checked_points(first), checked_points(second)])


def rotated(points, angle):
    """
    Set of points turned about its centroid as a rigid body.

    Parameters
    ----------
    points : array-like, complex, shape (n,)
    angle : float
        Counterclockwise, in rad.

    Returns
    -------
    points : array, complex, shape (n,)

    Raises
    ------
    ValueError
        As for `centroid`.

    References
    ----------
    Chablat and Angeles, section "Rotation of an Isotropic Set of Points".
    """
    centre = centroid(points)
    return centre + cmath.rect(1.0, angle) * (checked_points(points) - centre)


def reflected(points, axis_angle=0.0):
    """
    Mirror image of a set of points in an axis through its centroid.

    Parameters
    ----------
    points : array-like, complex, shape (n,)
    axis_angle : float
        Angle in rad from the x axis to the axis of reflection.

    Returns
    -------
    points : array, complex, shape (n,)

    Raises
    ------
    ValueError
        As for `centroid`.

    References
    ----------
    Chablat and Angeles, section "Trivial Isotropic Set of Points".
    """
    centre = centroid(points)
    return centre + cmath.rect(1.0, 2.0 * axis_angle) * np.conj(checked_points(points) - centre)


def regular_polygon(n, first_angle=math.pi / 2, radius=MODEL_RADIUS):
    """
    Vertices of a regular polygon around the origin, the paper's trivial isotropic set.

    Parameters
    ----------
    n : int
        Number of vertices, at least 3.
    first_angle : float
        Direction of the first vertex from the centroid in rad; the others follow
        counterclockwise.
    radius : float
        Circumradius; with the default, sqrt(2), the polygon is a model set.

    Returns
    -------
    points : array, complex, shape (n,)

    Raises
    ------
    ValueError
        If n is below 3 or the radius is not finite and positive.

    References
    ----------
    Chablat and Angeles, Definition "Trivial isotropic set", eq. "k^2".
    """
    n = index(n)
    if n < 3:
        raise ValueError(f'n = {n}: a polygon must have at least 3 vertices')
    if not (math.isfinite(radius) and radius > 0.0):
        raise ValueError(f'radius = {radius}: must be finite and positive')
    return radius * np.exp(1j * (first_angle + 2.0 * np.pi * np.arange(n) / n))


def checked_points(points):
    """
    Points of the plane as a complex array of shape (n,).

    Raises
    ------
    ValueError
        If the points are not a non-empty sequence of finite complex numbers.
    """
    try:
        array = np.asarray(points, dtype=complex)
    except (TypeError, ValueError) as error:
        raise ValueError(f'points = {points!r}: must be complex numbers x + i y') from error
    if array.ndim != 1 or array.size == 0:
        raise ValueError(f'points has shape {array.shape}: must be one row of complex numbers '
                         'x + i y, shape (n,)')
    if not np.isfinite(array).all():
        where = int(np.argmin(np.isfinite(array)))
        raise ValueError(f'points[{where}] = {array[where]}: must be finite')
    return array


def _centred_rows(points):
    """Give the 2 x n block of the vectors from the centroid."""
    centred = checked_points(points) - centroid(points)
    return np.array([centred.real, centred.imag])
