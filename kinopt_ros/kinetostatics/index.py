"""
The kinetostatic index z, the conditioning length l_P and the margin to singularity.

All three come from two singular values. Let c_i = r_i - mean(r) be the vectors from the joint
centres to the operation point, centred, and s1 >= s2 the singular values of the 2 x n block
that they form. Over every isotropic set that could serve as the model (not one held fixed),

    z      = 1 - (s1 + s2)^2 / (2 R),        R = sum |r_i|^2 = n d_rms^2
    l_P    = R / (sqrt(n) (s1 + s2))
    margin = s2 / (sqrt(n) l_P) = s2 (s1 + s2) / R
"""

import cmath
import math
from typing import NamedTuple

import numpy as np

from kinopt_ros.kinetostatics.planar_arm import (
    checked_joint_angles,
    links_from_tip,
    unit_vector,
    unit_vectors,
)

# Postures per block of a batch: the working arrays of a block stay within a core's cache.
_BLOCK = 8192


class KinetostaticIndex(NamedTuple):
    """
    What a posture scores; floats for one posture, arrays for many.

    Attributes
    ----------
    z : float or array
        Half the squared distance of the normalised Jacobian to the closest isotropic matrix,
        dimensionless: 0 at isotropy, at least 1/2 at every singular posture, below 1.
    conditioning_length : float or array
        Conditioning length l_P in m, the length that brings the normalised Jacobian closest.
    margin : float or array
        Distance of the normalised Jacobian to the nearest singular one with the same first
        row, in the paper's norm: 1 only at isotropy, 0 exactly at singularities, never above
        1 - z.
    """

    z: float
    conditioning_length: float
    margin: float


class _Operations(NamedTuple):
    unit_vector: callable
    polar: callable
    sqrt: callable


def kinetostatic_index(arm, joint_angles):
    """
    Index z, conditioning length and margin of one posture or of an array of postures.

    None of them depends on theta_1; z and margin do not depend on the size of the arm.

    Parameters
    ----------
    arm : PlanarArm
    joint_angles : sequence of float, shape (n,), or array, shape (..., n)
        Relative joint angles theta_1 ... theta_n in rad.

    Returns
    -------
    index : KinetostaticIndex
        Of floats for shape (n,), of arrays of shape (...) otherwise.

    Raises
    ------
    ValueError
        If the last axis does not hold n angles, or an angle is not finite.

    References
    ----------
    Chablat and Angeles, section "The Posture-Dependent Conditioning Length of Planar
    n-Revolute Manipulators", eqs. "least-squares", "l_P", "z-l_P"; docs/mathematics.md.
    """
    if _is_plain_posture(joint_angles, arm.link_lengths):
        return _index(arm, joint_angles, _SCALAR)
    angles = checked_joint_angles(joint_angles, arm.n_joints)
    if angles.ndim == 1:
        return _index(arm, angles.tolist(), _SCALAR)
    return _index_of_many(arm, angles)


def _is_plain_posture(joint_angles, link_lengths):
    """
    Tell whether this is the cheap, common case: a list or tuple of n finite floats.

    A sum is finite only if all its terms are; whatever fails here is examined at leisure.
    """
    if not isinstance(joint_angles, (list, tuple)) or len(joint_angles) != len(link_lengths):
        return False
    try:
        return math.isfinite(sum(joint_angles))
    except (TypeError, OverflowError):
        return False


def _index_of_many(arm, angles):
    postures = angles.reshape(-1, arm.n_joints)
    result = KinetostaticIndex(*np.empty((3, len(postures))))
    for start in range(0, len(postures), _BLOCK):
        block = slice(start, start + _BLOCK)
        for whole, part in zip(result, _index(arm, postures[block].T, _ARRAY)):
            whole[block] = part
    return KinetostaticIndex(*(values.reshape(angles.shape[:-1]) for values in result))


def _index(arm, joint_angles, operations):
    """
    Evaluate the formulas of the module's head; joint angles along the first axis.

    Plain loops: between two messages an interpreter leaves the caches of its core, and then
    every further function that a posture goes through costs more than the arithmetic.
    """
    unit_vector, polar, sqrt = operations
    last_link, *links = links_from_tip(arm.unit_lengths, joint_angles, unit_vector)
    # The centred vectors do not depend on the last link. Measured from the last joint, the
    # zero that is left out here, they keep their digits where that link is long.
    joints = []
    joint = joint_sum = square_sum = 0.0
    for link in links:
        joint = joint + link
        joints.append(joint)
        joint_sum = joint_sum + joint
        square_sum = square_sum + joint * joint
    n = len(joints) + 1
    mean = joint_sum / n
    # Turned into its principal axes the block has the singular values as the norms of its
    # rows. The smaller is taken from its row: sqrt((P - |Q|) / 2) would lose its digits. The
    # larger then follows from s1^2 - s2^2 = |Q|, where nothing cancels.
    difference, phase = polar(square_sum - joint_sum * mean)
    to_axes = unit_vector(-0.5 * phase)
    middle = (mean * to_axes).imag
    s2_squared = middle * middle
    for joint in joints:
        across = (joint * to_axes).imag - middle
        s2_squared = s2_squared + across * across
    s1_squared = s2_squared + difference
    s2 = sqrt(s2_squared)
    total = sqrt(s1_squared) + s2
    centroid = mean + last_link
    r_squared = s1_squared + s2_squared + n * (centroid * centroid.conjugate()).real
    closeness = total * total / (2.0 * r_squared)
    return KinetostaticIndex(
        # At isotropy rounding can leave closeness just above 1, and z must not be negative.
        abs(1.0 - closeness),
        arm.longest_link * r_squared / (sqrt(n) * total),
        s2 * total / r_squared)


def _polar_of_arrays(values):
    return np.abs(values), np.angle(values)


# Not cmath.phase: it raises where a phase underflows, at an angle of 5e-324 for instance.
_SCALAR = _Operations(unit_vector, cmath.polar, math.sqrt)
_ARRAY = _Operations(unit_vectors, _polar_of_arrays, np.sqrt)
