"""Picture of a straight seam at its best place, and z along it."""

import math

import numpy as np

from kinopt_ros.kinetostatics.index import kinetostatic_index
from kinopt_ros.kinetostatics.seam import place_seam
from kinopt_ros.tools.pictures.postures import draw_arm
from kinopt_ros.tools.pictures.style import (
    CIRCLE,
    fit,
    GREY,
    legend_below,
    new_figure,
    plane_axes,
    RED,
)


def seam_figure(arm, optimum, length, tool_angle):
    """
    Draw the arm along a seam of `length` (m) with the tool at `tool_angle` (rad) to it.

    `optimum` is the arm's OptimalPosture, for the conditioning circle and the least z.
    """
    placement = place_seam(arm, length, tool_angle)
    figure = new_figure(4.6)
    plane, graph = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    _draw_plane(plane, arm, optimum, length, placement)
    along = np.linspace(0.0, length, len(placement.joint_angles))
    graph.plot(along, kinetostatic_index(arm, placement.joint_angles).z, color=RED, linewidth=2.5,
               label='z along the seam')
    graph.axhline(optimum.z, color=GREY, linestyle='--', linewidth=1.5, label='z at the optimum')
    graph.set(xlabel='along the seam [m]', ylabel='z [-]', xlim=(0.0, length))
    graph.set_ylim(-0.03 * placement.largest_z, 1.1 * max(placement.largest_z, 0.02))
    graph.grid(True)
    handles = [*plane.get_legend_handles_labels()[0], *graph.get_legend_handles_labels()[0]]
    legend_below(figure, handles)
    figure.suptitle(f'Seam of {length:.3g} m, tool at {math.degrees(tool_angle):.4g}° to it: '
                    f'largest z = {placement.largest_z:.3f}', fontsize=11)
    return figure


def _draw_plane(axes, arm, optimum, length, placement):
    circle = optimum.circle_radius * CIRCLE
    axes.plot(circle.real, circle.imag, '--', color=GREY, linewidth=1.2,
              label='conditioning circle')
    ends = placement.middle + 0.5 * length * np.array([-1.0, 1.0])
    axes.plot(ends.real, ends.imag, color=RED, linewidth=4, zorder=3, label='seam')
    drawn = placement.joint_angles[[0, len(placement.joint_angles) // 2, -1]]
    for angles, alpha in zip(drawn, (0.3, 1.0, 0.3)):
        draw_arm(axes, arm, angles, numbers=alpha == 1.0, alpha=alpha)
    vectors = arm.operation_point_vectors(drawn)
    plane_axes(axes)
    fit(axes, np.concatenate([circle, (vectors[:, :1] - vectors).ravel(), ends]), margin=0.06)
