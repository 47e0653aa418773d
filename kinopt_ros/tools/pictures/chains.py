"""Pictures of the isotropic chains that a set of points generates."""

import math
from textwrap import fill

import numpy as np

from kinopt_ros.kinetostatics.isotropic_sets import centroid
from kinopt_ros.kinetostatics.planar_arm import PlanarArm
from kinopt_ros.tools.pictures.postures import draw_arm
from kinopt_ros.tools.pictures.style import fit, GREY, new_figure, plane_axes

_PER_ROW = 3
# Letters above a panel; longer titles are broken.
_TITLE_WIDTH = 26
# Inches per row, by the number of panels in it.
_ROW_HEIGHTS = {1: 5.5, 2: 3.6, 3: 2.85}


def chains_figure(chains, at_most=12):
    """
    Draw chains in their isotropic postures, with their link lengths; the first `at_most`.

    Raises
    ------
    ValueError
        If at_most is not at least 1.
    """
    if at_most < 1:
        raise ValueError(f'at_most = {at_most}: must be at least 1')
    drawn = chains[:at_most]
    columns = min(len(drawn), _PER_ROW)
    rows = math.ceil(len(drawn) / columns)
    figure = new_figure(_ROW_HEIGHTS[columns] * rows)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels[len(drawn):]:
        axes.set_visible(False)
    for axes, chain in zip(panels, drawn):
        _draw_chain(axes, chain)
    if len(drawn) < len(chains):
        figure.suptitle(f'the first {len(drawn)} of {len(chains)} chains')
    return figure


def _draw_chain(axes, chain):
    arm, tip = PlanarArm(chain.link_lengths), centroid(chain.points)
    outline = chain.points[np.argsort(np.angle(chain.points - tip))]
    outline = np.append(outline, outline[0]) - chain.points[0]
    axes.plot(outline.real, outline.imag, ':', color=GREY, linewidth=1.5, zorder=1)
    draw_arm(axes, arm, chain.joint_angles)
    plane_axes(axes, ticks=3)
    fit(axes, outline, margin=0.15)
    lengths = ', '.join(f'{length:.3g}' for length in chain.link_lengths)
    axes.set_title(fill(f'a = {lengths} m', _TITLE_WIDTH), fontsize=10)
