"""The picture of an index over time: z, margin and flag."""

from kinopt_ros.tools.pictures.style import BLUE, GREY, new_figure, ORANGE


def over_time_figure(rows, thresholds, title):
    """
    Draw z, margin and flag over time.

    Parameters
    ----------
    rows : sequence
        With the attributes time (s), z, margin and near_singularity.
    thresholds : Thresholds
    title : str

    Returns
    -------
    figure : matplotlib.figure.Figure
    """
    figure = new_figure(5.2)
    top, bottom = figure.subplots(2, 1, sharex=True)
    times = [row.time - rows[0].time for row in rows]
    flags = [row.near_singularity for row in rows]
    _draw(top, times, [row.z for row in rows], flags, thresholds.z_max, 'z_max')
    _draw(bottom, times, [row.margin for row in rows], flags, thresholds.margin_min, 'margin_min')
    top.set(ylabel='index z [-]', title=title)
    bottom.set(xlabel='time [s]', ylabel='margin [-]')
    top.legend(loc='lower center', bbox_to_anchor=(0.5, 1.12), ncols=3, frameon=False)
    return figure


def _draw(axes, times, values, flags, threshold, threshold_name):
    # In steps: a flag that is up for one message only has to be seen too.
    axes.fill_between(times, 0.0, 1.0, where=flags, transform=axes.get_xaxis_transform(),
                      step='post', color=ORANGE, alpha=0.4, linewidth=0.0,
                      label='flag: near singularity')
    axes.plot(times, values, color=BLUE, linewidth=1.8, label='value')
    axes.axhline(threshold, color=GREY, linestyle='--', linewidth=1.2, label='threshold')
    # Beside the axes, where it covers nothing.
    axes.text(1.01, threshold, f'{threshold_name}\n= {threshold:g}', va='center',
              transform=axes.get_yaxis_transform(), fontsize=9)
    axes.set_ylim(-0.03, 1.03)
    axes.margins(x=0.0)
    axes.grid(True)
