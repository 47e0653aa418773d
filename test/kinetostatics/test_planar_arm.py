"""The arm's geometry against plain coordinates and finite differences."""

import math
import pickle

import numpy as np
import pytest

from kinopt_ros.kinetostatics.planar_arm import PlanarArm


def tip_and_heading(lengths, angles):
    """Give the coordinates of P and the end-effector's orientation."""
    absolute = np.cumsum(angles)
    return np.array([absolute[-1], lengths @ np.cos(absolute), lengths @ np.sin(absolute)])


def random_cases(count, seed=2):
    rng = np.random.default_rng(seed)
    for i in range(count):
        n = 3 + i % 8
        yield rng.uniform(0.1, 3.0, n), rng.uniform(-4.0, 4.0, n)


def test_jacobian_is_the_derivative_of_the_kinematics():
    """By central differences: rates to angular velocity and velocity of P."""
    for lengths, angles in random_cases(40):
        step = 1e-6
        columns = [(tip_and_heading(lengths, angles + step * unit)
                    - tip_and_heading(lengths, angles - step * unit)) / (2.0 * step)
                   for unit in np.eye(len(angles))]
        np.testing.assert_allclose(PlanarArm(lengths).jacobian(angles), np.array(columns).T,
                                   atol=1e-8)


def test_vectors_from_the_joint_centres_to_the_operation_point():
    # Upright: joints at 0, i, i + 2; P at i + 2 - 3i.
    vectors = PlanarArm([1.0, 2.0, 3.0]).operation_point_vectors(
        [math.pi / 2, -math.pi / 2, -math.pi / 2])
    np.testing.assert_allclose(vectors, [2.0 - 2.0j, 2.0 - 3.0j, -3.0j], atol=1e-15)


def test_isotropic_example_of_the_paper():
    """"Isotropic Postures": the vectors r_i of its theta_1 = 0, theta_2, theta_3 printed."""
    arm = PlanarArm([1.0, 1.0, math.sqrt(3.0) / 3.0])
    vectors = arm.operation_point_vectors(np.radians([0.0, 120.0, 150.0]))
    np.testing.assert_allclose(np.abs(vectors), math.sqrt(3.0) / 3.0, atol=1e-15)
    # They are the corners of an equilateral triangle around P.
    assert abs(vectors.sum()) < 1e-15
    assert arm.rms_distance(np.radians([0.0, 120.0, 150.0])) == pytest.approx(
        math.sqrt(3.0) / 3.0, abs=1e-15)


def test_rms_distance():
    for lengths, angles in random_cases(20):
        arm = PlanarArm(lengths)
        absolute = np.cumsum(angles)
        links = lengths * np.array([np.cos(absolute), np.sin(absolute)])
        squares = [np.sum(links[:, i:].sum(axis=1) ** 2) for i in range(len(lengths))]
        assert arm.rms_distance(angles) == pytest.approx(math.sqrt(np.mean(squares)), rel=1e-13)


def test_batches_equal_single_postures():
    rng = np.random.default_rng(4)
    arm = PlanarArm(rng.uniform(0.1, 2.0, 5))
    postures = rng.uniform(-3.0, 3.0, (2, 3, 5))
    vectors, jacobians, distances = (arm.operation_point_vectors(postures),
                                     arm.jacobian(postures), arm.rms_distance(postures))
    assert (vectors.shape, jacobians.shape, distances.shape) == ((2, 3, 5), (2, 3, 3, 5), (2, 3))
    for i in np.ndindex(2, 3):
        np.testing.assert_allclose(vectors[i], arm.operation_point_vectors(postures[i]))
        np.testing.assert_allclose(jacobians[i], arm.jacobian(postures[i]))
        assert distances[i] == pytest.approx(arm.rms_distance(postures[i]))


@pytest.mark.parametrize('lengths, words', [
    ([1.0, 1.0], ['link_lengths', '(2,)', '3']),
    ([], ['link_lengths', '(0,)', '3']),
    (1.0, ['link_lengths', '()', '3']),
    ([[1.0, 1.0, 1.0]], ['link_lengths', '(1, 3)']),
    ([1.0, 0.0, 1.0], ['link_lengths[1]', '0.0', 'positive']),
    ([1.0, 1.0, -2.0], ['link_lengths[2]', '-2.0', 'positive']),
    ([math.nan, 1.0, 1.0], ['link_lengths[0]', 'nan', 'finite']),
    ([1.0, math.inf, 1.0], ['link_lengths[1]', 'inf', 'finite']),
    (['a', 'b', 'c'], ['link_lengths', 'numbers']),
    (None, ['link_lengths']),
    ([1.0, 1j, 1.0], ['link_lengths']),
    ([[1.0], [1.0, 2.0], [1.0]], ['link_lengths']),
    ([10 ** 400, 1.0, 1.0], ['link_lengths']),
    ('123', ['link_lengths']),
])
def test_bad_link_lengths(lengths, words):
    with pytest.raises(ValueError) as error:
        PlanarArm(lengths)
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize('method', ['jacobian', 'operation_point_vectors', 'rms_distance'])
@pytest.mark.parametrize('angles, words', [
    ([0.0, 1.0], ['joint_angles', '(2,)', '3']),
    ([0.0, math.nan, 0.0], ['joint_angles[1]', 'nan', 'finite']),
    (0.5, ['joint_angles', '()']),
    ('abc', ['joint_angles']),
])
def test_bad_joint_angles(method, angles, words):
    with pytest.raises(ValueError) as error:
        getattr(PlanarArm([1.0, 1.0, 1.0]), method)(angles)
    for word in words:
        assert word in str(error.value)


def test_arms_are_values():
    arm = PlanarArm(np.array([1.0, 2.0, 3.0]))
    assert arm == PlanarArm((1, 2, 3))
    assert hash(arm) == hash(PlanarArm([1.0, 2.0, 3.0]))
    assert pickle.loads(pickle.dumps(arm)) == arm
    assert arm.link_lengths == (1.0, 2.0, 3.0)
    assert arm.n_joints == 3
    with pytest.raises(AttributeError):
        arm.link_lengths = (1.0, 1.0, 1.0)


def test_lengths_given_are_not_aliased():
    lengths = np.array([1.0, 2.0, 3.0])
    arm = PlanarArm(lengths)
    lengths[0] = 9.0
    assert arm.link_lengths == (1.0, 2.0, 3.0)
