"""The picture of an index over time: z, margin and flag."""

import matplotlib

matplotlib.use('Agg')
from matplotlib import pyplot  # noqa: E402 - the backend comes first

# Okabe and Ito's colours, which colour-blind people can tell apart.
BLUE, ORANGE, GREY = '#0072B2', '#D55E00', '#999999'


def draw_over_time(rows, thresholds, path, title):
    """
    Draw z, margin and flag over time.

    Parameters
    ----------
    rows : sequence
        With the attributes time (s), z, margin and near_singularity.
    thresholds : Thresholds
    path : path of the picture to write
    title : str
    """
    t = [row.time - rows[0].time for row in rows]
    flag = [row.near_singularity for row in rows]
    figure, (top, bottom) = pyplot.subplots(
        2, 1, sharex=True, figsize=(8.0, 5.0), layout='constrained')
    _draw_line(top, t, [row.z for row in rows], flag, 'index z', thresholds.z_max, 'z_max')
    _draw_line(bottom, t, [row.margin for row in rows], flag, 'margin', thresholds.margin_min,
               'margin_min')
    bottom.set_xlabel('time (s)')
    top.set_title(title)
    top.legend(loc='lower center', bbox_to_anchor=(0.5, 1.08), ncols=3, frameon=False)
    figure.savefig(path, dpi=120)
    pyplot.close(figure)


def _draw_line(axes, t, values, flag, label, threshold, threshold_name):
    axes.plot(t, values, color=BLUE, linewidth=1.8, label='value' if label == 'index z' else None)
    axes.axhline(threshold, color=GREY, linestyle='--', linewidth=1.2,
                 label='threshold' if label == 'index z' else None)
    axes.annotate(f'{threshold_name} = {threshold:g}', (0.0, threshold), (4, 3),
                  xycoords=('axes fraction', 'data'), textcoords='offset points',
                  bbox={'facecolor': 'white', 'edgecolor': 'none', 'alpha': 0.8, 'pad': 1.0},
                  color='#555555', fontsize=9)
    axes.fill_between(t, 0.0, 1.0, where=flag, transform=axes.get_xaxis_transform(),
                      step='post', color=ORANGE, alpha=0.3, linewidth=0.0,
                      label='flag: near singularity' if label == 'index z' else None)
    axes.set_ylim(-0.03, 1.03)
    axes.set_ylabel(label)
    axes.grid(alpha=0.3)
