"""Section 3 of the paper: its definitions by their sums, its lemmas as properties."""

import math

from hypothesis import given, strategies
import numpy as np
import pytest

from kinopt_ros.kinetostatics.isotropic_sets import (
    centroid,
    geometric_moment_of_inertia,
    is_isotropic,
    reflected,
    regular_polygon,
    rms_distance_to_centroid,
    rotated,
    second_moment,
    union,
)

ROOT_2, ROOT_6 = math.sqrt(2.0), math.sqrt(6.0)
TRIANGLE = [complex(-ROOT_6 / 2, -ROOT_2 / 2), complex(ROOT_6 / 2, -ROOT_2 / 2), ROOT_2 * 1j]
SQUARE = [-ROOT_2 * 1j, -ROOT_2, ROOT_2 * 1j, ROOT_2]

angles = strategies.floats(-10.0, 10.0)
points = strategies.complex_numbers(max_magnitude=10.0, allow_nan=False)
seeds = strategies.integers(0, 2 ** 32 - 1)


def random_points(seed, least=1):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(least, 12))
    return rng.normal(size=n) + 1j * rng.normal(size=n)


def isotropic_set(seed, centre=0j):
    """Whiten random points: an isotropic set that is no regular polygon."""
    p = random_points(seed, least=3)
    rows = np.array([p.real, p.imag])
    rows -= rows.mean(axis=1, keepdims=True)
    left, _, right = np.linalg.svd(rows, full_matrices=False)
    x, y = left @ right
    return centre + np.random.default_rng(seed).uniform(0.1, 5.0) * (x + 1j * y)


def vectors(p):
    """Rows of the paper's position vectors p_k."""
    return np.array([[point.real, point.imag] for point in p])


@given(seeds)
def test_moments_by_their_definitions(seed):
    p = random_points(seed)
    rows = vectors(p)
    c = sum(rows) / len(rows)
    moment = sum(np.outer(row - c, row - c) for row in rows)
    inertia = sum(np.dot(row - c, row - c) * np.eye(2) - np.outer(row - c, row - c)
                  for row in rows)
    assert [centroid(p).real, centroid(p).imag] == pytest.approx(c)
    assert second_moment(p) == pytest.approx(moment, abs=1e-12)
    assert geometric_moment_of_inertia(p) == pytest.approx(inertia, abs=1e-12)
    assert rms_distance_to_centroid(p) == pytest.approx(math.sqrt(np.trace(moment) / len(p)))


@given(seeds)
def test_moment_of_inertia_by_cross_product_matrices(seed):
    p = random_points(seed)
    total = np.zeros((3, 3))
    for row in vectors(p) - vectors([centroid(p)]):
        cross = np.cross(np.append(row, 0.0), np.eye(3)).T
        total -= cross @ cross
    assert geometric_moment_of_inertia(p) == pytest.approx(total[:2, :2], abs=1e-12)


@given(seeds)
def test_isotropic_set_has_isotropic_moment_of_inertia(seed):
    p = isotropic_set(seed)
    assert is_isotropic(p)
    inertia = geometric_moment_of_inertia(p)
    assert inertia == pytest.approx(inertia[0, 0] * np.eye(2), abs=1e-9)


@given(seeds, seeds, points)
def test_union_of_isotropic_sets_with_one_centroid_is_isotropic(first, second, centre):
    together = union(isotropic_set(first, centre), isotropic_set(second, centre))
    assert is_isotropic(together)


@given(seeds, seeds)
def test_moments_add_up_in_a_union(first, second):
    one, other = isotropic_set(first), isotropic_set(second)
    assert second_moment(union(one, other)) == pytest.approx(
        second_moment(one) + second_moment(other), abs=1e-9)


@given(seeds, angles, points)
def test_rotation_keeps_the_second_moment_and_the_centroid(seed, angle, centre):
    p = isotropic_set(seed, centre)
    turned = rotated(p, angle)
    assert second_moment(turned) == pytest.approx(second_moment(p), abs=1e-9)
    assert centroid(turned) == pytest.approx(centroid(p), abs=1e-9)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    assert vectors(turned - centroid(p)) == pytest.approx(
        vectors(p - centroid(p)) @ turn.T, abs=1e-9)


@given(strategies.integers(3, 40), angles, angles)
def test_trivial_set_stays_isotropic_under_reflection(n, first_angle, axis_angle):
    polygon = regular_polygon(n, first_angle)
    image = reflected(polygon, axis_angle)
    assert is_isotropic(polygon) and is_isotropic(image)
    # By the formula p - 2 (p . m) m with the normal m of the axis.
    normal = np.array([-math.sin(axis_angle), math.cos(axis_angle)])
    expected = vectors(polygon) - 2.0 * np.outer(vectors(polygon) @ normal, normal)
    assert vectors(image) == pytest.approx(expected, abs=1e-12)


@given(seeds, angles, points)
def test_every_isotropic_set_stays_isotropic_under_reflection(seed, axis_angle, centre):
    assert is_isotropic(reflected(isotropic_set(seed, centre), axis_angle))


@pytest.mark.parametrize('n', range(3, 13))
def test_regular_polygon_is_a_model_set(n):
    assert second_moment(regular_polygon(n)) == pytest.approx(n * np.eye(2), abs=1e-12)
    sides = np.abs(np.diff(regular_polygon(n), append=regular_polygon(n)[0]))
    assert sides == pytest.approx(2.0 * ROOT_2 * math.sin(math.pi / n))


def test_union_of_three_and_four_points_as_printed():
    together = union(TRIANGLE, SQUARE)
    assert centroid(together) == pytest.approx(0.0)
    assert second_moment(together) == pytest.approx(7.0 * np.eye(2), abs=1e-12)
    assert geometric_moment_of_inertia(together) == pytest.approx(7.0 * np.eye(2), abs=1e-12)
    assert is_isotropic(together)


def test_triangle_with_its_image_turned_by_60_degrees_is_a_hexagon():
    together = union(TRIANGLE, rotated(TRIANGLE, math.radians(60.0)))
    assert is_isotropic(together)
    gaps = np.diff(np.sort(np.angle(together)))
    assert gaps == pytest.approx(math.radians(60.0))


@pytest.mark.parametrize('p', [
    [0.0, 1.0], [0.0, 1.0, 2.0], [0.0, 1.0, 1.0j], [1.0, 1.0, 1.0], [0.0, 2.0, 1j, 2.0 + 1j]])
def test_sets_that_are_not_isotropic(p):
    assert not is_isotropic(p)


@pytest.mark.parametrize('scale', [1e-200, 1.0, 1e200])
def test_isotropy_does_not_depend_on_the_scale(scale):
    assert is_isotropic(scale * np.array(TRIANGLE))
    assert not is_isotropic(scale * np.array([0.0, 1.0, 1.0j]))


def test_union_needs_a_common_centroid():
    with pytest.raises(ValueError, match='centroids of first and second are 1 apart'):
        union(TRIANGLE, np.array(SQUARE) + 1.0)


@pytest.mark.parametrize(('p', 'message'), [
    ([], r'shape \(0,\)'),
    ([[1.0, 2.0]], r'shape \(1, 2\)'),
    ([1.0, math.nan], r'points\[1\] = .* must be finite'),
    (['x'], r'must be complex numbers'),
])
def test_bad_points(p, message):
    with pytest.raises(ValueError, match=message):
        second_moment(p)


@pytest.mark.parametrize(('arguments', 'message'), [
    ({'n': 2}, 'n = 2: a polygon must have at least 3'),
    ({'n': 3, 'radius': 0.0}, 'radius = 0.0: must be finite and positive'),
    ({'n': 3, 'radius': math.inf}, 'radius = inf: must be finite and positive'),
])
def test_bad_polygons(arguments, message):
    with pytest.raises(ValueError, match=message):
        regular_polygon(**arguments)
