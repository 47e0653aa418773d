"""
A proven lower bound on the index z, by subdivision of the joint space.

Let x be theta_2 ... theta_n, within joint limits. With P = sum |c_i|^2, R = sum |r_i|^2 and V
the 2 x 2 minors of the block of the c_i in a basis of the centred vectors, so that |V| = s1 s2,
it is z >= zeta in a box of the joint space if and only if there

    g(x) = 2 (1 - zeta) R - P - 2 |V| >= 0.

R, P and V are sums of cosines and sines of partial sums of x. Each is its tangent at the centre
of the box plus a remainder of at most half the sum of the amplitudes times the squares of the
changes of their angles. The norm of the tangent of V is convex; with the tangents in place of
the functions g is concave, so that its least value over the box is at a corner. That value less
the remainders bounds g from below, with an error that shrinks as the square of the box.

Without limits on joint n its best angle is put in, and x is theta_2 ... theta_(n-1) only. Then

    R = M + n a_n^2 - 2 n a_n |b|,    M = sum |r_i - r_n|^2,    b = sum_j j l_j / n,

b from the centroid of the joint centres to joint n: one more norm to treat as that of V.
"""

from itertools import combinations, product
import math
from typing import NamedTuple

import numpy as np

# The bound aimed at is this far below the z given, which is beyond what matters to anybody.
_GAP = 1e-9
# Allowance for rounding in g, whose terms are below 1000 for the arms meant.
_ROUNDING = 1e-12
# Beyond this the corners of a box alone would be too many.
_MOST_JOINTS = 6
_FIRST_BOXES = 4096
_MOST_BOXES = 400_000
# Smaller boxes are undecided only where z is below the bound aimed at.
_SMALLEST_HALF = 1e-8
# Boxes at a time: the working arrays of a block stay within a core's cache.
_BLOCK = 4096


class _Trigonometry(NamedTuple):
    """
    The function g(x) = constant + sum w cos(S x) - 2 |V| - |b'| of the module's head.

    Attributes
    ----------
    sums : array, shape (p, d)
        S, ones where a variable is part of the angle between the links of a pair.
    constant : float
    cosines : array, shape (p,)
        w.
    minors : array, shape (q, p)
        V = minors @ sin(S x).
    centroid_sums : array, shape (n - 1, d)
        Angles of the links in the frame of link 2.
    centroid : array, shape (n - 1,)
        b' = sum centroid exp(i centroid_sums x), b with its factor; zeros where there is none.
    """

    sums: np.ndarray
    constant: float
    cosines: np.ndarray
    minors: np.ndarray
    centroid_sums: np.ndarray
    centroid: np.ndarray


def certified_lower_bound(arm, lower, upper, z):
    """
    Prove a lower bound on the index over all postures within joint limits.

    Meant for n = 3 and 4, where it takes a millisecond or two, and 5, where it takes a hundred;
    for n = 6 it is seldom sharp within its budget, and beyond that it is not attempted.

    Parameters
    ----------
    arm : PlanarArm
    lower, upper : array, shape (n - 1,)
        Limits of theta_2 ... theta_n in rad; infinite in pairs, where there are none.
    z : float
        The least index known, which the bound shall come close to.

    Returns
    -------
    bound : float
        Within 1e-9 of z if no posture is better and the subdivision did not exceed its
        budget, lower otherwise. At least 0, which is a bound for any arm.

    References
    ----------
    docs/solver.md, "The certificate".
    """
    target = z - _GAP
    if target <= 0.0 or arm.n_joints > _MOST_JOINTS:
        return 0.0
    last_joint_free = not math.isfinite(lower[-1])
    function = _box_function(arm, target, last_joint_free)
    if last_joint_free:
        lower, upper = lower[:-1], upper[:-1]
    low = np.where(np.isfinite(lower), lower, -math.pi)
    high = np.where(np.isfinite(upper), upper, math.pi)
    if not np.isfinite(lower).any():
        # Mirror images score the same.
        low[0] = 0.0
    # No more than 16 along an axis, and with many axes fewer.
    along_axis = min(16, round(_FIRST_BOXES ** (1.0 / len(low))))
    half = (high - low) / (2 * along_axis)
    centres = low + half * (1.0 + 2.0 * _lattice(along_axis, len(low)))
    children = 2.0 * _lattice(2, len(low)) - 1.0
    while True:
        least = np.concatenate([
            _least_values(function, centres[start:start + _BLOCK], half)
            for start in range(0, len(centres), _BLOCK)])
        undecided = least < 0.0
        if not undecided.any():
            return target
        if undecided.sum() * len(children) > _MOST_BOXES or half.max() < _SMALLEST_HALF:
            # (s1 + s2)^2 <= 2 (1 - target) R - least, and R >= 1/2 in the unit of lengths: the
            # longest link ends at two of the r_i, or at the last one and the operation point.
            return max(0.0, target + float(least.min()))
        half = 0.5 * half
        centres = (centres[undecided][:, None] + half * children).reshape(-1, len(low))


def _lattice(count, dimensions):
    return np.array(list(product(range(count), repeat=dimensions)), dtype=float)


def _least_values(function, centres, half):
    """Lower bound on g over each box."""
    angles = centres @ function.sums.T
    cosines, sines = np.cos(angles), np.sin(angles)
    corners = (_lattice(2, len(half)) * 2.0 - 1.0) * half
    at_corners = function.sums @ corners.T
    reach = function.sums @ half
    squares = 0.5 * reach * reach
    g = (function.constant + cosines @ function.cosines)[:, None] - (
        sines * function.cosines) @ at_corners
    minors = (sines[:, None, :] + cosines[:, None, :] * at_corners.T) @ function.minors.T
    g -= 2.0 * np.sqrt(np.einsum('ijk,ijk->ij', minors, minors))
    remainder = np.abs(function.cosines) @ squares + 2.0 * (
        np.linalg.norm(function.minors, axis=0) @ squares)
    if function.centroid.any():
        links = function.centroid * np.exp(1j * (centres @ function.centroid_sums.T))
        turns = function.centroid_sums @ corners.T
        g -= np.abs(links.sum(axis=1)[:, None] + 1j * (links @ turns))
        reach = np.abs(function.centroid_sums) @ half
        remainder += function.centroid @ (0.5 * reach * reach)
    return g.min(axis=1) - remainder - _ROUNDING


def _box_function(arm, target, last_joint_free):
    """Put g together from the Gram matrices of R or M, and of P, in the link vectors."""
    n = arm.n_joints
    lengths = np.array(arm.unit_lengths)
    counts = np.arange(1.0, n + 1.0)
    about_tip = np.minimum.outer(counts, counts)
    about_centroid = about_tip - np.outer(counts, counts) / n
    factor = 2.0 * (1.0 - target)
    moving = n - 1 if last_joint_free else n
    forms = (factor * about_tip - about_centroid) * np.outer(lengths, lengths)
    first, second = np.array(list(combinations(range(moving), 2))).T
    joints = np.arange(1, moving)
    sums = ((joints > first[:, None]) & (joints <= second[:, None])).astype(float)
    # The compound matrix of a square root of G turns the cross products of the links into V.
    root = np.zeros((moving, n - 1))
    root[:n - 1] = np.linalg.cholesky(about_centroid[:n - 1, :n - 1])
    p, q = np.array(list(combinations(range(n - 1), 2))).T
    compound = root[first][:, p] * root[second][:, q] - root[first][:, q] * root[second][:, p]
    minors = compound.T * (lengths[first] * lengths[second])
    constant = np.trace(forms[:moving, :moving])
    centroid = np.zeros(moving)
    if last_joint_free:
        constant += factor * n * lengths[-1] ** 2
        centroid = 2.0 * factor * lengths[-1] * counts[:-1] * lengths[:-1]
    links = np.arange(moving)[:, None]
    centroid_sums = np.where(links == 0, -1.0 * (joints == 1), (joints > 1) & (joints <= links))
    return _Trigonometry(sums, constant, 2.0 * forms[first, second], minors, centroid_sums,
                         centroid)
