"""The picture of two arms that follow one line, with and without null-space motion."""

import numpy as np

from kinopt_ros.tools.pictures.postures import joint_centres
from kinopt_ros.tools.pictures.style import (
    BLACK,
    BLUE,
    fit,
    GREY,
    HALO,
    new_figure,
    ORANGE,
    plane_axes,
    RED,
)

# Postures drawn of each arm at equal times, the first and the last among them.
_POSTURES = 7

_NAMES = ('least joint rates', 'with null-space motion')
_COLORS = (RED, BLUE)
_DASHES = ('--', '-')


def null_space_figure(arm, plain, descending, thresholds):
    """
    Draw the postures of both arms, and margin and position error over time.

    Parameters
    ----------
    arm : PlanarArm
    plain, descending : Controller
        With what was `heard` of the monitors (rows of time, margin, near_singularity) and the
        `steps` (of time, joint_angles, distance), in s, rad and m.
    thresholds : Thresholds
        Of the monitors.

    Returns
    -------
    figure : matplotlib.figure.Figure
    """
    runs = (plain, descending)
    figure = new_figure(7.6)
    *planes, margin, error = figure.subplot_mosaic(
        [['plain', 'descending'], ['margin', 'margin'], ['error', 'error']],
        height_ratios=[1.55, 1.6, 1.0]).values()
    # Both arms are shown at the moment at which the first is closest to a singularity.
    moment = min(plain.heard, key=lambda row: row.margin).time
    for axes, run, name, color in zip(planes, runs, _NAMES, _COLORS):
        _draw_postures(axes, arm, run, moment, color)
        axes.set_title(f'{name}\nmargin {_at(run.heard, moment).margin:.3f} at {moment:.1f} s '
                       '(black)')
        plane_axes(axes)
        fit(axes, np.concatenate([_points(arm, step) for run in runs
                                  for step in _spread(run.steps)]), margin=0.06)
    for run, name, color, dash in zip(runs, _NAMES, _COLORS, _DASHES):
        style = {'color': color, 'linestyle': dash, 'linewidth': 2.2, 'label': name}
        margin.plot([row.time for row in run.heard], [row.margin for row in run.heard], **style)
        error.plot([step.time for step in run.steps],
                   [1000.0 * step.distance for step in run.steps], **style)
    _draw_threshold(margin, plain, thresholds.margin_min)
    margin.set(ylabel='margin to singularity [-]', ylim=(0.0, None))
    margin.legend(loc='upper left')
    margin.tick_params(labelbottom=False)
    error.set(xlabel='time [s]', ylabel='position\nerror [mm]')
    for axes in (margin, error):
        axes.axvline(moment, color=BLACK, linewidth=1.0, zorder=1)
        axes.set_xlim(0.0, plain.steps[-1].time)
        axes.grid(True)
    return figure


def _at(samples, time):
    """Give the sample closest to a time (s)."""
    return min(samples, key=lambda sample: abs(sample.time - time))


def _spread(steps):
    """Give some of the steps, at equal times."""
    return [steps[i] for i in np.linspace(0, len(steps) - 1, _POSTURES).round().astype(int)]


def _points(arm, step):
    """Joint centres and tip."""
    return np.append(*joint_centres(arm, step.joint_angles))


def _draw_postures(axes, arm, run, moment, color):
    for step in _spread(run.steps):
        points = _points(arm, step)
        axes.plot(points.real, points.imag, '-o', color=color, alpha=0.4, linewidth=2.0,
                  markersize=4, zorder=3)
    points = _points(arm, _at(run.steps, moment))
    axes.plot(points.real, points.imag, '-o', color=BLACK, linewidth=2.4, markersize=5, zorder=4)
    axes.plot(points[-1].real, points[-1].imag, 'o', color=BLACK, markerfacecolor=ORANGE,
              markersize=9, zorder=5)
    tips = np.array([_points(arm, step)[-1] for step in run.steps[::10]])
    axes.plot(tips.real, tips.imag, color=ORANGE, linewidth=4, zorder=2)
    axes.plot(0.0, 0.0, 's', color=GREY, markersize=11, zorder=2)


def _draw_threshold(axes, run, margin_min):
    axes.axhline(margin_min, color=GREY, linestyle=':', linewidth=1.8)
    axes.text(0.01, margin_min, f'margin_min = {margin_min:g}', va='bottom',
              transform=axes.get_yaxis_transform(), path_effects=HALO)
    times = [row.time for row in run.heard]
    flags = [row.near_singularity for row in run.heard]
    axes.fill_between(times, 0.0, 1.0, where=flags, transform=axes.get_xaxis_transform(),
                      color=ORANGE, alpha=0.4, linewidth=0.0,
                      label='flag is up (least joint rates)')
