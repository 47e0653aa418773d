"""Gradients of the index z and of the margin against a given model set."""

import math

import numpy as np

from kinopt_ros.kinetostatics.gradient import index_gradient, IndexGradient
from kinopt_ros.kinetostatics.index import kinetostatic_index
from kinopt_ros.kinetostatics.model_set import index_against


def gradient_against(arm, joint_angles, model_set, mirror=False):
    """
    Gradients by the joint angles of the z and of the margin that `index_against` gives.

    z is smooth everywhere, singular postures included, except with `mirror` where both images
    are equally close. The margin has the creases of the margin against the closest set, with
    the same choice among one-sided gradients, and one more where z = 1: there it is given as 0.

    Parameters
    ----------
    arm : PlanarArm
    joint_angles : array-like, shape (n,) or (..., n)
        Relative joint angles in rad.
    model_set : array-like, complex, shape (n,)
        Points k_1 ... k_n.
    mirror : bool
        Whether the mirror image of the set may be used where it is closer.

    Returns
    -------
    gradient : IndexGradient
        Arrays of the shape of the joint angles, in 1/rad; always finite.

    Raises
    ------
    ValueError
        As for `index_against`.

    References
    ----------
    Chablat and Angeles, section "The Optimum Posture"; docs/mathematics.md, "Gradient".
    """
    index = index_against(arm, joint_angles, model_set, mirror)
    closest = kinetostatic_index(arm, joint_angles)
    n = arm.n_joints
    r = arm.operation_point_vectors(joint_angles) / arm.longest_link
    k = np.where(np.asarray(index.mirrored)[..., np.newaxis], np.conj(model_set), model_set)
    r_squared, by_r_squared = _sum_and_derivatives(r, np.conj(r))
    projection, by_projection = _sum_and_derivatives(r, np.conj(k))
    # The first sum runs over conj(r_i) r_i, of which both factors turn.
    r_squared, by_r_squared = r_squared.real, 2.0 * by_r_squared.real
    size = np.abs(projection)
    direction = np.where(size > 0.0, projection, 0.0) / np.where(size > 0.0, size, 1.0)
    by_size = (np.conj(direction) * by_projection).real
    closeness = size / (n * r_squared)
    z = closeness * (0.5 * size / r_squared * by_r_squared - by_size)

    # margin = q times the margin against the closest set, q = |w| / (sqrt(n) (s1 + s2)).
    of_closest = index_gradient(arm, joint_angles)
    # From l_P and not from 1 - z, which has no digits left where the last link is very long.
    length = np.expand_dims(closest.conditioning_length, -1) / arm.longest_link
    total = r_squared / (math.sqrt(n) * length)
    by_total = (by_r_squared * total / (2.0 * r_squared) - r_squared / total * of_closest.z)
    q = size / (math.sqrt(n) * total)
    by_q = by_size / (math.sqrt(n) * total) - q / total * by_total
    margin = q * of_closest.margin + np.expand_dims(closest.margin, -1) * by_q
    return IndexGradient(_without_first(z), _without_first(margin))


def _sum_and_derivatives(r, factors):
    """
    Sum of factors times r_i, and its derivatives by theta_j with the factors held.

    The sum keeps an axis of length 1. Joint j turns r_i like r_max(i, j).
    """
    products = factors * r
    after = np.flip(np.cumsum(np.flip(products, -1), axis=-1), -1) - products
    return (products.sum(axis=-1, keepdims=True),
            1j * (np.cumsum(factors, axis=-1) * r + after))


def _without_first(gradient):
    """Neither z nor the margin depends on theta_1: what rounding left there is dropped."""
    gradient[..., 0] = 0.0
    return gradient
