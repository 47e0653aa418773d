"""Picture of what thresholds on z and on the margin flag, miss and falsely alarm."""

import math

import numpy as np

from kinopt_ros.kinetostatics.singular_postures import z_crit
from kinopt_ros.kinetostatics.workspace import NEIGHBOURHOOD, study_thresholds
from kinopt_ros.tools.pictures.style import BLUE, GREY, legend_below, new_figure, ORANGE, RED

_LINES = [('flagged (of all postures)', BLUE, '-'),
          ('missed (of near-singular ones)', RED, '--'),
          ('false alarms (of the others)', ORANGE, '-.')]


def thresholds_figure(arm, z_max=0.9, margin_min=0.05, neighbourhood=NEIGHBOURHOOD,
                      points=81):
    """
    Draw the fractions against each of the two thresholds while it alone raises the flag.

    The node's pair (z_max, margin_min) is marked, and its own fractions stand in the title.
    """
    figure = new_figure(4.7)
    by_z, by_margin = figure.subplots(1, 2, sharey=True)
    critical = z_crit(arm)
    _draw_study(by_z, arm, [(z, 0.0) for z in np.linspace(0.0, 1.0, points)], neighbourhood, 0)
    _draw_study(by_margin, arm, [(1.0, margin) for margin in np.linspace(0.0, 0.5, points)],
                neighbourhood, 1)
    _mark(by_z, critical, rf'$z_\mathrm{{crit}}$ = {critical:.3f}', 0.57, 'right')
    _mark(by_z, z_max, f'z_max = {z_max:.3g}', 0.90, 'right')
    _mark(by_margin, margin_min, f'margin_min = {margin_min:.3g}', 0.90, 'left')
    by_z.set(xlabel=r'$z_\mathrm{max}$ [-], margin ignored', ylabel='fraction [-]', xlim=(0, 1),
             ylim=(-0.02, 1.02))
    by_margin.set(xlabel=r'margin$_\mathrm{min}$ [-], z ignored', xlim=(0, 0.5))
    both = study_thresholds(arm, z_max, margin_min, neighbourhood)
    lengths = ', '.join(f'{length:.4g}' for length in arm.link_lengths)
    figure.suptitle(
        f'Links {lengths} m; near = within {math.degrees(neighbourhood):.3g}° of singular\n'
        f'z > {z_max:.3g} or margin < {margin_min:.3g}: flagged {both.flagged.fraction:.1%}, '
        f'missed {both.missed.fraction:.1%}, false alarms {both.false_alarms.fraction:.1%}',
        fontsize=11)
    figure.get_layout_engine().set(wspace=0.05)
    legend_below(figure, by_z.get_legend_handles_labels()[0])
    return figure


def _draw_study(axes, arm, thresholds, neighbourhood, varied):
    studies = [study_thresholds(arm, z_max, margin_min, neighbourhood, samples=1024)
               for z_max, margin_min in thresholds]
    x = [pair[varied] for pair in thresholds]
    for (name, color, style), estimates in zip(_LINES, zip(*studies)):
        axes.plot(x, [estimate.fraction for estimate in estimates], style, color=color,
                  linewidth=2.2, label=name)
    axes.grid(True)


def _mark(axes, at, text, height, side):
    axes.axvline(at, color=GREY, linewidth=1.2)
    axes.annotate(text, (at, height), xytext=(-5 if side == 'right' else 5, 0),
                  textcoords='offset points', ha=side, va='center', fontsize=10,
                  bbox={'facecolor': 'white', 'edgecolor': 'none', 'alpha': 0.85, 'pad': 1.5})
