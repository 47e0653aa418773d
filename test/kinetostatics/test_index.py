"""The index, the conditioning length and the margin against the paper and independent oracles."""

import math

import mpmath
import numpy as np
import pytest
from scipy.optimize import minimize

from kinopt_ros.kinetostatics.index import kinetostatic_index
from kinopt_ros.kinetostatics.planar_arm import PlanarArm

SQRT3 = math.sqrt(3.0)
ISOTROPIC_ARM = PlanarArm((1.0, 1.0, SQRT3 / 3.0))
ISOTROPIC_POSTURE = np.radians([0.0, 120.0, 150.0])
EQUILATERAL_ARM = PlanarArm((1.0, 1.0, 1.0))


def random_cases(count, joints=range(3, 13), decades=1.0, seed=1):
    """Arms of all these numbers of joints with a posture each."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        n = joints[i % len(joints)]
        lengths = 10.0 ** rng.uniform(-decades, decades, n)
        yield PlanarArm(lengths), rng.uniform(-np.pi, np.pi, n)


def block_of(arm, angles):
    """Give the two lower rows of the Jacobian from the joint centres' coordinates."""
    absolute = np.cumsum(angles)
    links = np.array(arm.link_lengths) * [np.cos(absolute), np.sin(absolute)]
    points = np.concatenate([np.zeros((2, 1)), np.cumsum(links, axis=1)], axis=1)
    to_tip = points[:, -1:] - points[:, :-1]
    return np.array([-to_tip[1], to_tip[0]])


def half_squared_distance(block, model_block):
    return np.sum((block - model_block) ** 2) / (2.0 * block.shape[1])


def brute_force_z(arm, angles, rng):
    """
    Minimise the paper's distance over isotropic matrices and lengths, blindly.

    Two free vectors are made orthogonal to the ones and to each other and given the norm
    sqrt(n): every K with K K^T = n 1 and a first row of ones has this form.
    """
    n = arm.n_joints
    block = block_of(arm, angles)
    size = np.sqrt(np.sum(block ** 2) / n)

    def model_block(free):
        first, second = free.reshape(2, n)
        first = first - first.mean()
        first = first / np.linalg.norm(first)
        second = second - second.mean()
        second = second - (second @ first) * first
        second = second / np.linalg.norm(second)
        return math.sqrt(n) * np.array([first, second])

    def distance(x):
        return half_squared_distance(x[0] * block / size, model_block(x[1:]))

    # For n = 3 the isotropic matrices are two families, mirror images: start in both.
    starts = [rng.normal(size=(2, n)) for _ in range(2)]
    starts += [start[::-1] for start in starts]
    best = min((minimize(distance, [1.0, *start.ravel()], method='BFGS', options={'gtol': 1e-9})
                for start in starts), key=lambda found: found.fun)
    # A negative factor belongs to the same matrix turned by half a turn.
    return best.fun, size / abs(best.x[0])


def brute_force_margin(block, rng):
    """
    Minimise the distance to matrices that are singular with the first row kept.

    The lower rows of such a matrix have a direction in which they are proportional to the
    ones: c in this direction, anything across it.
    """
    n = block.shape[1]

    def residual(x):
        along = np.array([math.cos(x[0]), math.sin(x[0])])
        across = np.array([-along[1], along[0]])
        return block - np.outer(along, x[1] * np.ones(n)) - np.outer(across, x[2:])

    found = (minimize(lambda x: np.sum(residual(x) ** 2) / n,
                      [start, *rng.normal(size=n + 1)], method='BFGS', options={'gtol': 1e-10})
             for start in np.linspace(0.0, np.pi, 4, endpoint=False))
    return math.sqrt(min(result.fun for result in found))


def test_isotropic_example_of_the_paper():
    index = kinetostatic_index(ISOTROPIC_ARM, ISOTROPIC_POSTURE)
    # "Isotropic Postures": the r_i have the norms 1/sqrt(3), all equal; l = sqrt(6)/6 a.
    assert index.z == pytest.approx(0.0, abs=1e-15)
    assert index.conditioning_length == pytest.approx(math.sqrt(6.0) / 6.0, abs=1e-15)
    assert f'{index.conditioning_length:.4f}' == '0.4082'
    assert index.margin == pytest.approx(1.0, abs=1e-15)


def test_normalised_jacobian_of_the_isotropic_example_has_equal_singular_values():
    index = kinetostatic_index(ISOTROPIC_ARM, ISOTROPIC_POSTURE)
    jacobian = ISOTROPIC_ARM.jacobian(ISOTROPIC_POSTURE)
    jacobian[1:] /= index.conditioning_length
    values = np.linalg.svd(jacobian, compute_uv=False)
    np.testing.assert_allclose(values, SQRT3, atol=1e-14)


def test_normalised_jacobian_of_the_isotropic_example_is_as_printed():
    jacobian = ISOTROPIC_ARM.jacobian(ISOTROPIC_POSTURE)
    jacobian[1:] /= kinetostatic_index(ISOTROPIC_ARM, ISOTROPIC_POSTURE).conditioning_length
    half_root_2, half_root_6 = math.sqrt(2.0) / 2.0, math.sqrt(6.0) / 2.0
    np.testing.assert_allclose(
        jacobian, [[1.0, 1.0, 1.0], [-half_root_2, -half_root_2, 2.0 * half_root_2],
                   [half_root_6, -half_root_6, 0.0]], atol=1e-14)


def test_equilateral_example_of_the_paper_to_all_printed_digits():
    """The posture is printed to a tenth of a degree, too coarse for the matrix: refine it."""
    found = minimize(lambda t: kinetostatic_index(EQUILATERAL_ARM, [0.0, *t]).z,
                     np.radians([81.8, 155.2]), method='Nelder-Mead',
                     options={'xatol': 1e-10, 'fatol': 1e-16})
    assert [f'{angle:.1f}' for angle in np.degrees(found.x)] == ['81.8', '155.2']
    posture = [0.0, *found.x]
    index = kinetostatic_index(EQUILATERAL_ARM, posture)
    assert f'{index.z:.3f}' == '0.178'
    assert f'{index.conditioning_length:.3f}' == '0.563'
    jacobian = EQUILATERAL_ARM.jacobian(posture)
    jacobian[1:] /= index.conditioning_length
    printed = [['1.000', '1.000', '1.000'], ['-0.268', '-0.268', '1.489'],
               ['1.061', '-0.714', '-0.966']]
    # The last digit of the print may be cut off instead of rounded.
    np.testing.assert_allclose(jacobian, np.array(printed, dtype=float), atol=1e-3)
    # At the angles as printed the same two numbers come out.
    coarse = kinetostatic_index(EQUILATERAL_ARM, np.radians([0.0, 81.8, 155.2]))
    assert (f'{coarse.z:.3f}', f'{coarse.conditioning_length:.3f}') == ('0.178', '0.563')


@pytest.mark.parametrize('n', range(3, 13))
def test_brute_force_over_isotropic_matrices_and_lengths(n):
    rng = np.random.default_rng(100 + n)
    for arm, angles in random_cases(2, [n], seed=n):
        index = kinetostatic_index(arm, angles)
        z, length = brute_force_z(arm, angles, rng)
        assert index.z == pytest.approx(z, abs=1e-9)
        assert index.conditioning_length == pytest.approx(length, rel=1e-4)


@pytest.mark.parametrize('n', range(3, 13))
def test_brute_force_over_singular_matrices(n):
    rng = np.random.default_rng(200 + n)
    for arm, angles in random_cases(2, [n], seed=n):
        index = kinetostatic_index(arm, angles)
        block = block_of(arm, angles) / index.conditioning_length
        assert index.margin == pytest.approx(brute_force_margin(block, rng), abs=1e-7)


def test_margin_is_reached_by_a_singular_matrix_with_the_first_row_kept():
    for arm, angles in random_cases(100):
        index = kinetostatic_index(arm, angles)
        block = block_of(arm, angles) / index.conditioning_length
        mean = block.mean(axis=1, keepdims=True)
        left, values, right = np.linalg.svd(block - mean, full_matrices=False)
        step = values[1] * np.outer(left[:, 1], right[1])
        nearest = np.vstack([np.ones(arm.n_joints), block - step])
        assert np.linalg.svd(nearest, compute_uv=False)[2] < 1e-13
        assert math.sqrt(np.sum(step ** 2) / arm.n_joints) == pytest.approx(
            index.margin, abs=1e-13)


def test_scale_of_the_arm():
    for arm, angles in random_cases(60):
        index = kinetostatic_index(arm, angles)
        for scale in (1000.0, 1e-30, 1e30):
            scaled = kinetostatic_index(
                PlanarArm([scale * length for length in arm.link_lengths]), angles)
            assert scaled.z == pytest.approx(index.z, abs=1e-14)
            assert scaled.margin == pytest.approx(index.margin, abs=1e-14)
            assert scaled.conditioning_length == pytest.approx(
                scale * index.conditioning_length, rel=1e-14)


def test_first_angle_does_not_matter():
    for arm, angles in random_cases(60):
        index = kinetostatic_index(arm, angles)
        for first in (-2.0, 0.7, 3.1):
            turned = kinetostatic_index(arm, [first, *angles[1:]])
            np.testing.assert_allclose(turned, index, rtol=1e-12, atol=1e-14)


def test_mirror_image_scores_the_same():
    for arm, angles in random_cases(60):
        np.testing.assert_allclose(
            kinetostatic_index(arm, -angles), kinetostatic_index(arm, angles),
            rtol=1e-12, atol=1e-14)
    mirrored = kinetostatic_index(ISOTROPIC_ARM, -ISOTROPIC_POSTURE)
    assert mirrored.z == pytest.approx(0.0, abs=1e-15)


def test_full_turns_do_not_matter():
    for arm, angles in random_cases(30):
        turned = angles + 2.0 * np.pi * np.arange(arm.n_joints)
        np.testing.assert_allclose(
            kinetostatic_index(arm, turned), kinetostatic_index(arm, angles),
            rtol=1e-10, atol=1e-12)


def singular_postures(count, seed=3):
    """Random arms with all joint centres on a line, the operation point anywhere."""
    rng = np.random.default_rng(seed)
    for arm, angles in random_cases(count, decades=2.0, seed=seed):
        angles[1:-1] = rng.choice([0.0, np.pi, -np.pi], arm.n_joints - 2)
        yield arm, angles


def test_singular_postures_have_no_margin_and_z_of_at_least_one_half():
    least = 1.0
    for arm, angles in singular_postures(1000):
        index = kinetostatic_index(arm, angles)
        assert index.z >= 0.5 - 1e-13
        assert 0.0 <= index.margin < 1e-12
        assert np.linalg.matrix_rank(arm.jacobian(angles) / arm.longest_link, tol=1e-12) < 3
        least = min(least, index.z)
    assert least < 0.55


def test_equal_links_reach_the_bound_of_one_half():
    # Stretched, P above the middle joint's neighbour: |a_n - rho| = 0 for a_n = rho = 1.
    index = kinetostatic_index(EQUILATERAL_ARM, [0.3, 0.0, np.pi])
    assert index.z == pytest.approx(0.5, abs=1e-15)
    assert index.margin < 1e-15


def test_margin_is_at_most_1_minus_z():
    for arm, angles in random_cases(3000, decades=2.0):
        index = kinetostatic_index(arm, angles)
        assert 0.0 <= index.z < 1.0
        assert 0.0 <= index.margin <= 1.0 - index.z + 1e-15
        assert index.conditioning_length > 0.0
        if index.z < 0.5 - 1e-12:
            assert index.margin > 0.0


def test_z_of_the_conditioning_length():
    """Eq. "z-l_P": z = 1 - (1/2) (d_rms / l_P)^2."""
    for arm, angles in random_cases(100):
        index = kinetostatic_index(arm, angles)
        ratio = arm.rms_distance(angles) / index.conditioning_length
        assert index.z == pytest.approx(1.0 - 0.5 * ratio ** 2, abs=1e-13)


def test_conditioning_length_at_singular_postures():
    for arm, angles in singular_postures(50):
        block = block_of(arm, angles)
        spread = np.linalg.norm(block - block.mean(axis=1, keepdims=True), 2)
        assert kinetostatic_index(arm, angles).conditioning_length == pytest.approx(
            np.sum(block ** 2) / (math.sqrt(arm.n_joints) * spread), rel=1e-12)


@pytest.mark.parametrize('n', [3, 4, 7, 30])
@pytest.mark.parametrize('shape', [(1,), (5,), (2, 3), (0,), (4, 0, 2)])
def test_batch_equals_single(n, shape):
    rng = np.random.default_rng(7)
    arm = PlanarArm(rng.uniform(0.1, 2.0, n))
    postures = rng.uniform(-9.0, 9.0, (*shape, n))
    batch = kinetostatic_index(arm, postures)
    for values, position in zip(batch, range(3)):
        assert values.shape == shape
        for where in np.ndindex(shape):
            single = kinetostatic_index(arm, postures[where])
            assert values[where] == pytest.approx(single[position], rel=1e-13, abs=1e-14)


def test_large_batch_equals_single():
    rng = np.random.default_rng(8)
    postures = rng.uniform(-np.pi, np.pi, (20_000, 3))
    batch = kinetostatic_index(ISOTROPIC_ARM, postures)
    for i in (0, 8191, 8192, 16383, 16384, 19_999):
        np.testing.assert_allclose([values[i] for values in batch],
                                   kinetostatic_index(ISOTROPIC_ARM, postures[i]), rtol=1e-13)


@pytest.mark.parametrize('convert', [list, tuple, np.array, lambda a: np.array(a, dtype=object)])
def test_single_posture_gives_plain_floats(convert):
    index = kinetostatic_index(ISOTROPIC_ARM, convert([0.1, 1.0, 2.0]))
    assert [type(value) for value in index] == [float, float, float]


def test_integers_are_angles_too():
    np.testing.assert_array_equal(kinetostatic_index(ISOTROPIC_ARM, [0, 1, 2]),
                                  kinetostatic_index(ISOTROPIC_ARM, [0.0, 1.0, 2.0]))


@pytest.mark.parametrize('angles, words', [
    ([0.0, 1.0], ['joint_angles', '(2,)', '3']),
    ([0.0, 1.0, 2.0, 3.0], ['joint_angles', '(4,)', '3']),
    (1.0, ['joint_angles', '()', '3']),
    (np.zeros((3, 2)), ['joint_angles', '(3, 2)', '3']),
    ([], ['joint_angles', '(0,)', '3']),
    ([0.0, math.nan, 1.0], ['joint_angles', '[1]', 'nan', 'finite']),
    ([0.0, 1.0, math.inf], ['joint_angles', '[2]', 'inf', 'finite']),
    ([math.inf, -math.inf, 0.0], ['joint_angles', '[0]', 'inf', 'finite']),
    ([[0.0, 0.0, 0.0], [0.0, -math.inf, 0.0]], ['joint_angles', '[1, 1]', '-inf', 'finite']),
    (['a', 'b', 'c'], ['joint_angles', 'numbers']),
    (None, ['joint_angles']),
    ([1j, 0.0, 0.0], ['joint_angles', 'real']),
    ([[0.0, 1.0], [1.0], [2.0]], ['joint_angles']),
    ([None, 0.0, 1.0], ['joint_angles']),
    ([10 ** 400, 0.0, 1.0], ['joint_angles']),
])
def test_bad_joint_angles(angles, words):
    with pytest.raises(ValueError) as error:
        kinetostatic_index(ISOTROPIC_ARM, angles)
    for word in words:
        assert word in str(error.value)


def exact_index(arm, angles, digits=60):
    """Evaluate z, l_P and margin with P and Q of the centred vectors, to many digits."""
    with mpmath.workdps(digits):
        n = arm.n_joints
        phi, vectors = mpmath.mpf(0), []
        links = []
        for length, angle in zip(arm.link_lengths, angles):
            phi += mpmath.mpf(float(angle))
            links.append(mpmath.mpf(length) * mpmath.expj(phi))
        for i in range(n):
            vectors.append(mpmath.fsum(links[i:]))
        mean = mpmath.fsum(vectors) / n
        r = mpmath.fsum(abs(v) ** 2 for v in vectors)
        p = mpmath.fsum(abs(v - mean) ** 2 for v in vectors)
        q = abs(mpmath.fsum((v - mean) ** 2 for v in vectors))
        s1, s2 = mpmath.sqrt((p + q) / 2), mpmath.sqrt(abs(p - q) / 2)
        return (1 - (s1 + s2) ** 2 / (2 * r), r / (mpmath.sqrt(n) * (s1 + s2)),
                s2 * (s1 + s2) / r)


def assert_exact(arm, angles, tolerance):
    for index in (kinetostatic_index(arm, angles),
                  [values[0] for values in kinetostatic_index(arm, np.array([angles]))]):
        z, length, margin = exact_index(arm, angles)
        assert abs(index[0] - z) < tolerance
        assert abs(index[1] / length - 1) < tolerance
        assert abs(index[2] - margin) < tolerance


def test_links_of_very_different_lengths():
    for arm, angles in random_cases(200, decades=6.0, seed=11):
        assert_exact(arm, angles, 1e-13)


def test_largest_ratios_of_lengths():
    for lengths in ([1e50, 1e-50, 1e-50], [1e-50, 1e50, 1e-50], [1e-50, 1e-50, 1e50],
                    [1e-50, 1e-50, 1e-50], [1e50, 1e50, 1e50]):
        index = kinetostatic_index(PlanarArm(lengths), [0.3, 1.0, 2.0])
        assert all(math.isfinite(value) for value in index)
        z, length, margin = exact_index(PlanarArm(lengths), [0.3, 1.0, 2.0], digits=300)
        assert abs(index.z - z) < 1e-13
        assert abs(index.conditioning_length / length - 1) < 1e-13
        assert abs(index.margin - margin) < 1e-13


@pytest.mark.parametrize('n', [12, 50, 200])
def test_many_joints(n):
    for arm, angles in random_cases(4, [n], seed=n):
        assert_exact(arm, angles, 1e-12)
    assert_exact(PlanarArm([1.0] * n), [0.5] * n, 1e-12)


def test_angles_of_many_turns():
    rng = np.random.default_rng(13)
    for arm, _ in random_cases(50, seed=13):
        assert_exact(arm, rng.uniform(-1e6, 1e6, arm.n_joints), 1e-13)


def test_digits_near_a_singularity():
    """The margin keeps relative digits where it is small, down to the angle's own rounding."""
    for arm, angles in random_cases(100, seed=14):
        for bend in (1e-3, 1e-6, 1e-9):
            angles[1:-1] = bend
            margin = exact_index(arm, angles)[2]
            assert kinetostatic_index(arm, angles).margin == pytest.approx(
                float(margin), rel=1e-12, abs=1e-15)


@pytest.mark.parametrize('n', [3, 10, 200])
def test_everything_at_once(n):
    """Losses that each of the tests above sees alone could still add up."""
    rng = np.random.default_rng(15 + n)
    for arm, _ in random_cases(10, [n], decades=6.0, seed=n):
        assert_exact(arm, rng.uniform(-1e6, 1e6, n), 1e-12)


@pytest.mark.parametrize('turns', [[0.0], [0.0, np.pi, -np.pi]])
@pytest.mark.parametrize('decades', [3.0, 6.0])
def test_many_links_of_very_different_lengths_in_a_line(decades, turns):
    """Rounding must not open a margin: it would be a false all-clear."""
    rng = np.random.default_rng(16)
    for arm, angles in random_cases(20, [200], decades=decades, seed=16):
        angles[1:] = rng.choice(turns, 199)
        for margin in (kinetostatic_index(arm, angles).margin,
                       kinetostatic_index(arm, angles[np.newaxis]).margin[0]):
            assert 0.0 <= margin < 1e-12
