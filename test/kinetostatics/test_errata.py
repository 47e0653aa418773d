"""
Slips in the printed paper, listed in docs/paper.md: the print fails, the corrected form holds.

Numbers of tests are those of the list.
"""

import math

import numpy as np
import pytest

from kinopt_ros.kinetostatics.index import kinetostatic_index
from kinopt_ros.kinetostatics.isotropic_sets import geometric_moment_of_inertia, union
from kinopt_ros.kinetostatics.model_set import index_against, model_polygon
from kinopt_ros.kinetostatics.planar_arm import matrix_of_vectors, PlanarArm
from kinopt_ros.kinetostatics.singular_postures import singular_postures

ISOTROPIC = PlanarArm((1.0, 1.0, math.sqrt(3.0) / 3.0))
OPTIMUM = np.radians([0.0, 120.0, 150.0])
TRIANGLE = [0.5 * complex(math.sqrt(6), math.sqrt(2)),
            0.5 * complex(-math.sqrt(6), math.sqrt(2)), complex(0.0, -math.sqrt(2))]


def test_1_square_of_example_2_is_too_large():
    printed = math.sqrt(2.0) * np.array([1 + 1j, -1 + 1j, -1 - 1j, 1 - 1j])
    matrix = matrix_of_vectors(printed)
    assert matrix @ matrix.T == pytest.approx(np.diag([4.0, 8.0, 8.0]), abs=1e-12)
    with pytest.raises(ValueError, match=r'sum \|k_i\|\^2 = 16: must be 8'):
        index_against(PlanarArm((1, 1, 1, 1)), [0, 1, 1, 1], printed)
    matrix = matrix_of_vectors(printed / math.sqrt(2.0))
    assert matrix @ matrix.T == pytest.approx(4.0 * np.eye(3), abs=1e-12)


def test_2_vectors_of_the_isotropic_example_lack_a_factor():
    phi = np.cumsum(OPTIMUM)
    unit = np.exp(1j * phi)
    last = math.sqrt(3.0) / 3.0 * unit[2]
    printed = np.array([unit.sum(), unit[1] + unit[2], last])
    corrected = np.array([unit[0] + unit[1] + last, unit[1] + last, last])
    # The difference of r_1 and r_3 must be the two links between joints 1 and 3.
    assert abs(printed[0] - printed[2] - (unit[0] + unit[1])) > 0.4
    assert ISOTROPIC.operation_point_vectors(OPTIMUM) == pytest.approx(corrected)
    # With the printed vectors, the posture found in the paper would not be isotropic.
    assert np.linalg.cond(np.vstack([np.ones(3), printed.real, printed.imag])) > 1.5
    length = math.sqrt(6.0) / 6.0
    assert np.linalg.cond(matrix_of_vectors(corrected / length)) == pytest.approx(1.0)


def test_3_the_last_two_rows_are_divided_by_the_length():
    # An arm of four joints has three rows: dividing "the last n" would divide all of them.
    arm, angles = PlanarArm((1.0, 0.8, 0.6, 0.4)), (0.0, 1.0, 1.2, 2.0)
    jacobian = arm.jacobian(angles)
    assert jacobian.shape[0] == 3 < arm.n_joints
    length = kinetostatic_index(arm, angles).conditioning_length
    all_rows = jacobian[-arm.n_joints:] / length
    two_rows = np.vstack([jacobian[0], jacobian[1:] / length])
    # Only the second is free of the unit of length.
    in_mm = PlanarArm([1000.0 * a for a in arm.link_lengths])
    length_in_mm = kinetostatic_index(in_mm, angles).conditioning_length
    scaled = in_mm.jacobian(angles)
    assert np.vstack([scaled[0], scaled[1:] / length_in_mm]) == pytest.approx(two_rows)
    assert np.abs(scaled[-arm.n_joints:] / length_in_mm - all_rows).max() > 1.0


def test_4_identity_printed_for_the_moment_of_inertia():
    square = math.sqrt(2.0) * np.array([-1j, -1, 1j, 1])
    inertia = geometric_moment_of_inertia(union(-np.array(TRIANGLE), square))
    assert not np.allclose(np.eye(2), 7.0 * np.eye(2))
    assert inertia == pytest.approx(14.0 * np.eye(2) - 7.0 * np.eye(2), abs=1e-12)


def test_5_alpha_needs_both_signs():
    # The joint set turned by 150 degrees against the model set: arctan gives -30 degrees.
    turned = OPTIMUM + np.array([math.radians(150.0), 0.0, 0.0])
    r, k = ISOTROPIC.operation_point_vectors(turned), np.array(TRIANGLE)
    numerator, denominator = np.sum((r * np.conj(1j * k)).real), np.sum((r * np.conj(k)).real)
    printed = math.atan(numerator / denominator)
    assert math.degrees(printed) == pytest.approx(-30.0)

    def length(alpha):
        return np.sum(np.abs(r) ** 2) / np.sum((np.conj(np.exp(1j * alpha) * k) * r).real)

    assert length(printed) < 0.0
    index = index_against(ISOTROPIC, turned, TRIANGLE)
    assert math.degrees(index.alpha) == pytest.approx(150.0)
    assert index.conditioning_length == pytest.approx(length(index.alpha))
    assert index.z == pytest.approx(0.0, abs=1e-15)


def test_6_largest_z_need_not_be_singular_with_one_model_set_held():
    mirror_image = -OPTIMUM
    assert index_against(ISOTROPIC, mirror_image, TRIANGLE).z == pytest.approx(1.0)
    length = math.sqrt(6.0) / 6.0
    jacobian = ISOTROPIC.jacobian(mirror_image) / np.array([[1.0], [length], [length]])
    assert np.linalg.svd(jacobian)[1] == pytest.approx(math.sqrt(3.0))
    # With the closest set the largest z of the paper's two arms is at a singular posture.
    for arm in (ISOTROPIC, PlanarArm((1.0, 1.0, 1.0))):
        t = np.linspace(-np.pi, np.pi, 361)
        angles = np.stack(np.meshgrid([0.0], t, t, indexing='ij'), axis=-1)
        largest = kinetostatic_index(arm, angles).z.max()
        assert largest == pytest.approx(
            kinetostatic_index(arm, singular_postures(3, 361)).z.max(), abs=1e-12)


def test_7_generalised_inverse_is_the_transpose_first():
    k = matrix_of_vectors(model_polygon(4))
    inverse = np.linalg.inv(k @ k.T)
    with pytest.raises(ValueError, match='matmul'):
        inverse @ k.T
    assert k.T @ inverse == pytest.approx(np.linalg.pinv(k))
    assert k.T @ inverse == pytest.approx(k.T / 4.0)


def test_8_derivative_of_a_moment_takes_no_transpose():
    rng = np.random.default_rng(1)
    n, slope = rng.normal(size=(2, 3, 3))
    k, step = 3, 1e-6

    def moment(x):
        return np.trace(np.linalg.matrix_power(n + x * slope, k))

    derivative = (moment(step) - moment(-step)) / (2.0 * step)
    power = np.linalg.matrix_power(n, k - 1)
    assert k * np.trace(power @ slope) == pytest.approx(derivative, rel=1e-6)
    assert abs(k * np.trace(power @ slope.T) - derivative) > 0.1


def test_9_transposed_sum_of_the_model_vectors():
    # Eq. "sum-k_i": E (sum k_i)^T multiplies 2 x 2 by 1 x 2; it is (sum k_i)^T E^T.
    e, total = np.array([[0.0, -1.0], [1.0, 0.0]]), np.array([[0.3], [0.7]])
    with pytest.raises(ValueError, match='matmul'):
        e @ total.T
    assert total.T @ e.T == pytest.approx((e @ total).T)


def test_10_projections_pair_equal_subscripts():
    # Eq. "l_P" prints k_i with r_j in lambda: no single k_i gives it.
    angles = OPTIMUM + np.array([0.0, 0.3, -0.2])
    index = index_against(ISOTROPIC, angles, TRIANGLE)
    r = ISOTROPIC.operation_point_vectors(angles)
    k = np.exp(1j * index.alpha) * np.array(TRIANGLE)
    assert np.sum((np.conj(k) * r).real) / np.sum(np.abs(r) ** 2) == pytest.approx(
        index.reciprocal_length)
    for one in k:
        printed = np.sum((np.conj(one) * r).real) / np.sum(np.abs(r) ** 2)
        assert abs(printed - index.reciprocal_length) > 0.1


def test_11_rotated_jacobian_keeps_its_length():
    # In Q J the print drops 1 / l_P: it would not have the norm of J.
    turn = np.eye(3)
    turn[1:, 1:] = [[0.6, -0.8], [0.8, 0.6]]
    length = math.sqrt(6.0) / 6.0
    raw = ISOTROPIC.jacobian(OPTIMUM)
    normalised = raw / np.array([[1.0], [length], [length]])
    assert np.linalg.norm(turn @ normalised) == pytest.approx(np.linalg.norm(normalised))
    assert np.linalg.norm(turn @ raw) < 0.7 * np.linalg.norm(normalised)


def test_12_no_posture_has_rank_one():
    # "A rank-one singularity occurs at a local maximum": joints i and i + 1 are a link apart,
    # so the centred block never vanishes. Its larger singular value is at least a_i / 2.
    rng = np.random.default_rng(2)
    for _ in range(20):
        arm = PlanarArm(rng.uniform(0.1, 1.0, rng.integers(3, 7)))
        sampled = singular_postures(arm.n_joints, 5).reshape(-1, arm.n_joints)
        angles = np.vstack([sampled, rng.uniform(-np.pi, np.pi, (200, arm.n_joints))])
        assert (np.linalg.matrix_rank(arm.jacobian(angles), tol=1e-3) >= 2).all()
        block = arm.jacobian(angles)[:, 1:]
        centred = block - block.mean(axis=-1, keepdims=True)
        assert np.linalg.svd(centred)[1][:, 0].min() >= max(arm.link_lengths[:-1]) / 2 - 1e-12


def test_13_isocontours_of_the_isotropic_arm_are_not_quite_circles():
    # "Close to circular" below z = 0.25: the axes are 1.22 : 1 at the optimum, not 1 : 1.
    steps = np.radians(0.5)
    z = {(i, k): kinetostatic_index(ISOTROPIC, OPTIMUM + [0.0, i * steps, k * steps]).z
         for i in (-1, 0, 1) for k in (-1, 0, 1)}
    second = (z[1, 0] + z[-1, 0]) / steps ** 2
    third = (z[0, 1] + z[0, -1]) / steps ** 2
    mixed = (z[1, 1] - z[1, -1] - z[-1, 1] + z[-1, -1]) / (4.0 * steps ** 2)
    assert mixed == pytest.approx(0.0, abs=1e-3)
    assert math.sqrt(third / second) == pytest.approx(math.sqrt(1.5), abs=1e-3)
