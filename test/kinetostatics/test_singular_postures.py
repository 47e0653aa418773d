"""The least z over the singular postures, against sampling and optimisation."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from kinopt_ros.kinetostatics.index import kinetostatic_index
from kinopt_ros.kinetostatics.model_set import index_against, model_polygon
from kinopt_ros.kinetostatics.planar_arm import PlanarArm
from kinopt_ros.kinetostatics.singular_postures import critical_posture, singular_postures, z_crit


def random_arms(count, seed, n_max=7):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield PlanarArm(10.0 ** rng.uniform(-1.5, 1.5, rng.integers(3, n_max)))


@pytest.mark.parametrize(('lengths', 'expected'), [
    ((1.0, 1.0, math.sqrt(3.0) / 3.0), 0.60566),
    ((1.0, 1.0, 1.0), 0.5),
    ((0.425, 0.39225, 0.09465), 0.50836),
])
def test_known_values(lengths, expected):
    assert z_crit(PlanarArm(lengths)) == pytest.approx(expected, abs=5e-6)


def test_z_crit_is_the_minimum_over_all_singular_curves():
    for arm in random_arms(40, seed=1):
        least = 1.0
        for curve in singular_postures(arm.n_joints, samples=2):
            posture = curve[0].copy()

            def z(theta_n, posture=posture, arm=arm):
                return kinetostatic_index(arm, np.append(posture[:-1], theta_n)).z

            # Along a curve z goes down and up once in a turn: two half turns bracket it.
            for bounds in [(-1.0, math.pi), (math.pi - 1.0, 2.0 * math.pi)]:
                least = min(least, minimize_scalar(
                    z, bounds=bounds, method='bounded', options={'xatol': 1e-9}).fun)
        assert z_crit(arm) == pytest.approx(least, abs=1e-9)


def test_no_sampled_singular_posture_is_below_z_crit():
    for arm in random_arms(60, seed=2):
        z = kinetostatic_index(arm, singular_postures(arm.n_joints)).z
        assert z.min() >= z_crit(arm) - 1e-12
        assert z.min() == pytest.approx(z_crit(arm), abs=1e-3)


def test_critical_posture_attains_z_crit_and_is_singular():
    for arm in random_arms(60, seed=3, n_max=9):
        z, angles = critical_posture(arm)
        assert kinetostatic_index(arm, angles).z == pytest.approx(z, abs=1e-12)
        assert np.linalg.matrix_rank(arm.jacobian(angles) / arm.longest_link, tol=1e-9) == 2


def test_singular_postures_have_a_rank_deficient_jacobian_and_no_margin():
    for arm in random_arms(20, seed=4):
        angles = singular_postures(arm.n_joints, samples=13)
        assert angles.shape == (2 ** (arm.n_joints - 2), 13, arm.n_joints)
        singular_values = np.linalg.svd(arm.jacobian(angles) / arm.longest_link)[1]
        assert singular_values[..., -1].max() < 1e-9
        assert kinetostatic_index(arm, angles).margin.max() < 1e-12


def test_singular_postures_are_all_of_them():
    # Postures whose Jacobian is close to losing rank lie close to a sampled curve.
    rng = np.random.default_rng(5)
    arm = PlanarArm((1.0, 0.8, 0.6, 0.5))
    angles = rng.uniform(-np.pi, np.pi, (60000, 4))
    least = np.linalg.svd(arm.jacobian(angles))[1][:, -1]
    close = angles[least < 0.02]
    folded = np.abs((close[:, 1:3] + np.pi / 2) % np.pi - np.pi / 2).max(axis=1)
    assert len(close) > 20 and folded.max() < 0.25


def test_three_joints_have_two_singular_lines():
    angles = singular_postures(3, samples=5)
    assert angles[:, :, 1].tolist() == [[0.0] * 5, [math.pi] * 5]
    assert angles[0, :, 2] == pytest.approx(np.linspace(-math.pi, math.pi, 5))


def test_every_singular_posture_has_z_of_at_least_one_half_for_any_model_set():
    for arm in random_arms(30, seed=6):
        angles = singular_postures(arm.n_joints, samples=37)
        assert z_crit(arm) >= 0.5
        assert kinetostatic_index(arm, angles).z.min() >= 0.5 - 1e-12
        assert index_against(
            arm, angles, model_polygon(arm.n_joints), mirror=True).z.min() >= 0.5 - 1e-12


def test_z_crit_does_not_depend_on_the_scale():
    assert z_crit(PlanarArm((3e6, 2e6, 1e6))) == pytest.approx(
        z_crit(PlanarArm((3e-6, 2e-6, 1e-6))), abs=1e-14)


def test_limits():
    assert 0.5 <= z_crit(PlanarArm((1.0,) * 20)) < 1.0
    with pytest.raises(ValueError, match='n = 21: foldings are listed for 3 to 20 joints'):
        z_crit(PlanarArm((1.0,) * 21))
    with pytest.raises(ValueError, match='n = 2: foldings'):
        singular_postures(2)
    with pytest.raises(ValueError, match='samples = 0: must be at least 1'):
        singular_postures(3, samples=0)
