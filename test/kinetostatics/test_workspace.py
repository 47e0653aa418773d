"""Grids, fractions of the torus, thresholds and seams, against brute force."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import differential_evolution

from kinopt_ros.kinetostatics.index import kinetostatic_index
from kinopt_ros.kinetostatics.isocontours import index_over_grid, principal_curvatures
from kinopt_ros.kinetostatics.planar_arm import PlanarArm
from kinopt_ros.kinetostatics.seam import place_seam, trace_seam
from kinopt_ros.kinetostatics.singular_postures import z_crit
from kinopt_ros.kinetostatics.workspace import study_thresholds, useful_workspace

ISOTROPIC = PlanarArm((1.0, 1.0, math.sqrt(3.0) / 3.0))
EQUILATERAL = PlanarArm((1.0, 1.0, 1.0))
OPTIMUM = {ISOTROPIC: np.radians([0.0, 120.0, 150.0]),
           EQUILATERAL: np.array([0.0, 1.428258953, 2.708716257])}


def z_of(arm):
    return lambda theta: kinetostatic_index(arm, [0.0, *theta]).z


def numerical_hessian(function, at, step=1e-3):
    """Second differences of fourth order by Richardson's extrapolation."""
    def differences(h):
        e = h * np.eye(len(at))
        return np.array([[function(at + u + v) - function(at + u - v) - function(at - u + v)
                          + function(at - u - v) for u in e] for v in e]) / (4.0 * h * h)
    return (4.0 * differences(step) - differences(2.0 * step)) / 3.0


def test_grid_of_three_joints():
    grid = index_over_grid(EQUILATERAL, samples=13)
    assert grid.index.z.shape == (13, 13)
    assert grid.first[[0, -1]].tolist() == [0.0, 2.0 * math.pi]
    assert grid.index.z[4, 7] == pytest.approx(
        kinetostatic_index(EQUILATERAL, [0.0, math.radians(120), math.radians(210)]).z)


def test_grid_of_a_slice_holds_the_other_joints():
    arm = PlanarArm((1.0, 0.8, 0.6, 0.4))
    held = [0.0, 0.1, 0.2, 0.3]
    grid = index_over_grid(arm, 5, joints=(4, 2), posture=held, first=(0, 1), second=(2, 3))
    for i, k in [(0, 0), (1, 3), (4, 2)]:
        one = kinetostatic_index(arm, [0.0, 2.0 + k / 4, 0.2, i / 4])
        assert [values[i, k] for values in grid.index] == pytest.approx(one)


@pytest.mark.parametrize(('arguments', 'message'), [
    ({'joints': (1, 2)}, r'joints = \(1, 2\): must be two different ones of 2 \.\.\. 3'),
    ({'joints': (2, 2)}, r'joints = \(2, 2\)'),
    ({'joints': (2, 4)}, r'joints = \(2, 4\)'),
    ({'samples': 1}, 'samples = 1: must be at least 2'),
    ({'posture': np.zeros((2, 3))}, r'posture has shape \(2, 3\)'),
])
def test_bad_grids(arguments, message):
    with pytest.raises(ValueError, match=message):
        index_over_grid(EQUILATERAL, **arguments)


@pytest.mark.parametrize(('arm', 'eigenvalues'), [
    (ISOTROPIC, (4.0 / 3.0, 2.0)), (EQUILATERAL, (0.64011, 2.65570))])
def test_curvatures_at_the_optimum(arm, eigenvalues):
    curvatures = principal_curvatures(arm, OPTIMUM[arm])
    assert curvatures == pytest.approx(eigenvalues, abs=5e-5)
    hessian = numerical_hessian(z_of(arm), OPTIMUM[arm][1:])
    assert curvatures == pytest.approx(np.linalg.eigvalsh(hessian), abs=1e-6)


def test_curvatures_of_four_joints():
    arm, angles = PlanarArm((1.0, 0.8, 0.6, 0.4)), np.array([0.0, 1.0, 1.2, 2.0])
    assert principal_curvatures(arm, angles) == pytest.approx(
        np.linalg.eigvalsh(numerical_hessian(z_of(arm), angles[1:])), abs=1e-6)
    with pytest.raises(ValueError, match='must be one posture'):
        principal_curvatures(arm, np.zeros((2, 4)))


@pytest.mark.parametrize(('lengths', 'z_max'), [
    ((1.0, 1.0, math.sqrt(3.0) / 3.0), 0.25), ((1.0, 1.0, 1.0), 0.5), ((0.4, 0.39, 0.09), 0.6)])
def test_useful_workspace_of_three_joints_by_quadrature(lengths, z_max):
    arm = PlanarArm(lengths)
    turn = np.linspace(-np.pi, np.pi, 4001)[:-1]

    def fraction(theta_2):
        postures = np.stack([0 * turn, theta_2 + 0 * turn, turn], axis=-1)
        return np.mean(kinetostatic_index(arm, postures).z <= z_max)

    half = [fraction(theta_2) for theta_2 in np.linspace(0.0, np.pi, 1201)[:-1] + np.pi / 2400]
    useful = useful_workspace(arm, z_max)
    assert useful.fraction == pytest.approx(np.mean(half), abs=2e-4)
    assert useful.error < 1e-4


def test_error_of_useful_workspace_covers_the_truth():
    # n = 3 with the arc of theta_3 from z's closed form in t = theta_2: an exact integral.
    a, b, c, z_max = 1.0, 0.9, 0.5, 0.4

    def arc(t):
        p = 2.0 / 3.0 * (a * a + b * b + a * b * math.cos(t))
        f = 2.0 / 3.0 * (a * a + b * b + 2.0 * a * b * math.cos(t - math.pi / 3.0))
        rho = math.sqrt(a * a + 4.0 * b * b + 4.0 * a * b * math.cos(t)) / 3.0
        m_squared = (f / (2.0 * (1.0 - z_max)) - p) / 3.0
        cosine = (c * c + rho * rho - m_squared) / (2.0 * c * rho)
        return math.acos(min(1.0, max(-1.0, cosine))) / math.pi

    exact = quad(arc, 0.0, math.pi, limit=500, epsabs=1e-9)[0] / math.pi
    arm = PlanarArm((a, b, c))
    for samples in (64, 512, 4096):
        useful = useful_workspace(arm, z_max, samples)
        assert abs(useful.fraction - exact) < 5.0 * useful.error
    assert useful.error < 0.2 * useful_workspace(arm, z_max, 64).error


@pytest.mark.parametrize('lengths', [
    (1.0, 1.0, math.sqrt(3.0) / 3.0), (1.0, 1.0, 1.0), (1.0, 0.8, 0.5, 0.3),
    (1.0, 1.0, 1.0, 1.0, 1.0)])
@pytest.mark.parametrize(('z_max', 'margin_min'), [
    (0.55, 0.0), (0.8, 0.1), (0.9, 0.05), (1.0, 0.1)])
def test_thresholds_by_random_postures(lengths, z_max, margin_min):
    arm, width = PlanarArm(lengths), 0.2
    angles = np.random.default_rng(7).uniform(0.0, 2.0 * np.pi, (200000, len(lengths)))
    index = kinetostatic_index(arm, angles)
    flagged = (index.z > z_max) | (index.margin < margin_min)
    fold = np.abs((angles[:, 1:-1] + np.pi / 2) % np.pi - np.pi / 2)
    near = (fold <= width).all(axis=1)
    study = study_thresholds(arm, z_max, margin_min, neighbourhood=width)
    for estimate, sample in [(study.flagged, flagged), (study.missed, ~flagged[near]),
                             (study.false_alarms, flagged[~near])]:
        scatter = math.sqrt(0.25 / len(sample))
        assert estimate.fraction == pytest.approx(sample.mean(), abs=5.0 * scatter)
        assert estimate.error < 2e-3


def test_thresholds_that_flag_nothing_and_everything():
    study = study_thresholds(EQUILATERAL, 1.0, 0.0)
    assert [estimate.fraction for estimate in study] == [0.0, 1.0, 0.0]
    study = study_thresholds(EQUILATERAL, 0.0, 1.0)
    assert [estimate.fraction for estimate in study] == [1.0, 0.0, 1.0]


def test_z_max_just_under_z_crit_misses_no_singular_posture():
    # Towards the singular set itself: the missed fraction vanishes below z_crit, not above.
    for arm in (ISOTROPIC, PlanarArm((1.0, 0.8, 0.5, 0.3))):
        below = study_thresholds(arm, z_crit(arm) - 1e-2, 0.0, neighbourhood=1e-4)
        above = study_thresholds(arm, z_crit(arm) + 1e-2, 0.0, neighbourhood=1e-4)
        assert below.missed.fraction == 0.0 < above.missed.fraction


@pytest.mark.parametrize(('arguments', 'message'), [
    ((1.5, 0.0), r'z_max = 1.5: must be within \[0, 1\]'),
    ((math.nan, 0.0), r'z_max = nan'),
    ((0.5, -0.1), r'margin_min = -0.1: must be within \[0, 1\]'),
    ((0.5, 0.0, 0.0), r'neighbourhood = 0.0: must be above 0'),
    ((0.5, 0.0, 0.1, 0), r'samples = 0: must be at least 1'),
])
def test_bad_thresholds(arguments, message):
    with pytest.raises(ValueError, match=message):
        study_thresholds(EQUILATERAL, *arguments)


@pytest.mark.parametrize('elbow', [1, -1])
def test_traced_seam_by_forward_kinematics(elbow):
    arm, start, end, tool_angle = PlanarArm((1.0, 0.8, 0.4)), 0.3 - 0.9j, -0.2 - 0.6j, 2.0
    angles = trace_seam(arm, start, end, tool_angle, elbow, samples=11)
    tips = arm.operation_point_vectors(angles)[:, 0]
    assert tips == pytest.approx(np.linspace(start, end, 11))
    tool = np.exp(1j * angles.sum(axis=1)) / ((end - start) / abs(end - start))
    assert tool == pytest.approx(np.full(11, np.exp(1j * tool_angle)))
    assert (np.sign(angles[:, 1]) == elbow).all()


@pytest.mark.parametrize(('length', 'tool_angle'), [(0.4, 0.3), (1.2, 2.0)])
def test_best_seam_by_another_optimiser(length, tool_angle):
    arm = PlanarArm((1.0, 0.9, 0.5))

    def largest_z(x):
        worst = []
        for elbow in (1, -1):
            try:
                angles = trace_seam(arm, complex(x[0] - length / 2, x[1]),
                                    complex(x[0] + length / 2, x[1]), tool_angle, elbow, 41)
            except ValueError:
                continue
            worst.append(kinetostatic_index(arm, angles).z.max())
        return min(worst, default=1.0)

    found = differential_evolution(largest_z, [(-2.4, 2.4)] * 2, seed=1, tol=1e-8, maxiter=150)
    placed = place_seam(arm, length, tool_angle)
    assert placed.largest_z == pytest.approx(found.fun, abs=2e-3)
    assert placed.largest_z <= found.fun + 1e-4
    assert placed.largest_z == kinetostatic_index(arm, placed.joint_angles).z.max()


@pytest.mark.parametrize('tool_angle', [0.0, 1.0, 2.6])
@pytest.mark.parametrize('arm', [ISOTROPIC, EQUILATERAL])
def test_short_seam_lies_on_the_conditioning_circle(arm, tool_angle):
    optimum = kinetostatic_index(arm, OPTIMUM[arm])
    radius = abs(arm.operation_point_vectors(OPTIMUM[arm])[0])
    placed = place_seam(arm, 1e-3, tool_angle)
    assert abs(placed.middle) == pytest.approx(radius, abs=1e-3)
    assert placed.largest_z == pytest.approx(optimum.z, abs=1e-6)
    assert place_seam(arm, 0.5, tool_angle).largest_z > placed.largest_z


@pytest.mark.parametrize(('call', 'message'), [
    (lambda: trace_seam(PlanarArm((1, 1, 1, 1)), 0, 1, 0.0), 'n = 4 joints: must have 3'),
    (lambda: place_seam(PlanarArm((1, 1, 1, 1)), 1.0, 0.0), 'n = 4 joints: must have 3'),
    (lambda: trace_seam(EQUILATERAL, 0, 1, 0.0, elbow=0), 'elbow = 0: must be 1 or -1'),
    (lambda: trace_seam(EQUILATERAL, 1, 1, 0.0), 'ends must be finite and distinct'),
    (lambda: trace_seam(EQUILATERAL, 1, 9, 0.0), 'out of reach at 2.04 m from its start'),
    (lambda: place_seam(EQUILATERAL, 0.0, 0.0), 'length = 0.0: must be finite and positive'),
    (lambda: place_seam(EQUILATERAL, 9.0, 0.0), 'cannot trace a seam that long'),
])
def test_bad_seams(call, message):
    with pytest.raises(ValueError, match=message):
        call()
