"""Pictures of isotropic sets of points: polygons, a union, a rotation."""

import math

import numpy as np

from kinopt_ros.kinetostatics.isotropic_sets import (
    centroid,
    regular_polygon,
    rotated,
    second_moment,
    union,
)
from kinopt_ros.tools.pictures.style import BLACK, BLUE, fit, new_figure, ORANGE, plane_axes

_MARKERS = [('o', BLUE), ('s', ORANGE)]
_PER_ROW = 4


def trivial_sets_figure(vertices):
    """Draw regular polygons with the given numbers of vertices."""
    rows = math.ceil(len(vertices) / _PER_ROW)
    figure = new_figure(2.75 * rows)
    panels = figure.subplots(rows, min(len(vertices), _PER_ROW), squeeze=False,
                             sharex=True, sharey=True).ravel()
    for axes in panels[len(vertices):]:
        axes.set_visible(False)
    for axes, n in zip(panels, vertices):
        _draw_set(axes, [regular_polygon(n)], f'n = {n}')
        axes.label_outer()
    return figure


def union_figure(first, second):
    """Draw two isotropic sets and their union."""
    sizes = [f'{len(points)} points' for points in (first, second, union(first, second))]
    return _row_of_sets([([first], sizes[0]), ([(), second], sizes[1]),
                         ([first, second], f'union, {sizes[2]}')])


def rotation_figure(points, angle):
    """Draw an isotropic set, its image turned by `angle` (rad), and their union."""
    turned = rotated(points, angle)
    turn = f'turned by {math.degrees(angle):.4g}°'
    return _row_of_sets([([points], 'set'), ([(), turned], turn), ([points, turned], 'union')])


def _row_of_sets(panels):
    figure = new_figure(3.3)
    for axes, (sets, title) in zip(figure.subplots(1, len(panels), sharex=True, sharey=True),
                                   panels):
        _draw_set(axes, sets, title)
        axes.label_outer()
    return figure


def _draw_set(axes, sets, title):
    """Draw point sets, each in its marker, with the centroid and the second moment."""
    everything = np.concatenate([np.asarray(points, dtype=complex) for points in sets])
    for (marker, color), points in zip(_MARKERS, sets):
        if not len(points):
            continue
        points = np.asarray(points)
        outline = points[np.argsort(np.angle(points - centroid(points)))]
        outline = np.append(outline, outline[0])
        axes.plot(outline.real, outline.imag, '-', color=color, linewidth=1.2, alpha=0.6)
        # The second set is hollow and larger: a point that both hold shows both.
        axes.plot(points.real, points.imag, marker, color=color, linestyle='none',
                  markersize=8 if marker == 'o' else 12, markeredgewidth=2,
                  markerfacecolor=color if marker == 'o' else 'none')
    centre = centroid(everything)
    axes.plot(centre.real, centre.imag, '+', color=BLACK, markersize=11, markeredgewidth=2)
    moment = second_moment(everything)[0, 0]
    axes.set_title(f'{title}\n' + rf'$\mathbf{{M}} = {moment:.4g}\ \mathbf{{1}}$')
    plane_axes(axes, unit='-')
    fit(axes, centre + math.sqrt(2.0) * np.array([-1 - 1j, 1 + 1j]), margin=0.16)
