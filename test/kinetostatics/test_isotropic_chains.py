"""Isotropic chains: every one is an arm whose Jacobian has three equal singular values."""

from itertools import permutations
import math

import numpy as np
import pytest

from kinopt_ros.kinetostatics.isotropic_chains import (
    all_numberings,
    chain_of,
    design_isotropic_arms,
    distinct_numberings,
    isotropic_chains,
    symmetries,
)
from kinopt_ros.kinetostatics.isotropic_sets import regular_polygon, union
from kinopt_ros.kinetostatics.planar_arm import PlanarArm

# Seven distinct points without a symmetry but the identity.
CROOKED = union(regular_polygon(3, 0.3), regular_polygon(4, 0.5, radius=2.0))


def joint_centres(chain):
    """Joint centres by forward kinematics from joint 1 along the links."""
    directions = np.exp(1j * np.cumsum(chain.joint_angles))
    along = np.cumsum(directions * chain.link_lengths)
    return chain.points[0] + np.concatenate([[0.0], along[:-1]])


def normalised_singular_values(chain):
    arm = PlanarArm(chain.link_lengths)
    length = arm.rms_distance(chain.joint_angles) / math.sqrt(2.0)
    jacobian = arm.jacobian(chain.joint_angles) / np.array([[1.0], [length], [length]])
    return np.linalg.svd(jacobian)[1]


def shape(chain, reflections):
    """Distances between all pairs of joints, and without reflections also their sense."""
    p = chain.points
    distances = np.abs(p[:, None] - p).ravel()
    crosses = (np.conj(p[:-2] - p[-1]) * (p[1:-1] - p[-1])).imag
    return tuple(np.round(np.append(distances, [] if reflections else crosses), 6) + 0.0)


@pytest.mark.parametrize('points', [regular_polygon(n) for n in range(3, 8)] + [CROOKED])
def test_every_chain_is_isotropic(points):
    for chain in isotropic_chains(points)[:60]:
        assert normalised_singular_values(chain) == pytest.approx(math.sqrt(len(points)))
        assert joint_centres(chain) == pytest.approx(chain.points, abs=1e-9)


def test_numberings_are_all_permutations():
    assert all_numberings(4).tolist() == [list(order) for order in permutations(range(4))]


def test_six_numberings_of_the_square_up_to_rotation():
    chains = isotropic_chains(regular_polygon(4), reflections=False)
    assert len(chains) == 6
    # Each starts at the same corner, as in the paper's figure.
    assert {chain.numbering[0] for chain in chains} == {0}
    assert len(isotropic_chains(regular_polygon(4))) == 3


@pytest.mark.parametrize('n', range(3, 8))
def test_number_of_chains_of_a_regular_polygon(n):
    polygon = regular_polygon(n)
    assert len(distinct_numberings(polygon, reflections=False)) == math.factorial(n - 1)
    assert len(distinct_numberings(polygon)) == math.factorial(n - 1) // 2


@pytest.mark.parametrize('reflections', [False, True])
@pytest.mark.parametrize('points', [
    regular_polygon(4), regular_polygon(5), union(regular_polygon(3), regular_polygon(3, 0.2)),
    union(regular_polygon(3), regular_polygon(3, math.pi / 2, radius=2.0))])
def test_distinct_numberings_by_comparing_all_shapes(points, reflections):
    every = [chain_of(points, order) for order in permutations(range(len(points)))]
    shapes = {shape(chain, reflections) for chain in every}
    listed = [shape(chain_of(points, order.tolist()), reflections)
              for order in distinct_numberings(points, reflections)]
    assert len(set(listed)) == len(listed) and set(listed) == shapes


def test_symmetries_of_polygons_and_of_a_crooked_set():
    assert len(symmetries(regular_polygon(5))) == 10
    assert len(symmetries(regular_polygon(5), reflections=False)) == 5
    assert [symmetry.tolist() for symmetry in symmetries(CROOKED)] == [list(range(7))]
    assert len(distinct_numberings(CROOKED)) == math.factorial(7)


def test_chain_of_the_triangle_is_the_isotropic_manipulator():
    chain, = isotropic_chains(regular_polygon(3, radius=1.0 / math.sqrt(3.0)))
    assert chain.link_lengths == pytest.approx((1.0, 1.0, math.sqrt(3.0) / 3.0))
    assert np.degrees(chain.joint_angles[1:]) == pytest.approx([120.0, 150.0])


@pytest.mark.parametrize('n', range(3, 7))
def test_design_for_a_reach(n):
    for chain in design_isotropic_arms(n, reach=1.7):
        assert sum(chain.link_lengths) == pytest.approx(1.7) and chain.reach == pytest.approx(1.7)
        assert normalised_singular_values(chain) == pytest.approx(math.sqrt(n))
        assert joint_centres(chain) == pytest.approx(chain.points, abs=1e-12)


@pytest.mark.parametrize('n', range(3, 7))
def test_design_for_a_d_rms(n):
    chains = design_isotropic_arms(n, d_rms=0.4)
    for chain in chains:
        assert PlanarArm(chain.link_lengths).rms_distance(chain.joint_angles) == pytest.approx(0.4)
    assert len(chains) == math.factorial(n - 1) // 2
    assert np.diff([chain.reach for chain in chains]).min(initial=0.0) > -1e-12


def test_design_from_a_given_set():
    chains = design_isotropic_arms(7, reach=2.0, points=10.0 * CROOKED)
    assert normalised_singular_values(chains[0]) == pytest.approx(math.sqrt(7.0))
    assert chains[0].reach == pytest.approx(2.0)


def test_point_on_the_centroid_is_never_the_last_joint():
    points = np.append(regular_polygon(4), 0.0)
    chains = isotropic_chains(points)
    assert chains and all(chain.numbering[-1] != 4 for chain in chains)
    with pytest.raises(ValueError, match='last link would have no length'):
        chain_of(points)


@pytest.mark.parametrize(('arguments', 'message'), [
    ({'n': 4}, 'exactly one of the two'),
    ({'n': 4, 'reach': 1.0, 'd_rms': 1.0}, 'exactly one of the two'),
    ({'n': 4, 'reach': 0.0}, 'reach = 0.0: must be finite and positive'),
    ({'n': 4, 'd_rms': math.nan}, 'd_rms = nan: must be finite and positive'),
    ({'n': 2, 'reach': 1.0}, 'n = 2: must be from 3 to 9'),
    ({'n': 10, 'reach': 1.0}, 'n = 10: must be from 3 to 9'),
    ({'n': 4, 'reach': 1.0, 'points': regular_polygon(5)}, 'must hold n = 4 points'),
    ({'n': 3, 'reach': 1.0, 'points': [0.0, 1.0, 1j]}, 'must be isotropic'),
])
def test_bad_designs(arguments, message):
    with pytest.raises(ValueError, match=message):
        design_isotropic_arms(**arguments)


def test_bad_sets_and_numberings():
    with pytest.raises(ValueError, match=r'points\[0\] and points\[2\] coincide'):
        distinct_numberings([1.0, 2.0, 1.0])
    with pytest.raises(ValueError, match=r'must hold each of 0 \.\.\. 2 once'):
        chain_of(regular_polygon(3), (0, 0, 1))
    with pytest.raises(ValueError, match='n = 10: numberings are listed for 1 to 9'):
        distinct_numberings(regular_polygon(10))
