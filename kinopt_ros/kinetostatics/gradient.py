"""
Gradients of the index z and of the margin by the joint angles.

Let u_i = x_i / s1 + i y_i / s2 be the polar factor of the centred vectors c_i = x_i + i y_i in
their principal axes, T = s1 + s2 and R = sum |r_i|^2. Then

    dz      = (T / R) sum <(T / R) r_i - u_i, dr_i>
    dmargin = (1 / R) sum <T i y_i / s2 + s2 u_i - 2 (s2 T / R) r_i, dr_i>

with <p, q> = Re(conj(p) q), and joint j turns r_i about P with all links from max(i, j) on.
"""

from itertools import accumulate
import math
from operator import mul
from typing import NamedTuple

import numpy as np

from kinopt_ros.kinetostatics.planar_arm import (
    checked_joint_angles,
    links_from_tip,
    norm_of_arrays,
    phase,
    unit_vector,
    unit_vectors,
)

# Singular, to the rounding of the joint angles, is a posture with s2 below this fraction of s1.
_SINGULAR = 1e-12


class IndexGradient(NamedTuple):
    """
    Gradients by theta_1 ... theta_n in 1/rad, whose first components are 0.

    Attributes
    ----------
    z : array, shape (n,) or (..., n)
        Of the index; a small step against it lowers z.
    margin : array, shape (n,) or (..., n)
        Of the margin to singularity.
    """

    z: np.ndarray
    margin: np.ndarray


def index_gradient(arm, joint_angles):
    """
    Gradients of z and of the margin at one posture or at an array of postures.

    Both are smooth except in two places. On the singular set z and the margin have a crease,
    with another gradient on every side: given are those of the side to which z falls most
    steeply, so that a step against the gradient of z is the steepest descent; of mirror images
    the side that bends the first joint that matters counterclockwise. Where s1 = s2, which
    includes isotropy, z is smooth, but the margin has a crease and the value given is one of
    its one-sided gradients, finite but otherwise arbitrary.

    Parameters
    ----------
    arm : PlanarArm
    joint_angles : array-like, shape (n,) or (..., n)
        Relative joint angles theta_1 ... theta_n in rad.

    Returns
    -------
    gradient : IndexGradient
        Arrays of the shape of the joint angles; always finite.

    Raises
    ------
    ValueError
        If the last axis does not hold n angles, or an angle is not finite.

    References
    ----------
    Chablat and Angeles, section "The Optimum Posture"; docs/mathematics.md, "Gradient".
    """
    angles = checked_joint_angles(joint_angles, arm.n_joints)
    if angles.ndim == 1:
        return IndexGradient(*map(np.array, _gradient_of_one(arm, angles.tolist())))
    postures = angles.reshape(-1, arm.n_joints)
    z, margin = np.empty(postures.shape), np.empty(postures.shape)
    block = _Block(arm, list(postures.T), unit_vectors, np.angle, norm_of_arrays)
    singular = block.s2 <= _SINGULAR * block.s1
    block.s2 = np.where(singular, 1.0, block.s2)
    for whole, parts in zip((z, margin), block.gradients()):
        for i, part in enumerate(parts):
            whole[:, i] = part
    for i in np.flatnonzero(singular):
        z[i], margin[i] = _gradient_of_one(arm, postures[i].tolist())
    return IndexGradient(z.reshape(angles.shape), margin.reshape(angles.shape))


def _gradient_of_one(arm, angles):
    block = _Block(arm, angles, unit_vector, phase, math.hypot)
    if block.s2 > _SINGULAR * block.s1:
        return block.gradients()
    return _at_crease(block)


class _Block:
    """The vectors r_i in the principal axes of the c_i, and what the gradients need of them."""

    def __init__(self, arm, joint_angles, unit_vector, phase, norm):
        links = links_from_tip(arm.unit_lengths, joint_angles, unit_vector)
        from_last_joint = list(accumulate(links[1:], initial=0.0))
        n = len(links)
        mean = sum(from_last_joint) / n
        centred = [vector - mean for vector in from_last_joint]
        to_axes = unit_vector(-0.5 * phase(sum([vector * vector for vector in centred])))
        centred = [vector * to_axes for vector in reversed(centred)]
        tip = (mean + links[0]) * to_axes
        self.links = [link * to_axes for link in reversed(links)]
        self.vectors = [vector + tip for vector in centred]
        self.x = [vector.real for vector in centred]
        self.y = [vector.imag for vector in centred]
        self.s1, self.s2 = norm(*self.x), norm(*self.y)
        self.r_squared = (self.s1 * self.s1 + self.s2 * self.s2
                          + n * (tip.real * tip.real + tip.imag * tip.imag))

    def gradients(self):
        """Gradients of z and of the margin at a regular posture, as lists."""
        return self.gradients_towards([y / self.s2 for y in self.y], self.s2)

    def gradients_towards(self, across, s2):
        """Gradients with y_i / s2 given, the side of a crease where s2 is 0."""
        total = self.s1 + s2
        ratio = total / self.r_squared
        share = s2 / self.r_squared
        margin_ratio = 2.0 * share * ratio
        by_z, by_margin = [], []
        for x, v, r in zip(self.x, across, self.vectors):
            polar = x / self.s1 + 1j * v
            by_z.append(ratio * (ratio * r - polar))
            by_margin.append(ratio * 1j * v + share * polar - margin_ratio * r)
        return self._by_joints(by_z), self._by_joints(by_margin)

    def _by_joints(self, by_vectors):
        """
        Derivatives by theta_j from the derivatives by the vectors r_i.

        Link k is part of r_1 ... r_k, and joint j turns the links from j on. As all of them
        together change nothing, that is less what the links before j contribute.
        """
        by_links = [(total.conjugate() * link).imag
                    for total, link in zip(accumulate(by_vectors), self.links)]
        return list(accumulate(by_links[:-1], initial=0.0))


def _at_crease(block):
    """
    Gradients at a singular posture, of the side to which z falls most steeply.

    There the joint centres are on a line. A change d of the angles moves them off it by W d,
    the part that no translation or rotation explains, which makes s2 = |W d| to first order and
    z change by g0 d - (s1 / R) |W d|. That is the least of the linear functions with gradients
    g0 - (s1 / R) W^T v, |v| = 1; the steepest of them, with v = W d / |W d|, is wanted.
    """
    n = len(block.x)
    along = np.array(block.x) / block.s1
    joints = np.arange(n)
    moved = np.array([vector.real for vector in block.vectors])[np.maximum.outer(joints, joints)]
    moved -= moved.mean(axis=0)
    moved -= np.outer(along, along @ moved)
    flat, _ = block.gradients_towards([0.0] * n, 0.0)
    sides, stretches, axes = np.linalg.svd(moved * (block.s1 / block.r_squared))
    weights = _steepest(stretches.tolist(), (axes @ flat).tolist())
    across = sides @ weights
    steepest = flat - axes.T @ (stretches * weights)
    significant = np.abs(steepest) > 1e-9 * np.abs(steepest).max()
    mirrored = np.linalg.norm(flat + axes.T @ (stretches * weights))
    if (mirrored > (1.0 - 1e-9) * np.linalg.norm(steepest)
            and steepest[np.argmax(significant)] > 0.0):
        across = -across
    return block.gradients_towards(across.tolist(), 0.0)


def _steepest(stretches, flat):
    """
    Give the unit vector v that maximises sum (flat_k - stretches_k v_k)^2.

    With q_k = stretches_k flat_k it is v_k = -q_k / (mu - stretches_k^2), where mu, not below
    the largest stretches_k^2, makes |v| = 1; stretches come in descending order.
    """
    top = stretches[0] * stretches[0]
    products = list(map(mul, stretches, flat))
    gaps = [top - stretch * stretch for stretch in stretches]
    scale = math.hypot(*products)
    low, high = 0.0, scale
    if scale > 1e-14 * top:
        # 100 halvings, unless the floats between are used up before.
        for _ in range(100):
            middle = 0.5 * (low + high)
            if middle in (low, high):
                break
            if math.hypot(*[q / (gap + middle) for q, gap in zip(products, gaps)]) > 1.0:
                low = middle
            else:
                high = middle
        vector = [-q / (gap + high) for q, gap in zip(products, gaps)]
    else:
        vector = [0.0] * len(stretches)
    # Without a share of its own the stiffest direction takes what is missing to length 1.
    rest = 1.0 - sum(v * v for v in vector[1:])
    vector[0] = math.copysign(math.sqrt(max(rest, 0.0)), vector[0])
    return np.array(vector)
