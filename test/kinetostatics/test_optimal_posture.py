"""The optimal posture against the paper, brute force with SciPy, and dense grids."""

from concurrent.futures import ThreadPoolExecutor
import math

import numpy as np
import pytest
from scipy.optimize import minimize

from kinopt_ros.kinetostatics.certificate import certified_lower_bound
from kinopt_ros.kinetostatics.gradient import index_gradient
from kinopt_ros.kinetostatics.hessian import index_expansion
from kinopt_ros.kinetostatics.index import kinetostatic_index
from kinopt_ros.kinetostatics.optimal_posture import optimal_posture
from kinopt_ros.kinetostatics.planar_arm import PlanarArm
from kinopt_ros.kinetostatics.posture_record import optimal_posture_record

FREE = math.inf


def random_lengths(rng, n):
    """Link lengths over two decades."""
    return 10.0 ** rng.uniform(-1.0, 1.0, n)


def index_by_cauchy_binet(lengths, angles):
    """Index z of postures along the last axis, by another way than the package's."""
    links = lengths * np.exp(1j * np.cumsum(angles, axis=-1))
    vectors = np.cumsum(links[..., ::-1], axis=-1)
    r_squared = np.sum(np.abs(vectors) ** 2, axis=-1)
    centred = vectors - vectors.mean(axis=-1, keepdims=True)
    trace = np.sum(np.abs(centred) ** 2, axis=-1)
    determinant = 0.25 * (trace ** 2 - np.abs(np.sum(centred ** 2, axis=-1)) ** 2)
    return 1.0 - (trace + 2.0 * np.sqrt(np.maximum(determinant, 0.0))) / (2.0 * r_squared)


def polished(lengths, starts, bounds=None):
    """Least z that SciPy reaches from the given starts."""
    arm = PlanarArm(lengths)

    def objective(angles):
        return kinetostatic_index(arm, angles).z, index_gradient(arm, angles).z

    return min(minimize(objective, start, jac=True, method='L-BFGS-B', bounds=bounds,
                        options={'ftol': 1e-15, 'gtol': 1e-10}).fun for start in starts)


def brute_force(rng, lengths, lower=-math.pi, upper=math.pi, samples=3000, starts=6):
    """Least z over the best of many random postures, each polished."""
    postures = rng.uniform(lower, upper, (samples, len(lengths)))
    best = np.argsort(index_by_cauchy_binet(lengths, postures))[:starts]
    bounds = None
    if np.ndim(lower):
        bounds = list(zip(lower, upper))
    return polished(lengths, postures[best], bounds)


def assert_consistent(posture, lengths):
    """Check that what is reported is what the posture scores."""
    index = kinetostatic_index(PlanarArm(lengths), posture.joint_angles)
    assert posture.z == pytest.approx(index.z, abs=1e-14)
    assert posture.margin == pytest.approx(index.margin, abs=1e-13)
    assert posture.characteristic_length == pytest.approx(index.conditioning_length, rel=1e-13)
    assert posture.converged


def test_isotropic_arm_of_the_paper():
    posture = optimal_posture((1.0, 1.0, math.sqrt(3.0) / 3.0))
    assert posture.z == pytest.approx(0.0, abs=1e-12)
    assert posture.isotropic
    assert posture.lower_bound == 0.0
    assert posture.characteristic_length == pytest.approx(math.sqrt(6.0) / 6.0, abs=1e-7)
    assert posture.margin == pytest.approx(1.0, abs=1e-7)
    np.testing.assert_allclose(np.degrees(posture.joint_angles), [0.0, 120.0, 150.0], atol=1e-5)
    mirror, = posture.alternatives
    np.testing.assert_allclose(np.degrees(mirror.joint_angles), [0.0, -120.0, -150.0], atol=1e-5)


def test_equilateral_arm_of_the_paper():
    posture = optimal_posture((1.0, 1.0, 1.0))
    assert round(posture.z, 3) == 0.178
    assert not posture.isotropic
    assert round(posture.characteristic_length, 3) == 0.563
    np.testing.assert_allclose(np.degrees(posture.joint_angles), [0.0, 81.8, 155.2], atol=0.05)


@pytest.mark.parametrize('n', [3, 5, 12])
def test_second_derivatives_against_differences_of_the_gradient(n):
    rng = np.random.default_rng(50 + n)
    arm = PlanarArm(random_lengths(rng, n))
    postures = rng.uniform(-math.pi, math.pi, (6, n))
    postures[:, 0] = 0.0
    expansion = index_expansion(arm, postures[:, 1:])
    np.testing.assert_allclose(expansion.z, kinetostatic_index(arm, postures).z, atol=1e-14)
    gradient = index_gradient(arm, postures).z
    np.testing.assert_allclose(expansion.gradient, gradient[:, 1:], atol=1e-13)
    step = 1e-5 * np.eye(n)[1:]
    ahead = index_gradient(arm, postures[:, None] + step).z
    behind = index_gradient(arm, postures[:, None] - step).z
    np.testing.assert_allclose(
        expansion.hessian, (ahead - behind)[:, :, 1:] / 2e-5, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize('n', [3, 4, 5, 6])
def test_agrees_with_brute_force_on_random_arms(n):
    rng = np.random.default_rng(100 + n)
    arms, misses, reference_misses = 80, 0, 0
    for _ in range(arms):
        lengths = random_lengths(rng, n)
        posture = optimal_posture(lengths)
        assert_consistent(posture, lengths)
        reference = brute_force(rng, lengths)
        misses += posture.z > reference + 1e-7
        reference_misses += reference > posture.z + 1e-7
    print(f'n = {n}: {misses} of {arms} missed, brute force itself missed {reference_misses}')
    assert misses == 0
    # The reference would be of no use if it seldom got there.
    assert reference_misses <= arms // 20


@pytest.mark.parametrize('n, grid', [(3, 360), (4, 48)])
def test_agrees_with_a_dense_grid_and_certificate_holds(n, grid):
    rng = np.random.default_rng(200 + n)
    axis = np.linspace(-math.pi, math.pi, grid, endpoint=False)
    half = axis[axis >= 0.0]
    mesh = np.meshgrid([0.0], half, *[axis] * (n - 2), indexing='ij')
    postures = np.stack([angles.ravel() for angles in mesh], axis=-1)
    for _ in range(12):
        lengths = random_lengths(rng, n)
        posture = optimal_posture(lengths)
        z = index_by_cauchy_binet(lengths, postures)
        reference = polished(lengths, postures[np.argsort(z)[:5]])
        assert posture.z == pytest.approx(reference, abs=1e-7)
        assert posture.lower_bound <= min(reference, z.min())
        assert posture.z - posture.lower_bound < 1.1e-9


@pytest.mark.parametrize('n', [3, 4, 5])
@pytest.mark.parametrize('limited', [False, True])
def test_certificate_never_certifies_what_is_not_so(n, limited):
    rng = np.random.default_rng(300 + n)
    for _ in range(10 if n < 5 else 2):
        lengths = random_lengths(rng, n)
        lower, upper = np.full(n, -FREE), np.full(n, FREE)
        if limited:
            lower = rng.uniform(-math.pi, 2.0, n)
            upper = lower + rng.uniform(0.1, 2.0, n)
        true = optimal_posture(lengths, lower, upper, certify=False).z
        # A claim a little too high must not be confirmed, a little too low one must be.
        for excess in (1e-2, 1e-6):
            bound = certified_lower_bound(
                PlanarArm(lengths), lower[1:], upper[1:], true + excess)
            assert bound <= true
        bound = certified_lower_bound(PlanarArm(lengths), lower[1:], upper[1:], true - 1e-3)
        assert bound == pytest.approx(max(0.0, true - 1e-3), abs=1e-8)


@pytest.mark.parametrize('n', [3, 4, 5, 6])
def test_optimum_within_limits_agrees_with_brute_force(n):
    rng = np.random.default_rng(400 + n)
    arms, on_boundary = 25, 0
    for _ in range(arms):
        lengths = random_lengths(rng, n)
        lower = rng.uniform(-math.pi, 1.0, n)
        upper = lower + rng.uniform(0.0, 3.0, n)
        posture = optimal_posture(lengths, lower, upper)
        assert_consistent(posture, lengths)
        assert np.all(posture.joint_angles >= lower) and np.all(posture.joint_angles <= upper)
        for alternative in posture.alternatives:
            assert np.all(alternative.joint_angles >= lower)
            assert np.all(alternative.joint_angles <= upper)
        assert posture.z <= brute_force(rng, lengths, lower, upper, 2000, 4) + 1e-7
        on_boundary += np.isin(posture.joint_angles[1:], [*lower, *upper]).any()
        if n <= 4:
            assert posture.z - posture.lower_bound < 1.1e-9
    assert on_boundary > arms // 4


def test_limits_around_the_optimum_do_not_change_it():
    lengths = (1.0, 0.6, 0.8, 0.4)
    free = optimal_posture(lengths)
    angles = np.array(free.joint_angles)
    limited = optimal_posture(lengths, angles - 0.3, angles + 0.4)
    np.testing.assert_allclose(limited.joint_angles, angles, atol=1e-8)


def test_a_box_of_one_posture():
    posture = optimal_posture((1.0, 1.0, 1.0), [0.5, 0.3, -2.0], [0.5, 0.3, -2.0])
    assert posture.joint_angles == (0.5, 0.3, -2.0)
    assert posture.z == pytest.approx(
        kinetostatic_index(PlanarArm((1.0, 1.0, 1.0)), [0.5, 0.3, -2.0]).z)
    assert posture.alternatives == ()
    # The stretched posture too, where z has its crease.
    stretched = optimal_posture((1.0, 1.0, 1.0), [0.0] * 3, [0.0] * 3)
    assert stretched.joint_angles == (0.0, 0.0, 0.0)
    assert stretched.margin == 0.0


def test_limits_more_than_a_turn_apart_or_away_from_zero_choose_the_turn():
    free = np.array(optimal_posture((1.0, 1.0, 1.0)).joint_angles)
    turn = 2.0 * math.pi
    wide = optimal_posture((1.0, 1.0, 1.0), [-9.0] * 3, [9.0] * 3)
    np.testing.assert_allclose(wide.joint_angles, free, atol=1e-8)
    shifted = optimal_posture((1.0, 1.0, 1.0), [1.0, 6.0, -FREE], [2.0, 9.0, -3.2])
    np.testing.assert_allclose(
        shifted.joint_angles, [1.0, free[1] + turn, free[2] - turn], atol=1e-8)
    near = optimal_posture((1.0, 1.0, 1.0), [-FREE] * 3, [FREE] * 3, [0.0, 13.0, 14.0])
    np.testing.assert_allclose(
        near.joint_angles, [0.0, free[1] + 2.0 * turn, free[2] + 2.0 * turn], atol=1e-8)


def test_mirror_image_only_where_the_limits_admit_it():
    lengths = (1.0, 1.0, 1.0)
    posture = optimal_posture(lengths, [-FREE, -FREE, -FREE], [FREE, 0.0, FREE])
    assert posture.joint_angles[1] == pytest.approx(-math.radians(81.83320989), abs=1e-8)
    assert all(a.joint_angles[1] <= 0.0 for a in posture.alternatives)


@pytest.mark.parametrize('lower, upper, reference, message', [
    ([0.0, 1.0, 0.0], [1.0, 0.5, 1.0], None, r'joint 2.*lower\[1\] = 1.0.*upper\[1\] = 0.5'),
    ([0.0, FREE, 0.0], [1.0, FREE, 1.0], None, r'joint 2.*lower\[1\] = inf'),
    ([0.0, math.nan, 0.0], None, None, r'lower\[1\] = nan'),
    ([0.0, 0.0], None, None, r'lower has shape \(2,\)'),
    (None, 'abc', None, r"upper = 'abc'"),
    (None, None, [0.0, 0.0, FREE], r'reference\[2\] = inf'),
    (None, None, [0.0, 0.0], r'reference has shape \(2,\)'),
])
def test_bad_limits_and_references_are_refused(lower, upper, reference, message):
    with pytest.raises(ValueError, match=message):
        optimal_posture((1.0, 1.0, 1.0), lower, upper, reference)


def test_bad_link_lengths_are_refused():
    with pytest.raises(ValueError, match='link_lengths'):
        optimal_posture((1.0, 1.0))
    with pytest.raises(ValueError, match='link_lengths'):
        optimal_posture((1.0, -1.0, 1.0))


def test_reference_chooses_the_mirror_image_and_keeps_theta_1():
    lengths = (1.0, 1.0, 1.0)
    up = optimal_posture(lengths, reference=[0.7, 0.5, 0.5])
    down = optimal_posture(lengths, reference=[0.7, -0.5, -0.5])
    assert up.joint_angles[0] == down.joint_angles[0] == 0.7
    np.testing.assert_allclose(down.joint_angles[1:], [-a for a in up.joint_angles[1:]])
    assert up.joint_angles[1] > 0.0
    # Nearest on the circle: 210 degrees is next to -155, not to 155.
    around = optimal_posture(lengths, reference=[0.0, -1.5, math.radians(210.0)])
    assert around.joint_angles[1] < 0.0
    clipped = optimal_posture(lengths, [0.0] * 3, [1.0, 3.0, 3.0], reference=[4.0, 1.0, 1.0])
    assert clipped.joint_angles[0] == 1.0


def nearest_isotropic(rng, lengths, reference, bounds=None):
    """Least distance from the reference of a posture with z = 0, by SciPy's SLSQP."""
    lengths = np.asarray(lengths)

    def isotropy(angles):
        links = lengths * np.exp(1j * np.cumsum([0.0, *angles]))
        vectors = np.cumsum(links[::-1])
        sums = [vectors.mean(), np.sum((vectors - vectors.mean()) ** 2)]
        return [part for s in sums for part in (s.real, s.imag)]

    best = math.inf
    for spread in (0.0, 0.3, 0.3, 0.6, 0.6, 1.0, 1.0, 1.5, 1.5, 2.0):
        start = reference[1:] + spread * rng.normal(size=len(reference) - 1)
        if bounds is not None:
            start = np.clip(start, *np.array(bounds).T)
        found = minimize(lambda x: np.sum((x - reference[1:]) ** 2), start, method='SLSQP',
                         jac=lambda x: 2.0 * (x - reference[1:]), bounds=bounds,
                         constraints={'type': 'eq', 'fun': isotropy},
                         options={'ftol': 1e-12, 'maxiter': 300})
        if np.abs(isotropy(found.x)).max() < 1e-9:
            best = min(best, math.sqrt(found.fun))
    return best


@pytest.mark.parametrize('n', [6, 7, 9])
@pytest.mark.parametrize('limited', [False, True])
def test_nearest_member_of_a_continuous_family(n, limited):
    rng = np.random.default_rng(500 + n)
    far = 0
    for _ in range(6):
        lengths = rng.uniform(0.5, 1.0, n)
        reference = rng.uniform(-1.5, 1.5, n)
        lower = upper = bounds = None
        if limited:
            lower, upper = reference - 1.2, reference + 0.8
            bounds = list(zip(lower[1:], upper[1:]))
        posture = optimal_posture(lengths, lower, upper, reference)
        if not posture.isotropic:
            continue
        apart = np.array(posture.joint_angles) - reference
        if not limited:
            apart = np.angle(np.exp(1j * apart))
        distance = np.linalg.norm(apart)
        far += distance > nearest_isotropic(rng, lengths, reference, bounds) + 1e-4
    assert far == 0


def test_same_answer_every_time_and_in_threads():
    arms = [random_lengths(np.random.default_rng(seed), 3 + seed % 5) for seed in range(10)]
    first = [optimal_posture(lengths) for lengths in arms]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(optimal_posture, arms)) == first


@pytest.mark.parametrize('scale', [1e-9, 1e3, 1e40])
def test_size_of_the_arm_does_not_matter(scale):
    lengths = np.array([0.425, 0.39225, 0.09465])
    posture, scaled = optimal_posture(lengths), optimal_posture(scale * lengths)
    np.testing.assert_allclose(scaled.joint_angles, posture.joint_angles, atol=1e-8)
    assert scaled.z == pytest.approx(posture.z, abs=1e-14)
    assert scaled.characteristic_length == pytest.approx(
        scale * posture.characteristic_length, rel=1e-12)


def test_alternatives_are_the_other_local_optima_in_order():
    rng = np.random.default_rng(600)
    local = 0
    for _ in range(30):
        lengths = random_lengths(rng, 5)
        posture = optimal_posture(lengths, reference=[0.3, 0.0, 0.0, 0.0, 0.0])
        arm = PlanarArm(lengths)
        z = [posture.z] + [alternative.z for alternative in posture.alternatives]
        assert np.all(np.diff(z) > -1e-9)
        angles = np.array([posture.joint_angles, *(
            alternative.joint_angles for alternative in posture.alternatives)])
        assert np.all(angles[:, 0] == 0.3)
        assert np.all(angles[:, 1:] > -math.pi) and np.all(angles[:, 1:] <= math.pi)
        np.testing.assert_allclose(index_gradient(arm, angles).z, 0.0, atol=1e-9)
        unit = np.exp(1j * angles[:, 1:])
        apart = np.abs(unit[:, None] - unit[None]).max(axis=2) + 10.0 * np.eye(len(unit))
        assert apart.min() > 5e-6
        mirrored = np.abs(unit[:, None] - unit.conj()[None]).max(axis=2)
        assert mirrored.min(axis=1).max() < 1e-6
        # Minima, not saddles: nothing around them scores less.
        around = angles[:, None] + 1e-3 * rng.normal(size=(1, 200, 5))
        assert np.all(kinetostatic_index(arm, around).z >= np.array(z)[:, None] - 1e-12)
        local += z[-1] > z[0] + 1e-6
    assert local > 0


def test_model_set_and_conditioning_circle_belong_to_the_posture():
    lengths = (0.5, 0.9, 0.4, 0.2)
    posture = optimal_posture(lengths)
    model = np.array(posture.model_set)
    assert np.abs(model.sum()) < 1e-12
    assert np.abs((model ** 2).sum()) < 1e-12
    links = np.array(lengths) * np.exp(1j * np.cumsum(posture.joint_angles))
    vectors = np.cumsum(links[::-1])[::-1]
    assert posture.circle_radius == pytest.approx(abs(vectors[0]), rel=1e-12)
    distance = np.sum(np.abs(vectors / posture.characteristic_length - model) ** 2)
    assert 0.5 * distance / 4 == pytest.approx(posture.z, abs=1e-12)


def test_many_joints():
    posture = optimal_posture(np.ones(40))
    assert posture.isotropic
    assert posture.converged
    assert posture.lower_bound == 0.0
    assert_consistent(posture, np.ones(40))


@pytest.mark.parametrize('lengths', [
    (1.0, 1e-3, 1.0), (1e-3, 1.0, 1.0), (1.0, 1.0, 1e-3), (1.0, 1e-9, 1e-3, 1.0),
    (1e-3, 1e-3, 1e-3, 1e-3, 1.0)])
def test_very_uneven_arms(lengths):
    rng = np.random.default_rng(700)
    posture = optimal_posture(lengths)
    assert np.all(np.isfinite(posture.joint_angles))
    assert posture.z == pytest.approx(brute_force(rng, np.array(lengths)), abs=1e-7)


def test_record_has_exactly_the_documented_keys():
    posture = optimal_posture((1.0, 1.0, 1.0))
    record = optimal_posture_record(
        ('a', 'b', 'c'), posture, lambda angles: -np.array(angles))
    assert list(record) == ['joint_names', 'joint_positions', 'link_lengths', 'z',
                            'characteristic_length', 'margin', 'isotropic', 'alternatives']
    assert record['joint_names'] == ['a', 'b', 'c']
    assert record['joint_positions'] == [-angle for angle in posture.joint_angles]
    assert [set(alternative) for alternative in record['alternatives']] == [
        {'joint_positions', 'z'}]
    assert record['alternatives'][0]['joint_positions'][1] == -posture.alternatives[
        0].joint_angles[1]
