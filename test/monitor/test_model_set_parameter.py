"""The model set as a parameter of the node, against the paper's own formulas; and z_max = -1."""

import itertools
import math

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from support import assert_numbers, expected_numbers, LENGTHS, Numbers, parameter_values, REGULAR

from kinopt_ros.kinetostatics.planar_arm import PlanarArm
from kinopt_ros.kinetostatics.singular_postures import critical_posture
from kinopt_ros.monitor.configuration import Configuration
from kinopt_ros.monitor.posture_monitor import PostureMonitor

FOUR = {'joint_names': ['a', 'b', 'c', 'd'], 'link_lengths': [0.7, 0.5, 0.4, 0.3]}
MIRROR_OF_ISOTROPIC = [0.0, -2.0 * math.pi / 3.0, -5.0 * math.pi / 6.0]


def against_polygon(lengths, angles, numbering=None, mirror=False):
    """
    Compute the three numbers against a polygon by the paper's definition of z.

    z = tr((J - K)(J - K)^T) / (2 n) with the Jacobian normalised by l, minimised over the
    rotation of K numerically, and over l by its normality condition.
    """
    n = len(lengths)
    vertices = np.array(numbering or range(n))
    absolute = np.cumsum(angles)
    steps = np.array(lengths) * np.exp(1j * absolute)
    vectors = np.array([steps[i:].sum() for i in range(n)])
    block = np.array([(1j * vectors).real, (1j * vectors).imag])
    jacobian_size = np.sum(block ** 2)

    def z_at(alpha, sign):
        k = math.sqrt(2.0) * np.exp(1j * (sign * 2.0 * math.pi * vertices / n + alpha))
        model = np.array([(1j * k).real, (1j * k).imag])
        reciprocal = max(np.sum(model * block) / jacobian_size, 0.0)
        difference = reciprocal * block - model
        return np.sum(difference ** 2) / (2.0 * n), reciprocal

    best = None
    for sign in ((1, -1) if mirror else (1,)):
        grid = np.linspace(-math.pi, math.pi, 73)
        start = min(grid, key=lambda a, sign=sign: z_at(a, sign)[0])
        found = minimize_scalar(lambda a, sign=sign: z_at(a, sign)[0],
                                bounds=(start - 0.1, start + 0.1), method='bounded',
                                options={'xatol': 1e-11})
        candidate = z_at(found.x, sign)
        if best is None or candidate[0] < best[0]:
            best = candidate
    z, reciprocal = best
    centred = block - block.mean(axis=1, keepdims=True)
    smallest = np.linalg.svd(centred, compute_uv=False)[1]
    return Numbers(z, 1.0 / reciprocal, reciprocal * smallest / math.sqrt(n))


POSTURES = [[0.3, 1.5, 2.0, -0.4], [-1.0, 0.8, -2.2, 1.9], [2.0, -1.2, -1.0, -0.7]]


@pytest.mark.parametrize('numbering', [None, [0, 1, 2, 3], [0, 2, 1, 3], [3, 1, 0, 2]])
@pytest.mark.parametrize('mirror', [False, True])
def test_polygon_in_a_numbering_by_the_paper(make_bench, numbering, mirror):
    bench = make_bench({**FOUR, 'model_set': 'polygon', 'model_numbering': numbering,
                        'model_mirror': mirror})
    for positions in POSTURES:
        numbers, _ = bench.cycle(positions, FOUR['joint_names'])
        expected = against_polygon(FOUR['link_lengths'], positions, numbering, mirror)
        assert_numbers(numbers, expected, 1e-7)
        closest = expected_numbers(FOUR['link_lengths'], positions)
        assert numbers.z >= closest.z - 1e-12


def test_numberings_and_the_mirror_matter():
    """Otherwise the test above would pass whatever the parameters do."""
    values = {against_polygon(FOUR['link_lengths'], posture, numbering, mirror).z
              for posture in POSTURES for numbering in ([0, 1, 2, 3], [0, 2, 1, 3], [3, 1, 0, 2])
              for mirror in (False, True)}
    assert len({round(value, 6) for value in values}) >= 10


def test_triangle_is_right_side_up_by_the_paper(make_bench):
    """Isotropic at (0, 120, 150) degrees; its mirror image is the worst there is, z = 1."""
    bench = make_bench({'model_set': 'polygon', 'z_max': 0.9})
    numbers, flag = bench.cycle([0.4, 2.0 * math.pi / 3.0, 5.0 * math.pi / 6.0])
    assert_numbers(numbers, (0.0, math.sqrt(6.0) / 6.0, 1.0), 1e-7)
    assert flag is False
    numbers, flag = bench.cycle(MIRROR_OF_ISOTROPIC)
    assert numbers.z == pytest.approx(1.0, abs=1e-9)
    assert flag is True
    assert bench.set(model_mirror=True)[0].successful
    numbers, flag = bench.cycle(MIRROR_OF_ISOTROPIC)
    assert_numbers(numbers, (0.0, math.sqrt(6.0) / 6.0, 1.0), 1e-7)


def test_closest_is_the_default_and_ignores_numbering_and_mirror(bench):
    assert bench.get('model_set') == 'closest'
    assert bench.get('model_mirror') is False
    expected = expected_numbers(LENGTHS, REGULAR)
    assert_numbers(bench.cycle(REGULAR)[0], expected)
    assert bench.set_atomically(model_numbering=[2, 0, 1], model_mirror=True).successful
    assert_numbers(bench.cycle(REGULAR)[0], expected)
    mirror = expected_numbers(LENGTHS, MIRROR_OF_ISOTROPIC)
    assert_numbers(bench.cycle(MIRROR_OF_ISOTROPIC)[0], mirror, 1e-7)
    assert mirror.z == pytest.approx(0.0, abs=1e-9)


def test_for_three_joints_the_mirrored_triangle_is_the_closest_set(make_bench):
    bench = make_bench({'model_set': 'polygon', 'model_mirror': True})
    for positions in ([0.1, 1.0, 0.5], [0.0, -1.0, 2.0], [1.0, 2.5, -2.8]):
        assert_numbers(bench.cycle(positions)[0], expected_numbers(LENGTHS, positions), 1e-8)


def test_switched_by_the_parameter_service(bench):
    posture = [0.3, -1.5, -2.0]
    assert bench.set(model_set='polygon')[0].successful
    assert_numbers(bench.cycle(posture)[0], against_polygon(LENGTHS, posture), 1e-7)
    assert bench.set(model_numbering=[0, 2, 1])[0].successful
    assert_numbers(bench.cycle(posture)[0], against_polygon(LENGTHS, posture, [0, 2, 1]), 1e-7)
    assert bench.set(model_set='closest')[0].successful
    assert_numbers(bench.cycle(posture)[0], expected_numbers(LENGTHS, posture))


@pytest.mark.parametrize('change, words', [
    ({'model_set': 'triangle'}, ['model_set', 'triangle', 'polygon']),
    ({'model_set': ''}, ['model_set']),
    ({'model_set': 'polygon', 'model_numbering': [0, 1]}, ['model_numbering', '[0, 1]']),
    ({'model_set': 'polygon', 'model_numbering': [0, 0, 1]}, ['model_numbering', '[0, 0, 1]']),
    ({'model_set': 'polygon', 'model_numbering': [1, 2, 3]}, ['model_numbering', '[1, 2, 3]']),
    ({'model_set': 'polygon', 'model_numbering': [0, 1, -1]}, ['model_numbering', '-1']),
])
def test_refusals(bench, change, words):
    result = bench.set_atomically(**change)
    assert not result.successful
    for word in words:
        assert word in result.reason, result.reason
    assert bench.get('model_set') == 'closest'
    assert_numbers(bench.cycle(REGULAR)[0], expected_numbers(LENGTHS, REGULAR))


# --- z_max = -1 -----------------------------------------------------------------------------


def least_singular_z(lengths):
    """Least z over the arms folded flat: all sign patterns of the paper's collinear postures."""
    # Stretched and folded links cover the singular postures whose joint centres are collinear,
    # but for the last joint, which may have any angle: there the optimum is sampled.
    best = 1.0
    for folds in itertools.product([0.0, math.pi], repeat=len(lengths) - 2):
        def z_at(last, folds=folds):
            return expected_numbers(lengths, [0.0, *folds, last]).z
        start = min(np.linspace(-math.pi, math.pi, 41), key=z_at)
        best = min(best, minimize_scalar(
            z_at, bounds=(start - 0.2, start + 0.2), method='bounded').fun, z_at(start))
    return best


@pytest.mark.parametrize('lengths, printed', [
    (LENGTHS, 0.60566), ([0.425, 0.39225, 0.09465], 0.50836), ([0.6, 0.7, 0.3, 0.2], None)])
def test_z_max_of_minus_one_is_z_crit(make_bench, lengths, printed):
    names = [f'joint_{i}' for i in range(len(lengths))]
    bench = make_bench({'joint_names': names, 'link_lengths': lengths, 'z_max': -1.0})
    bench.cycle([0.3] * len(lengths), names)
    bench.wait(lambda: bench.diagnostics, 'diagnostics')
    used = float(bench.values['z_max'])
    assert used == pytest.approx(least_singular_z(lengths), abs=1e-6)
    if printed:
        assert used == pytest.approx(printed, abs=1e-5)
    assert bench.get('z_max') == -1.0


def test_z_crit_flags_every_singular_posture(make_bench):
    bench = make_bench({'z_max': -1.0, 'margin_min': 0.0, 'hysteresis': 0.0})
    threshold = least_singular_z(LENGTHS)
    for last in np.linspace(-3.0, 3.0, 9):
        for elbow in (0.0, math.pi):
            numbers, flag = bench.cycle([0.2, elbow, last])
            assert flag is True
    numbers, flag = bench.cycle([0.2, 1.2, 2.0])
    assert numbers.z < threshold
    assert flag is False


@pytest.mark.parametrize('lengths', [
    LENGTHS, [1.0, 1.0, 1.0], [0.425, 0.39225, 0.09465], [1.0, 0.8, 0.6, 0.4]])
def test_z_crit_flags_the_critical_posture_itself(lengths):
    posture = critical_posture(PlanarArm(lengths)).joint_angles.tolist()
    names = tuple('abcd'[:len(lengths)])
    n = len(names)
    configuration = Configuration.from_parameters(parameter_values(
        joint_names=names, link_lengths=lengths, joint_offsets=[0.0] * n,
        joint_directions=[1] * n, joint_lower=[-math.inf] * n, joint_upper=[math.inf] * n,
        z_max=-1.0, margin_min=0.0))
    verdict = PostureMonitor(configuration, 0.0).on_joint_state(list(names), posture, 0.0)
    assert verdict.near_singularity


def test_z_crit_follows_the_link_lengths(make_bench):
    bench = make_bench({'z_max': -1.0, 'diagnostics_period': 0.0})
    lengths = [0.425, 0.39225, 0.09465]
    assert bench.set(link_lengths=lengths)[0].successful
    bench.cycle(REGULAR)
    bench.wait(lambda: float(bench.values['z_max']) < 0.6, 'the new threshold')
    assert float(bench.values['z_max']) == pytest.approx(0.50836, abs=1e-5)


@pytest.mark.parametrize('value', [-0.5, -1.0000001, -0.999, 1.5, math.nan])
def test_no_other_negative_threshold_is_taken(bench, value):
    result, = bench.set(z_max=value)
    assert not result.successful
    assert 'z_max' in result.reason
    assert bench.get('z_max') == 0.9


