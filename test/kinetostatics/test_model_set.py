"""The index against a given model set, checked by brute force on the paper's matrices."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import ortho_group

from kinopt_ros.kinetostatics.gradient_against import gradient_against
from kinopt_ros.kinetostatics.index import kinetostatic_index
from kinopt_ros.kinetostatics.model_set import (
    closest_model_set,
    index_against,
    model_polygon,
    model_set_of_matrix,
)
from kinopt_ros.kinetostatics.optimal_posture import optimal_posture
from kinopt_ros.kinetostatics.planar_arm import matrix_of_vectors, PlanarArm

ISOTROPIC = PlanarArm((1.0, 1.0, math.sqrt(3.0) / 3.0))
# Example 1 as printed: the matrix, and its points as complex numbers.
EXAMPLE_1_MATRIX = [[1.0, 1.0, 1.0],
                    [-math.sqrt(2) / 2, -math.sqrt(2) / 2, math.sqrt(2)],
                    [math.sqrt(6) / 2, -math.sqrt(6) / 2, 0.0]]
EXAMPLE_1 = [0.5 * complex(math.sqrt(6), math.sqrt(2)),
             0.5 * complex(-math.sqrt(6), math.sqrt(2)),
             complex(0.0, -math.sqrt(2))]


def random_cases(count, seed=5):
    """Arms of 3 to 6 joints with a posture and a random isotropic set each."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        n = int(rng.integers(3, 7))
        arm = PlanarArm(10.0 ** rng.uniform(-1.0, 1.0, n))
        yield arm, rng.uniform(-np.pi, np.pi, n), random_model_set(n, rng)


def random_model_set(n, rng):
    """Two orthonormal rows orthogonal to the ones, scaled: K K^T = n 1."""
    rows = ortho_group.rvs(n, random_state=rng)
    rows[0] = 1.0
    orthonormal, _ = np.linalg.qr(rows.T)
    return math.sqrt(n) * (orthonormal[:, 1] + 1j * orthonormal[:, 2])


def normalised(arm, angles, length):
    return arm.jacobian(angles) / np.array([[1.0], [length], [length]])


def half_squared_distance(first, second):
    """Eq. "least-squares" by its definition with a trace."""
    difference = first - second
    return np.trace(difference @ difference.T) / (2.0 * first.shape[1])


def z_by_definition(arm, angles, model_set, reciprocal_length, alpha):
    rotated = np.exp(1j * alpha) * np.asarray(model_set)
    return half_squared_distance(normalised(arm, angles, 1.0 / reciprocal_length),
                                 matrix_of_vectors(rotated))


def test_z_length_and_alpha_minimise_the_distance():
    for arm, angles, model_set in random_cases(25):
        index = index_against(arm, angles, model_set)
        size = arm.longest_link

        def distance(x, arm=arm, angles=angles, model_set=model_set, size=size):
            return z_by_definition(arm, angles, model_set, x[0] / size, x[1])

        found = min((minimize(distance, [0.3, alpha], method='Nelder-Mead',
                              options={'xatol': 1e-9, 'fatol': 1e-14, 'maxiter': 2000})
                     for alpha in (0.0, 2.1, -2.1)), key=lambda result: result.fun)
        assert index.z == pytest.approx(found.fun, abs=1e-9)
        assert index.conditioning_length > 0.0
        assert distance([size / index.conditioning_length, index.alpha]) == pytest.approx(
            index.z, abs=1e-12)
        assert index.reciprocal_length * index.conditioning_length == pytest.approx(1.0)


def test_normality_conditions():
    step = 1e-5
    for arm, angles, model_set in random_cases(25, seed=6):
        index = index_against(arm, angles, model_set)
        unit = index.reciprocal_length

        def z(scale, alpha, arm=arm, angles=angles, model_set=model_set, unit=unit):
            return z_by_definition(arm, angles, model_set, scale * unit, alpha)

        by_length = (z(1.0 + step, index.alpha) - z(1.0 - step, index.alpha)) / (2.0 * step)
        by_alpha = (z(1.0, index.alpha + step) - z(1.0, index.alpha - step)) / (2.0 * step)
        assert abs(by_length) < 1e-9 and abs(by_alpha) < 1e-9
        # Both are minima, and by half a turn of the set z is at a maximum over alpha.
        assert z(1.0, index.alpha + np.pi) > z(1.0, index.alpha)


def test_square_root_n_d_rms_is_a_geometric_mean():
    for arm, angles, model_set in random_cases(25, seed=7):
        index = index_against(arm, angles, model_set)
        rotated = np.exp(1j * index.alpha) * model_set
        projections = np.sum((np.conj(rotated) * arm.operation_point_vectors(angles)).real)
        mean = math.sqrt(index.conditioning_length * projections)
        assert mean == pytest.approx(math.sqrt(arm.n_joints) * arm.rms_distance(angles))


def test_distance_is_invariant_under_a_rotation_of_both_sets():
    for arm, angles, model_set in random_cases(10, seed=8):
        length = index_against(arm, angles, model_set).conditioning_length
        turn = np.eye(3)
        turn[1:, 1:] = [[math.cos(1.1), -math.sin(1.1)], [math.sin(1.1), math.cos(1.1)]]
        jacobian, model = normalised(arm, angles, length), matrix_of_vectors(model_set)
        assert half_squared_distance(turn @ jacobian, turn @ model) == pytest.approx(
            half_squared_distance(jacobian, model))


def test_z_and_margin_do_not_depend_on_theta_1_or_on_the_rotation_of_the_set():
    for arm, angles, model_set in random_cases(10, seed=9):
        index = index_against(arm, angles, model_set)
        turned = index_against(arm, angles + np.eye(arm.n_joints)[0], model_set)
        assert turned.z == pytest.approx(index.z)
        assert np.exp(1j * (turned.alpha - index.alpha)) == pytest.approx(np.exp(1j))
        turned = index_against(arm, angles, np.exp(0.7j) * model_set)
        assert turned[:3] == pytest.approx(index[:3])
        assert np.exp(1j * (index.alpha - turned.alpha)) == pytest.approx(np.exp(0.7j))


def test_margin_is_the_distance_to_the_nearest_singular_matrix():
    # Eckart-Young with the first row kept: the least singular value of the centred block.
    for arm, angles, model_set in random_cases(25, seed=10):
        index = index_against(arm, angles, model_set)
        block = normalised(arm, angles, index.conditioning_length)[1:]
        least = np.linalg.svd(block - block.mean(axis=1, keepdims=True))[1][-1]
        assert index.margin == pytest.approx(least / math.sqrt(arm.n_joints), abs=1e-14)


@pytest.mark.parametrize('mirror', [False, True])
def test_gradients_by_finite_differences(mirror):
    step = 1e-5
    for arm, angles, model_set in random_cases(40, seed=21):
        gradient = gradient_against(arm, angles, model_set, mirror)
        ahead, behind = (index_against(arm, angles + sign * step * np.eye(arm.n_joints),
                                       model_set, mirror) for sign in (1.0, -1.0))
        for found, here, there in [(gradient.z, ahead.z, behind.z),
                                   (gradient.margin, ahead.margin, behind.margin)]:
            assert found == pytest.approx((here - there) / (2.0 * step), rel=1e-6, abs=1e-8)


def test_gradients_of_many_postures_and_at_a_singular_one():
    arm, model_set = PlanarArm((1.0, 0.8, 0.6, 0.4)), model_polygon(4, (0, 2, 1, 3))
    angles = np.random.default_rng(22).uniform(-4.0, 4.0, (3, 5, 4))
    angles[0, 0] = [0.3, 0.0, np.pi, 1.0]
    many = gradient_against(arm, angles, model_set, mirror=True)
    assert np.isfinite(many.z).all() and np.isfinite(many.margin).all()
    one = gradient_against(arm, angles[2, 4], model_set, mirror=True)
    assert one.z == pytest.approx(many.z[2, 4]) and one.margin == pytest.approx(many.margin[2, 4])


def test_no_given_set_is_closer_than_the_closest():
    for arm, angles, model_set in random_cases(100, seed=11):
        closest = kinetostatic_index(arm, angles)
        index = index_against(arm, angles, model_set)
        assert index.z >= closest.z - 1e-14
        assert index.conditioning_length >= closest.conditioning_length * (1.0 - 1e-14)
        assert index.margin <= closest.margin + 1e-14
        assert index.margin <= math.sqrt(max(1.0 - index.z, 0.0)) + 1e-12


def test_closest_set_attains_z():
    for arm, angles, _ in random_cases(25, seed=12):
        closest = kinetostatic_index(arm, angles)
        points = closest_model_set(arm, angles)
        matrix = matrix_of_vectors(points)
        n = arm.n_joints
        assert matrix @ matrix.T == pytest.approx(n * np.eye(3), abs=1e-10)
        assert half_squared_distance(
            normalised(arm, angles, closest.conditioning_length), matrix) == pytest.approx(
                closest.z, abs=1e-12)
        index = index_against(arm, angles, points)
        assert index[:3] == pytest.approx(closest, abs=1e-12)
        assert index.alpha == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize('angles', [(0.4, 0.0, 0.0), (0.0, math.pi, 1.0), (0.0, 0.0, math.pi)])
def test_closest_set_of_a_singular_posture_is_a_model_set(angles):
    arm = PlanarArm((1.0, 0.7, 0.3))
    points = closest_model_set(arm, angles)
    matrix = matrix_of_vectors(points)
    assert matrix @ matrix.T == pytest.approx(3.0 * np.eye(3), abs=1e-9)
    assert index_against(arm, angles, points).z == pytest.approx(
        kinetostatic_index(arm, angles).z, abs=1e-9)


def test_three_joints_have_one_model_set_up_to_its_mirror_image():
    rng = np.random.default_rng(13)
    mirrored = set()
    for _ in range(50):
        arm = PlanarArm(10.0 ** rng.uniform(-1.0, 1.0, 3))
        angles = rng.uniform(-np.pi, np.pi, 3)
        index = index_against(arm, angles, EXAMPLE_1, mirror=True)
        mirrored.add(index.mirrored)
        assert index[:3] == pytest.approx(kinetostatic_index(arm, angles), rel=1e-7, abs=1e-12)
        straight = index_against(arm, angles, EXAMPLE_1)
        image = index_against(arm, angles, np.conj(EXAMPLE_1))
        assert index.z == min(straight.z, image.z)
        assert index.alpha == (image if index.mirrored else straight).alpha
    assert mirrored == {False, True}


def test_four_joints_have_closer_sets_than_the_square_in_any_numbering():
    arm, angles = PlanarArm((1.0, 0.8, 0.6, 0.4)), (0.0, 1.0, 1.2, 2.0)
    of_square = min(index_against(arm, angles, model_polygon(4, numbering), mirror=True).z
                    for numbering in [(0, 1, 2, 3), (0, 1, 3, 2), (0, 2, 1, 3)])
    assert of_square > kinetostatic_index(arm, angles).z + 1e-3


def test_isotropic_posture_has_its_printed_jacobian():
    angles = np.radians([0.0, 120.0, 150.0])
    index = index_against(ISOTROPIC, angles, EXAMPLE_1)
    assert index.z == pytest.approx(0.0, abs=1e-15)
    assert index.conditioning_length == pytest.approx(math.sqrt(6.0) / 6.0)
    assert normalised(ISOTROPIC, angles, index.conditioning_length) == pytest.approx(
        np.array(EXAMPLE_1_MATRIX), abs=1e-12)


def test_condition_number_in_the_papers_norm():
    # Eq. "kappa" with eq. "norm": 1 at isotropy, more elsewhere.
    def condition(angles):
        length = index_against(ISOTROPIC, angles, EXAMPLE_1).conditioning_length
        jacobian = normalised(ISOTROPIC, angles, length)
        return np.linalg.norm(jacobian) * np.linalg.norm(np.linalg.inv(jacobian)) / 3.0

    assert condition(np.radians([0.0, 120.0, 150.0])) == pytest.approx(1.0)
    assert condition(np.radians([0.0, 100.0, 160.0])) > 1.05


def test_equilateral_optimum_has_its_printed_jacobian():
    arm = PlanarArm((1.0, 1.0, 1.0))
    optimum = optimal_posture(arm)
    assert np.degrees(optimum.joint_angles) == pytest.approx([0.0, 81.8, 155.2], abs=0.051)
    index = index_against(arm, optimum.joint_angles, EXAMPLE_1)
    assert index.z == pytest.approx(0.178, abs=5.1e-4)
    assert index.conditioning_length == pytest.approx(0.563, abs=5.1e-4)
    assert normalised(arm, optimum.joint_angles, index.conditioning_length) == pytest.approx(
        np.array([[1, 1, 1], [-0.268, -0.268, 1.489], [1.061, -0.714, -0.966]]), abs=5.1e-4)


def test_least_z_is_the_largest_ratio_of_d_rms_to_l_p_not_the_least_l_p():
    arm = PlanarArm((1.0, 1.0, 1.0))
    optimum = optimal_posture(arm)
    t = np.linspace(-np.pi, np.pi, 181)
    angles = np.stack(np.meshgrid([0.0], t, t, indexing='ij'), axis=-1)
    index = index_against(arm, angles, EXAMPLE_1, mirror=True)
    ratio = arm.rms_distance(angles) / index.conditioning_length
    best = arm.rms_distance(optimum.joint_angles) / optimum.characteristic_length
    assert ratio.max() <= best and ratio.max() == pytest.approx(best, abs=1e-3)
    assert index.conditioning_length.min() < 0.995 * optimum.characteristic_length
    assert index.z == pytest.approx(1.0 - 0.5 * ratio ** 2)


def test_posture_opposed_to_the_model_set():
    # The mirror image of the isotropic posture: the best there is, the worst for this set.
    angles = np.radians([0.0, -120.0, -150.0])
    index = index_against(ISOTROPIC, angles, EXAMPLE_1)
    assert index.z == 1.0 and index.conditioning_length > 1e12 and index.margin < 1e-12
    assert index_against(ISOTROPIC, angles, EXAMPLE_1, mirror=True).z == pytest.approx(0.0)


def test_many_postures_equal_one_by_one():
    rng = np.random.default_rng(14)
    arm, model_set = PlanarArm((1.0, 0.8, 0.6, 0.4)), model_polygon(4, (0, 2, 1, 3))
    angles = rng.uniform(-4.0, 4.0, (3, 4000, 4))
    many = index_against(arm, angles, model_set, mirror=True)
    assert all(values.shape == (3, 4000) for values in many)
    for i, k in [(0, 0), (1, 1000), (2, 3999)]:
        one = index_against(arm, angles[i, k].tolist(), model_set, mirror=True)
        assert [type(value) for value in one] == [float] * 4 + [bool]
        assert one == pytest.approx([values[i, k] for values in many], rel=1e-12)
    assert index_against(arm, np.zeros((0, 4)), model_set).z.shape == (0,)


def test_polygon_in_a_numbering():
    square = model_polygon(4)
    assert model_polygon(4, [2, 0, 1, 3]).tolist() == square[[2, 0, 1, 3]].tolist()
    matrix = matrix_of_vectors(model_polygon(7, (6, 2, 0, 1, 3, 5, 4)))
    assert matrix @ matrix.T == pytest.approx(7.0 * np.eye(3), abs=1e-12)


def test_matrix_gives_its_points():
    assert model_set_of_matrix(EXAMPLE_1_MATRIX) == pytest.approx(np.array(EXAMPLE_1))


@pytest.mark.parametrize(('model_set', 'message'), [
    ([1.0, 2.0], r'model_set has length 2: must hold n = 3 points'),
    ([1.0, 1.0, 1.0], r'model_set has sum k_i = 3\+0j: must be 0'),
    ([math.sqrt(3), -math.sqrt(3), 0.0], r'model_set has sum k_i\^2 = 6\+0j: must be 0'),
    (2.0 * np.array(EXAMPLE_1), r'model_set has sum \|k_i\|\^2 = 24: must be 6'),
    ([math.nan, 0.0, 0.0], r'model_set has sum k_i = nan'),
    (['one', 2.0, 3.0], r'model_set = .* must be complex numbers'),
])
def test_bad_model_sets(model_set, message):
    with pytest.raises(ValueError, match=message):
        index_against(ISOTROPIC, [0.0, 1.0, 2.0], model_set)


@pytest.mark.parametrize(('matrix', 'message'), [
    (np.ones((2, 3)), r'shape \(2, 3\): must be \(3, n\)'),
    (np.ones((3, 2)), r'shape \(3, 2\): must be \(3, n\)'),
    (np.zeros((3, 3)), r'the first row must be ones'),
    (np.ones((3, 3)), r'sum k_i'),
    ([['a', 'b', 'c']] * 3, r'must be real numbers'),
])
def test_bad_matrices(matrix, message):
    with pytest.raises(ValueError, match=message):
        model_set_of_matrix(matrix)


@pytest.mark.parametrize('numbering', [(0, 1, 1), (1, 2, 3), (0, 1)])
def test_bad_numberings(numbering):
    with pytest.raises(ValueError, match=r'must hold each of 0 \.\.\. 2 once'):
        model_polygon(3, numbering)


def test_bad_angles():
    with pytest.raises(ValueError, match='must hold n = 3 angles'):
        index_against(ISOTROPIC, [0.0, 1.0], EXAMPLE_1)
    with pytest.raises(ValueError, match='must be finite'):
        index_against(ISOTROPIC, [0.0, math.nan, 1.0], EXAMPLE_1)
    with pytest.raises(ValueError, match='must be one posture'):
        closest_model_set(ISOTROPIC, np.zeros((2, 3)))


def test_gradient_where_the_last_link_is_very_long():
    """Where it is much longer than the others the margin falls with its square."""
    angles, polygon = [0.3, 1.1, -0.7], model_polygon(3)
    slopes = []
    for length in (1e9, 1e12):
        gradient = gradient_against(PlanarArm((1.0, 0.8, length)), angles, polygon)
        assert np.isfinite(gradient.z).all()
        slopes.append(gradient.margin[1] * length ** 2)
    assert slopes[0] != 0.0
    # The vectors r_i have lost twelve of their digits.
    assert slopes[1] == pytest.approx(slopes[0], rel=1e-3)
