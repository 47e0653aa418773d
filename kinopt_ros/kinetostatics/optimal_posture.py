"""
The optimal posture of an arm: the one with the least index z, and the characteristic length.

Newton's method from many starts at once, a fixed low-discrepancy set, finds the optima; for
short arms a subdivision of the joint space certifies that there is none better. Everything is
deterministic, and nothing is kept but the latest searches; being NumPy, it holds the interpreter's
lock for most of the time, so that a program with a deadline should call it in another process.
docs/solver.md has the measurements.
"""

from dataclasses import dataclass
from functools import lru_cache
import math
from typing import NamedTuple

import numpy as np

from kinopt_ros.kinetostatics.certificate import certified_lower_bound
from kinopt_ros.kinetostatics.descent import descend
from kinopt_ros.kinetostatics.hessian import index_expansion
from kinopt_ros.kinetostatics.index import kinetostatic_index
from kinopt_ros.kinetostatics.joint_limits import JointLimits, wrapped
from kinopt_ros.kinetostatics.low_discrepancy import kronecker_sequence
from kinopt_ros.kinetostatics.model_set import closest_model_set
from kinopt_ros.kinetostatics.planar_arm import PlanarArm

ISOTROPIC_Z = 1e-9
# Joints up to which the optimum is certified unless the caller says otherwise.
_CERTIFIED_JOINTS = 4

_SAMPLES = 512
_STARTS = 48
# Postures of z this close are equally good; postures this close in every angle are the same.
_SAME_Z = 1e-9
_SAME_ANGLE = 1e-5
# Relative curvature of z under which an optimum belongs to a continuous family.
_FLAT = 1e-7
# Half width in rad of the region about the reference from where else members are drawn.
_AROUND = 1.5
# Weights in 1/rad^2 that draw a family's member towards the reference, in order.
_ATTRACTIONS = (3e-3, 1e-4, 3e-6)


class PostureAlternative(NamedTuple):
    """
    One more optimum of the same arm.

    Attributes
    ----------
    joint_angles : tuple of float, shape (n,)
        In rad.
    z, margin : float
    """

    joint_angles: tuple
    z: float
    margin: float


@dataclass(frozen=True)
class OptimalPosture:
    """
    The posture of least z of an arm.

    Attributes
    ----------
    link_lengths : tuple of float, shape (n,)
        The arm's, in m.
    joint_angles : tuple of float, shape (n,)
        theta_1 ... theta_n in rad: within the limits where there are some, in (-pi, pi]
        otherwise, except that theta_1 is the reference's.
    z : float
        Index at the optimum.
    characteristic_length : float
        Conditioning length in m at the optimum.
    margin : float
        Margin to singularity at the optimum.
    model_set : tuple of complex, shape (n,)
        Closest isotropic set of the optimum, dimensionless.
    circle_radius : float
        Radius |r_1| in m of the conditioning circle, the locus of the operation point while
        only joint 1 turns.
    isotropic : bool
        Whether z is 0 to rounding, below 1e-9.
    alternatives : tuple of PostureAlternative
        The other distinct optima found, ordered by z: first those as good as the optimum
        (mirror images, members of a continuous family), nearest to the reference first, then
        merely local ones. All have the same theta_1.
    lower_bound : float or None
        Proven lower bound on z over all postures within the limits; None where not computed.
    converged : bool
        Whether the descent that ended here converged to rounding.
    starts : int
        Descents made.
    iterations : int
        Newton iterations of the longest of them.

    References
    ----------
    Chablat and Angeles, sections "The Optimum Posture" and "The Characteristic Length".
    """

    link_lengths: tuple
    joint_angles: tuple
    z: float
    characteristic_length: float
    margin: float
    model_set: tuple
    circle_radius: float
    isotropic: bool
    alternatives: tuple
    lower_bound: float
    converged: bool
    starts: int
    iterations: int


def optimal_posture(arm, lower=None, upper=None, reference=None, certify=None):
    """
    Find the posture of least z, globally, and all other optima met on the way.

    Parameters
    ----------
    arm : PlanarArm or sequence of float, shape (n,)
        The arm or its link lengths in m.
    lower, upper : sequence of float, shape (n,), optional
        Joint limits in rad; may be infinite or more than a turn apart. None: no limits.
    reference : sequence of float, shape (n,), optional
        Posture in rad. Among equally good optima the nearest to it is returned, with its
        theta_1, moved into the limits. None: of those found the nearest to the stretched arm,
        bent counterclockwise first, with theta_1 = 0 or the limit next to it.
    certify : bool, optional
        Whether to compute `lower_bound`. None: for n = 3 and 4, and where z is 0 anyway. For
        n = 5 it takes some 0.1 s, for n = 6 it is seldom sharp, beyond that it is just 0.

    Returns
    -------
    posture : OptimalPosture

    Raises
    ------
    ValueError
        If the link lengths, limits or reference are not n proper numbers, or no angle of a
        joint is within its limits.

    References
    ----------
    Chablat and Angeles, section "The Optimum Posture", eq. "optimize-P"; docs/solver.md.
    """
    if not isinstance(arm, PlanarArm):
        arm = PlanarArm(arm)
    limits = JointLimits.checked(arm.n_joints, lower, upper, reference)
    found = _found(arm, *map(tuple, limits.search_box))
    optima = _distinct_optima(arm, limits, found.optima.angles, found.optima.converged)
    if reference is not None and _in_a_family(arm, limits, optima):
        nearer = _drawn_to_reference(arm, limits, optima)
        optima = _distinct_optima(
            arm, limits, np.concatenate([optima.angles, nearer.angles]),
            np.concatenate([optima.converged, nearer.converged]))
    z = float(optima.index.z[0])
    if certify is None:
        certify = arm.n_joints <= _CERTIFIED_JOINTS or z < ISOTROPIC_Z
    bound = _bound(arm, *map(tuple, limits.search_box), z) if certify else None
    return _result(arm, limits, optima, bound, found)


class _Found(NamedTuple):
    """What a search has found, whatever the reference."""

    optima: tuple
    starts: int
    iterations: int


# Who asks for an arm mostly asks again, with another reference: that needs no other search.
@lru_cache(maxsize=16)
def _found(arm, lower, upper):
    box = JointLimits.checked(arm.n_joints, (-math.inf, *lower), (math.inf, *upper), None)
    descent = descend(arm, _starts(arm, box), *box.search_box)
    optima = _distinct_optima(arm, box, descent.angles, descent.converged)
    return _Found(optima, len(descent.angles), descent.iterations)


@lru_cache(maxsize=16)
def _bound(arm, lower, upper, z):
    return certified_lower_bound(arm, np.array(lower), np.array(upper), z)


def _starts(arm, limits):
    """
    Give the best of a fixed sample of postures, with the last joint's best angle.

    Between limits the sample is drawn from twice the range and brought back: narrow limits put
    most local optima on the faces and corners of the box, where half of the sample then is.
    """
    lower, upper = limits.search_box
    limited = np.isfinite(lower)
    low, high = np.where(limited, lower, -math.pi), np.where(limited, upper, math.pi)
    spread = (high - low) * np.where(limited, 2.0, 1.0)
    unit = kronecker_sequence(_SAMPLES, arm.n_joints - 2) - 0.5
    others = np.clip((0.5 * (low + high))[:-1] + spread[:-1] * unit, lower[:-1], upper[:-1])
    last = _best_last_angle(arm, others, lower[-1], upper[-1])
    samples = np.column_stack([others, last])
    z = kinetostatic_index(arm, _with_first(0.0, samples)).z
    return samples[np.argsort(z, kind='stable')[:_STARTS]]


def _best_last_angle(arm, others, lower, upper):
    """
    Give the theta_n of least z for given theta_2 ... theta_(n-1).

    It points from joint n to the centroid of the joint centres; z rises with the angle away
    from there, so that beyond a limit the nearer end is best.
    """
    absolute = np.cumsum(others, axis=1)
    weights = np.arange(1.0, arm.n_joints) * np.asarray(arm.unit_lengths[:-1])
    from_centroid = weights[0] + np.exp(1j * absolute) @ weights[1:]
    best = np.angle(-from_centroid) - absolute[:, -1]
    if not np.isfinite(lower):
        return best
    middle = 0.5 * (lower + upper)
    return np.clip(middle + wrapped(best - middle), lower, upper)


def _with_first(first, angles):
    return np.insert(angles, 0, first, axis=1)


class _Optima(NamedTuple):
    """Optima, the best first: theta_2 ... theta_n, their scores and what is known of them."""

    angles: np.ndarray
    index: tuple
    converged: np.ndarray


def _distinct_optima(arm, limits, angles, converged):
    """Give the different ones among optima and their mirror images, in their order."""
    angles, inside = limits.nearest_turns(np.concatenate([angles, -angles]))
    angles, converged = angles[inside], np.tile(converged, 2)[inside]
    optima = _Optima(angles, kinetostatic_index(arm, _with_first(0.0, angles)), converged)
    optima = _selected(optima, _order(limits, optima))
    # A descent that stopped halfway is no optimum, unless there is nothing better.
    useful = optima.converged | (np.arange(len(converged)) == 0)
    optima = _selected(optima, np.flatnonzero(useful))
    apart = np.abs(wrapped(optima.angles[:, None] - optima.angles[None])).max(axis=2)
    same = apart < _SAME_ANGLE
    kept = np.ones(len(same), dtype=bool)
    for i in range(1, len(same)):
        kept[i] = not (same[i, :i] & kept[:i]).any()
    return _selected(optima, np.flatnonzero(kept))


def _selected(optima, rows):
    return _Optima(optima.angles[rows], type(optima.index)(*(v[rows] for v in optima.index)),
                   optima.converged[rows])


def _order(limits, optima):
    """
    Order by z, then distance from the reference, then the more counterclockwise first bend.

    Values that differ by rounding only count as equal, or the order would depend on it.
    """
    distances = np.linalg.norm(optima.angles - limits.reference[1:], axis=1)
    bends = [_levels(-column, _SAME_ANGLE) for column in optima.angles.T]
    return np.lexsort([*reversed(bends), _levels(distances, _SAME_ANGLE),
                       _levels(optima.index.z, _SAME_Z)])


def _levels(values, tolerance):
    """Ranks of values, those without a gap between them sharing one."""
    order = np.argsort(values, kind='stable')
    ranks = np.empty(len(values), dtype=int)
    ranks[order] = np.concatenate([[0], np.cumsum(np.diff(values[order]) > tolerance)])
    return ranks


def _in_a_family(arm, limits, optima):
    """Tell whether the best optimum is one of a continuous family of equally good postures."""
    best = optima.angles[:1]
    lower, upper = limits.search_box
    free = ((best > lower) & (best < upper))[0]
    if not free.any():
        return False
    curvatures = np.linalg.eigvalsh(index_expansion(arm, best).hessian[0][np.ix_(free, free)])
    return curvatures[0] < _FLAT * curvatures[-1]


def _drawn_to_reference(arm, limits, optima):
    """
    Descend along the family of the best optimum towards the reference.

    The minimum of z + w |theta - reference|^2 tends to the point of the family nearest to the
    reference, at least locally, as w goes to 0.
    """
    box = limits.search_box
    reference = limits.reference[1:]
    good = optima.angles[_levels(optima.index.z, _SAME_Z) == 0]
    around = reference + _AROUND * (
        2.0 * kronecker_sequence(_STARTS, len(reference)) - 1.0)
    # At the weight they start with, members far from the reference all come to its vicinity.
    angles = np.concatenate([good[:_STARTS // 2], np.clip(around, *box),
                             np.clip(reference, *box)[None]])
    for weight in _ATTRACTIONS:
        angles = descend(arm, angles, *box, weight, reference).angles
    return descend(arm, angles, *box)


def _result(arm, limits, optima, bound, found):
    first = limits.first_angle
    angles = wrapped(optima.angles) if limits.wrapped else optima.angles
    # A zero added leaves no negative zeros.
    postures = [tuple(posture) for posture in (_with_first(first, angles) + 0.0).tolist()]
    z, margin = optima.index.z.tolist(), optima.index.margin.tolist()
    return OptimalPosture(
        link_lengths=arm.link_lengths,
        joint_angles=postures[0],
        z=z[0],
        characteristic_length=float(optima.index.conditioning_length[0]),
        margin=margin[0],
        model_set=tuple(closest_model_set(arm, postures[0]).tolist()),
        circle_radius=float(abs(arm.operation_point_vectors(postures[0])[0])),
        isotropic=z[0] < ISOTROPIC_Z,
        alternatives=tuple(map(PostureAlternative, postures[1:], z[1:], margin[1:])),
        lower_bound=bound,
        converged=bool(optima.converged[0]),
        starts=found.starts,
        iterations=found.iterations)
