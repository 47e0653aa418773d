"""Pictures of an arm in a posture."""

import math

import numpy as np

from kinopt_ros.kinetostatics.index import kinetostatic_index
from kinopt_ros.kinetostatics.model_set import closest_model_set
from kinopt_ros.tools.pictures.style import (
    BLACK,
    BLUE,
    CIRCLE,
    fit,
    GREEN,
    GREY,
    HALO,
    legend_below,
    new_figure,
    ORANGE,
    plane_axes,
    RED,
)


def posture_figure(arm, joint_angles):
    """Draw a posture with its closest isotropic set and the conditioning circle."""
    figure = new_figure(6.4)
    axes = figure.subplots()
    index = kinetostatic_index(arm, joint_angles)
    joints, tip = joint_centres(arm, joint_angles)
    circle = abs(tip) * CIRCLE
    axes.plot(circle.real, circle.imag, '--', color=GREY, linewidth=1.2, zorder=1,
              label=f'conditioning circle, radius {abs(tip):.3g} m')
    model = tip - index.conditioning_length * closest_model_set(arm, joint_angles)
    for joint, point in zip(joints, model):
        axes.plot([joint.real, point.real], [joint.imag, point.imag], ':', color=ORANGE,
                  linewidth=1.5, zorder=2)
    # Squares larger than the joints, so that both are seen where they coincide.
    axes.plot(model.real, model.imag, 's', markersize=25, markerfacecolor='none',
              markeredgecolor=ORANGE, markeredgewidth=2, zorder=3,
              label=r'closest isotropic set, scaled by $l_P$')
    draw_arm(axes, arm, joint_angles)
    plane_axes(axes)
    fit(axes, np.concatenate([circle, joints, model]), margin=0.08)
    degrees = ', '.join(f'{angle:.1f}°' for angle in np.degrees(joint_angles))
    # Many angles take a line of their own.
    gap = '   ' if arm.n_joints <= 4 else '\n'
    axes.set_title(rf'$\theta$ = ({degrees}){gap}$z$ = {index.z:.3f}   '
                   rf'$l_P$ = {index.conditioning_length:.3g} m   margin = {index.margin:.3f}')
    legend_below(figure, axes.get_legend_handles_labels()[0], markerscale=0.4)
    return figure


def manipulator_figure(arm, joint_angles):
    """Draw the notation: joints, links, joint angles and the vectors r_i to P."""
    figure = new_figure(4.6)
    axes = figure.subplots()
    joints, tip = joint_centres(arm, joint_angles)
    for i, joint in enumerate(joints[:-1]):
        vector = tip - joint
        axes.annotate('', (tip.real, tip.imag), (joint.real, joint.imag), zorder=1, arrowprops={
            'arrowstyle': '-|>', 'color': ORANGE, 'linewidth': 1.4, 'linestyle': '--',
            'shrinkA': 0, 'shrinkB': 6})
        middle = joint + 0.5 * vector
        axes.text(middle.real, middle.imag, rf'$\mathbf{{r}}_{i + 1}$', color='#8a5f00',
                  ha='center', va='center', fontsize=13, path_effects=HALO)
    corners = np.append(joints, tip)
    directions = np.cumsum(joint_angles)
    previous = 0.0
    for i, (joint, direction) in enumerate(zip(joints, directions)):
        link = corners[i + 1] - joint
        last = i == len(joints) - 1
        name = rf'$a_{i + 1}$' + (rf', $\mathbf{{r}}_{i + 1}$' if last else '')
        beside = joint + 0.6 * link + (0.12 + 0.12 * last) * 1j * link / abs(link)
        axes.text(beside.real, beside.imag, name, ha='center', va='center', fontsize=13)
        _draw_angle(axes, joint, previous, direction, rf'$\theta_{i + 1}$')
        previous = direction
    draw_arm(axes, arm, joint_angles)
    plane_axes(axes)
    fit(axes, np.append(corners, max(corners.imag) * 1j + 0.25j), margin=0.08)
    return figure


def draw_arm(axes, arm, joint_angles, numbers=True, alpha=1.0):
    """Draw links, numbered joints and operation point onto axes."""
    joints, tip = joint_centres(arm, joint_angles)
    corners = np.append(joints, tip)
    axes.plot(corners.real, corners.imag, '-', color=BLUE, linewidth=5, alpha=0.55 * alpha,
              solid_capstyle='round', zorder=4)
    axes.plot(joints.real, joints.imag, 'o', markersize=15, markerfacecolor='white',
              markeredgecolor=BLACK, markeredgewidth=1.5, alpha=alpha, zorder=5)
    if numbers:
        for i, joint in enumerate(joints):
            axes.text(joint.real, joint.imag, str(i + 1), ha='center', va='center_baseline',
                      fontsize=10, zorder=6)
    axes.plot(tip.real, tip.imag, 'o', markersize=8, color=RED, alpha=alpha, zorder=7)
    if numbers:
        axes.annotate('P', (tip.real, tip.imag), xytext=(9, 7), textcoords='offset points',
                      color=RED, fontsize=12, fontweight='bold', path_effects=HALO, zorder=7)


def joint_centres(arm, joint_angles):
    """Centres of the joints and operation point in m, joint 1 at the origin."""
    vectors = arm.operation_point_vectors(joint_angles)
    return vectors[0] - vectors, complex(vectors[0])


def geometric_mean_figure(arm, joint_angles):
    """Draw sqrt(n) d_rms as the mean proportional of l_P and the sum of projections."""
    index = kinetostatic_index(arm, joint_angles)
    length = index.conditioning_length
    projections = arm.n_joints * arm.rms_distance(joint_angles) ** 2 / length
    height = math.sqrt(length * projections)
    figure = new_figure(4.4)
    axes = figure.subplots()
    diameter = length + projections
    half_circle = diameter / 2.0 * (1.0 + CIRCLE[:91])
    axes.plot(half_circle.real, half_circle.imag, color=GREY, linewidth=1)
    for start, end, color in [(0.0, length, BLUE), (length, diameter, GREEN)]:
        axes.plot([start, end], [0.0, 0.0], color=color, linewidth=4, solid_capstyle='butt')
    axes.plot([length, length], [0.0, height], color=RED, linewidth=4, solid_capstyle='butt')
    axes.plot([0.0, length, diameter], [0.0, height, 0.0], color=GREY, linewidth=1)
    axes.text(length / 2.0, -0.03 * diameter, f'$l_P$\n{length:.3f} m', color=BLUE, ha='center',
              va='top')
    axes.text((length + diameter) / 2.0, -0.03 * diameter,
              r'$\sum\, \mathbf{k}_j^T \mathbf{r}_j$' + f'\n{projections:.3f} m', color='#006b4e',
              ha='center', va='top')
    axes.text(length + 0.02 * diameter, 0.5 * height,
              r'$\sqrt{n}\, d_\mathrm{rms}$' + f'\n{height:.3f} m', color='#b04e00', va='center')
    plane_axes(axes)
    axes.set(xlim=(-0.05 * diameter, 1.05 * diameter), ylim=(-0.17 * diameter, 0.54 * diameter),
             xlabel='length [m]', ylabel='length [m]')
    return figure


def _draw_angle(axes, corner, start, end, name):
    """Mark the angle at a corner from direction start to direction end, in rad."""
    radius = 0.27
    axes.plot([corner.real, corner.real + 1.5 * radius * math.cos(start)],
              [corner.imag, corner.imag + 1.5 * radius * math.sin(start)],
              '-', color=GREY, linewidth=1, zorder=2)
    arc = corner + radius * np.exp(1j * np.linspace(start, end, 40))
    axes.plot(arc.real, arc.imag, '-', color=GREEN, linewidth=1.8, zorder=3)
    label = corner + 1.55 * radius * np.exp(0.5j * (start + end))
    axes.text(label.real, label.imag, name, color='#006b4e', ha='center', va='center', fontsize=13)
