"""The figures of the paper, and the pictures of what it leaves to be drawn."""

import math

import numpy as np

from kinopt_ros.kinetostatics.isotropic_chains import chain_of, isotropic_chains
from kinopt_ros.kinetostatics.isotropic_sets import reflected, regular_polygon, rotated
from kinopt_ros.kinetostatics.optimal_posture import optimal_posture
from kinopt_ros.kinetostatics.planar_arm import PlanarArm
from kinopt_ros.tools.pictures.chains import chains_figure
from kinopt_ros.tools.pictures.contours import (
    isocontours_figure,
    neighbourhood_figure,
    surface_figure,
)
from kinopt_ros.tools.pictures.postures import (
    geometric_mean_figure,
    manipulator_figure,
    posture_figure,
)
from kinopt_ros.tools.pictures.seams import seam_figure
from kinopt_ros.tools.pictures.sets import rotation_figure, trivial_sets_figure, union_figure
from kinopt_ros.tools.pictures.thresholds import thresholds_figure

ISOTROPIC = PlanarArm((1.0, 1.0, math.sqrt(3.0) / 3.0))
EQUILATERAL = PlanarArm((1.0, 1.0, 1.0))
_FOUR_JOINTS = PlanarArm((1.0, 0.8, 0.6, 0.4))


def paper_figures():
    """
    Yield the name and the figure of every picture, one after the other.

    Those of the paper are named fig01 ... fig15 after their numbers in it.
    """
    triangle = regular_polygon(3)
    yield 'fig01_manipulator', manipulator_figure(
        PlanarArm((1.3, 1.2, 1.1, 1.2)), np.radians([45.0, 45.0, -80.0, -70.0]))
    yield 'fig02_union', union_figure(triangle, regular_polygon(4))
    yield 'fig03_rotation', rotation_figure(triangle, math.radians(60.0))
    yield 'fig04_trivial_sets', trivial_sets_figure((3, 4, 5, 6))
    yield 'fig05_two_postures', chains_figure(_two_postures())
    unit_square = regular_polygon(4, math.pi / 4, radius=1.0 / math.sqrt(2.0))
    yield 'fig06_six_postures', chains_figure(isotropic_chains(unit_square, reflections=False))
    yield from _figures_of_the_examples()
    yield 'slice_of_four_joints', isocontours_figure(
        _FOUR_JOINTS, optimal_posture(_FOUR_JOINTS).joint_angles, (2, 3))
    yield 'thresholds_isotropic', thresholds_figure(ISOTROPIC)
    yield 'thresholds_equilateral', thresholds_figure(EQUILATERAL)
    optimum = optimal_posture(ISOTROPIC)
    yield 'seam', seam_figure(ISOTROPIC, optimum, 0.8, tool_angle_on_circle(ISOTROPIC, optimum))


def tool_angle_on_circle(arm, optimum):
    """Angle in rad from the tangent of the conditioning circle to the last link at an optimum."""
    to_tip = arm.operation_point_vectors(optimum.joint_angles)[0]
    angle = math.fsum(optimum.joint_angles) - np.angle(to_tip) - 0.5 * math.pi
    return float(np.angle(np.exp(1j * angle)))


def _figures_of_the_examples():
    arms = [('isotropic', ISOTROPIC), ('equilateral', EQUILATERAL)]
    optima = [optimal_posture(arm).joint_angles for _, arm in arms]
    yield 'fig07_geometric_mean', geometric_mean_figure(EQUILATERAL, optima[1])
    for first, kind, draw in [(8, 'posture', posture_figure), (9, 'surface', surface_figure)]:
        for i, (name, arm) in enumerate(arms):
            yield f'fig{first + 2 * i:02d}_{kind}_{name}', draw(arm, optima[i])
    for first, kind, draw in [(12, 'isocontours', isocontours_figure),
                              (14, 'neighbourhood', neighbourhood_figure)]:
        for i, (name, arm) in enumerate(arms):
            yield f'fig{first + i:02d}_{kind}_{name}', draw(arm, optima[i])


def _two_postures():
    """Two numberings of one triangle of unit sides, mirror images of one another."""
    triangle = rotated(regular_polygon(3, radius=1.0 / math.sqrt(3.0)), math.pi)
    return [chain_of(triangle), chain_of(reflected(triangle, math.pi / 2))]
