"""Gradients of z and of the margin against finite differences of the index itself."""

import itertools
import math

import numpy as np
import pytest

from kinopt_ros.kinetostatics.gradient import index_gradient
from kinopt_ros.kinetostatics.index import kinetostatic_index
from kinopt_ros.kinetostatics.planar_arm import PlanarArm


def random_arm(rng, n):
    return PlanarArm(10.0 ** rng.uniform(-1.0, 1.0, n))


def analytic_scores(lengths, angles):
    """Index and margin by Cauchy-Binet, in operations that are analytic in the angles."""
    phi = np.cumsum(angles)
    x = np.cumsum((lengths * np.cos(phi))[::-1])
    y = np.cumsum((lengths * np.sin(phi))[::-1])
    r_squared = np.sum(x * x + y * y)
    x, y = x - x.mean(), y - y.mean()
    trace = np.sum(x * x + y * y)
    # Half the sum over all ordered pairs, as each pair of joint centres counts once.
    determinant = 0.5 * np.sum((np.outer(x, y) - np.outer(y, x)) ** 2)
    product = np.sqrt(determinant)
    s1_squared = 0.5 * (trace + np.sqrt(trace * trace - 4.0 * determinant))
    z = 1.0 - (trace + 2.0 * product) / (2.0 * r_squared)
    return z, (determinant / s1_squared + product) / r_squared


def differences(lengths, angles):
    """Complex-step differences: no cancellation, so all digits are right."""
    steps = 1e-30j * np.eye(len(angles))
    scores = [analytic_scores(np.array(lengths), np.array(angles) + step) for step in steps]
    return np.array(scores).imag.T / 1e-30


@pytest.mark.parametrize('n', range(3, 13))
def test_agrees_with_differences_on_regular_postures(n):
    rng = np.random.default_rng(n)
    for _ in range(5):
        arm = random_arm(rng, n)
        angles = rng.uniform(-math.pi, math.pi, n).tolist()
        by_z, by_margin = differences(arm.link_lengths, angles)
        gradient = index_gradient(arm, angles)
        # Each component for itself, the smallest ones too.
        np.testing.assert_allclose(gradient.z[1:], by_z[1:], rtol=1e-9, atol=1e-14)
        np.testing.assert_allclose(gradient.margin[1:], by_margin[1:], rtol=1e-9, atol=1e-14)


def test_first_joint_changes_nothing():
    rng = np.random.default_rng(1)
    arm = random_arm(rng, 5)
    postures = rng.uniform(-3.0, 3.0, (50, 5))
    postures[:10, 1:] = 0.0
    gradient = index_gradient(arm, postures)
    for values in gradient:
        assert np.all(values[:, 0] == 0.0)
        assert not np.signbit(values[:, 0]).any()
    turned = postures + [1.234, 0.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(index_gradient(arm, turned).z, gradient.z, atol=1e-13)


def test_arrays_of_any_shape_score_as_their_postures():
    rng = np.random.default_rng(2)
    arm = random_arm(rng, 4)
    postures = rng.uniform(-3.0, 3.0, (2, 3, 4))
    postures[1, 1] = [0.3, 0.0, math.pi, 0.7]
    many = index_gradient(arm, postures)
    for values in many:
        assert values.shape == postures.shape
    for where in np.ndindex(2, 3):
        one = index_gradient(arm, postures[where].tolist())
        np.testing.assert_allclose(many.z[where], one.z, atol=1e-14)
        np.testing.assert_allclose(many.margin[where], one.margin, atol=1e-14)
    assert index_gradient(arm, np.empty((0, 4))).z.shape == (0, 4)


@pytest.mark.parametrize('distance', [1e-3, 1e-6, 1e-9])
def test_accurate_next_to_the_singular_set(distance):
    arm = PlanarArm((1.0, 0.7, 1.3, 0.4))
    angles = [0.2, distance, -0.6 * distance, 0.9]
    by_z, by_margin = differences(arm.link_lengths, angles)
    gradient = index_gradient(arm, angles)
    tolerance = 1e-15 / distance + 1e-12
    np.testing.assert_allclose(gradient.z, by_z, atol=tolerance)
    np.testing.assert_allclose(gradient.margin, by_margin, atol=tolerance)


def test_zero_at_isotropy_and_accurate_beside_it():
    arm = PlanarArm((1.0, 1.0, math.sqrt(3.0) / 3.0))
    isotropic = np.radians([0.0, 120.0, 150.0])
    gradient = index_gradient(arm, isotropic)
    np.testing.assert_allclose(gradient.z, 0.0, atol=1e-14)
    assert np.all(np.isfinite(gradient.margin))
    for distance in (1e-4, 1e-7):
        angles = (isotropic + distance * np.array([0.0, 1.0, -0.4])).tolist()
        by_z, _ = differences(arm.link_lengths, angles)
        assert np.linalg.norm(index_gradient(arm, angles).z - by_z) < 3e-15


def test_accurate_where_the_singular_values_meet_away_from_isotropy():
    # Equal first links at 120 degrees make an equilateral triangle of joint centres, so that
    # s1 = s2 whatever the last joint does.
    arm = PlanarArm((1.0, 1.0, 0.9))
    angles = [0.0, 2.0 * math.pi / 3.0, 0.8]
    by_z, _ = differences(arm.link_lengths, angles)
    gradient = index_gradient(arm, angles)
    assert np.linalg.norm(by_z) > 0.1
    np.testing.assert_allclose(gradient.z, by_z, atol=1e-14)
    # By the last joint the margin, too, is smooth here: it follows z.
    assert gradient.margin[2] == pytest.approx(-by_z[2], abs=1e-13)


@pytest.mark.parametrize('n', [3, 4, 6, 9])
@pytest.mark.parametrize('tip_on_the_line', [True, False])
def test_steepest_descent_on_the_singular_set(n, tip_on_the_line):
    rng = np.random.default_rng(10 * n + tip_on_the_line)
    for _ in range(10):
        arm = random_arm(rng, n)
        angles = rng.choice([0.0, math.pi, -math.pi], n)
        if not tip_on_the_line:
            angles[-1] = rng.uniform(-3.0, 3.0)
        gradient = index_gradient(arm, angles)
        steepness = np.linalg.norm(gradient.z)
        assert math.isfinite(steepness)
        assert np.all(np.isfinite(gradient.margin))
        step = 1e-7
        here = kinetostatic_index(arm, angles)
        ahead = kinetostatic_index(arm, angles - step * gradient.z / steepness)
        assert (ahead.z - here.z) / step == pytest.approx(-steepness, abs=2e-6)
        # The margin's gradient is the one of the same side.
        assert ahead.margin / step == pytest.approx(
            -gradient.margin @ gradient.z / steepness, abs=2e-6)
        directions = rng.normal(size=(3000, n))
        directions[:, 0] = 0.0
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        slopes = (kinetostatic_index(arm, angles + step * directions).z - here.z) / step
        assert slopes.min() > -steepness - 2e-6


def test_limit_of_the_gradients_on_its_side_of_the_crease():
    arm = PlanarArm((1.0, 0.8, 0.5, 0.3))
    singular = np.array([0.4, 0.0, math.pi, 1.1])
    at_crease = index_gradient(arm, singular)
    beside = index_gradient(
        arm, singular - 1e-6 * at_crease.z / np.linalg.norm(at_crease.z))
    np.testing.assert_allclose(beside.z, at_crease.z, atol=1e-5)
    np.testing.assert_allclose(beside.margin, at_crease.margin, atol=1e-5)


def test_stretched_arm_bends_counterclockwise_first():
    for lengths in ((1.0, 1.0, 1.0), (1.0, 2.0, 0.3, 0.8), (0.4, 0.2, 0.7, 0.1, 1.0)):
        step = -index_gradient(PlanarArm(lengths), [0.0] * len(lengths)).z
        assert step[1] > 0.0


@pytest.mark.parametrize('lengths', [(1.0, 1e-3, 1.0), (1e-50, 1e50, 1.0), (1.0,) * 40,
                                     (1.0, 1e-20, 1e-20, 5.0)])
def test_finite_for_any_arm_and_posture(lengths):
    n = len(lengths)
    rng = np.random.default_rng(n)
    postures = rng.uniform(-3.0, 3.0, (40, n))
    postures[:20] = rng.choice([0.0, math.pi, 2.0 * math.pi, 200.0 * math.pi], (20, n))
    postures[10:20, -1] = 0.5
    gradient = index_gradient(PlanarArm(lengths), postures)
    assert np.all(np.isfinite(gradient.z))
    assert np.all(np.isfinite(gradient.margin))


def test_rejects_what_is_no_posture():
    arm = PlanarArm((1.0, 1.0, 1.0))
    with pytest.raises(ValueError, match='joint_angles has shape'):
        index_gradient(arm, [0.0, 0.0])
    with pytest.raises(ValueError, match='must be finite'):
        index_gradient(arm, [0.0, math.nan, 0.0])


def test_angles_that_underflow():
    """Angles too small to have any effect are those of the stretched arm."""
    arm = PlanarArm((1.0, 1.0, 1.0))
    stretched = index_gradient(arm, [0.0, 0.0, 0.0])
    for tiny in itertools.product([0.0, 5e-324, -5e-324, 1e-308], repeat=3):
        gradient = index_gradient(arm, list(tiny))
        np.testing.assert_allclose(gradient.z, stretched.z, atol=1e-12)
