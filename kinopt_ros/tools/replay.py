"""
A recording before the very monitor that the node runs, with the recording's own time.

Silence in the recording is silence for the monitor: it becomes stale where it would have.
"""

import csv
import itertools
import math
from pathlib import Path
from typing import NamedTuple

from kinopt_ros.monitor.posture_monitor import PostureMonitor
from kinopt_ros.monitor.verdict import Level
from kinopt_ros.tools.recordings import Unusable

# Times of the flag that a summary gives one by one.
MAX_SPANS = 20


class Row(NamedTuple):
    """
    One verdict of an analysis.

    Attributes
    ----------
    time : float
        s, as recorded.
    z, conditioning_length, margin : float
        Conditioning length in m; all NaN where the posture is not known.
    near_singularity : bool
    level : Level
    message : str
    """

    time: float
    z: float
    conditioning_length: float
    margin: float
    near_singularity: bool
    level: Level
    message: str


class Analysis(NamedTuple):
    """
    All verdicts on a recording.

    Attributes
    ----------
    rows : list of Row
    problems : list of (str, str)
        Place in the recording, and what is wrong there.
    """

    rows: list
    problems: list


def replay(messages, configuration):
    """
    Judge a recording as the node would have.

    Parameters
    ----------
    messages : iterable of RecordedMessage or Unusable
    configuration : Configuration

    Returns
    -------
    analysis : Analysis
    """
    analysis = Analysis([], [])
    monitor = None
    for item in messages:
        if isinstance(item, Unusable):
            analysis.problems.append((item.place, item.reason))
            continue
        if monitor is None:
            monitor = PostureMonitor(configuration, item.time)
        _note_silence(analysis.rows, monitor, item.time)
        verdict = monitor.on_joint_state(item.names, item.positions, item.time)
        _note(analysis.rows, item.time, verdict)
        if verdict is not None and verdict.level is Level.ERROR:
            analysis.problems.append((item.place, verdict.message))
    return analysis


def _note_silence(rows, monitor, now):
    """Let the monitor notice, at the moment at which it would have, that nothing came."""
    deadline = now + monitor.time_to_stale(now)
    if deadline >= now:
        return
    # Rounding can leave the deadline a little too early for the monitor.
    while monitor.time_to_stale(deadline) > 0.0:
        deadline = math.nextafter(deadline, math.inf)
    _note(rows, deadline, monitor.on_time(deadline))


def _note(rows, time, verdict):
    if verdict is not None:
        rows.append(Row(time, *verdict.index, verdict.near_singularity, verdict.level,
                        verdict.message))


class FlagSpan(NamedTuple):
    """
    A time for which the flag was up.

    Attributes
    ----------
    start, end : float
        s; `end` is the first verdict without the flag, or the last one of all.
    margin : float
        The least margin within, NaN if no posture was known.
    """

    start: float
    end: float
    margin: float


def flag_spans(rows):
    """
    Give the times for which the flag was up, one verdict holding until the next.

    Parameters
    ----------
    rows : list of Row

    Returns
    -------
    spans : list of FlagSpan
    """
    spans = []
    end = 0
    for raised, group in itertools.groupby(rows, key=lambda row: row.near_singularity):
        inside = list(group)
        end += len(inside)
        if raised:
            known = [row.margin for row in inside if not math.isnan(row.margin)]
            spans.append(FlagSpan(inside[0].time, rows[min(end, len(rows) - 1)].time,
                                  min(known, default=math.nan)))
    return spans


def summary(analysis, configuration):
    """
    Sum an analysis up in lines of text.

    Parameters
    ----------
    analysis : Analysis
    configuration : Configuration

    Returns
    -------
    lines : list of str
    """
    rows = analysis.rows
    arm, thresholds = configuration.arm, configuration.thresholds
    levels = [row.level for row in rows]
    known = [row for row in rows if not math.isnan(row.margin)]
    duration = rows[-1].time - rows[0].time
    spans = flag_spans(rows)
    flagged = sum(span.end - span.start for span in spans)
    share = flagged / duration if duration else float(rows[0].near_singularity)
    lines = [
        f'arm            {", ".join(arm.joint_names)}',
        f'link lengths   {", ".join(f"{a:g}" for a in arm.planar_arm.link_lengths)} m',
        f'thresholds     z_max {thresholds.z_max:g}, margin_min {thresholds.margin_min:g}, '
        f'hysteresis {thresholds.hysteresis:g}',
        f'recording      {rows[0].time:.3f} s to {rows[-1].time:.3f} s, {len(known)} postures, '
        f'{levels.count(Level.ERROR)} bad messages, {levels.count(Level.STALE)} times stale, '
        f'{len(analysis.problems) - levels.count(Level.ERROR)} without a usable time']
    if known:
        worst = min(known, key=lambda row: row.margin)
        highest = max(known, key=lambda row: row.z)
        lines += [
            f'worst moment   {worst.time:.3f} s: margin {worst.margin:.4f}, z {worst.z:.4f}, '
            f'conditioning length {worst.conditioning_length:.4f} m',
            f'highest z      {highest.time:.3f} s: z {highest.z:.4f}, '
            f'margin {highest.margin:.4f}']
    times = 'once' if len(spans) == 1 else f'{len(spans)} times'
    lines.append(f'flag           raised {times}, up for {flagged:.3f} s of '
                 f'{duration:.3f} s ({100.0 * share:.1f} %)')
    lines += [f'  {span.start:.3f} s to {span.end:.3f} s, {_least(span)}'
              for span in spans[:MAX_SPANS]]
    if len(spans) > MAX_SPANS:
        lines.append(f'  ... and {len(spans) - MAX_SPANS} more')
    return lines


def _least(span):
    return ('posture not known' if math.isnan(span.margin)
            else f'least margin {span.margin:.4f}')


def write_csv(rows, path):
    """
    Write verdicts as CSV, one per row, with all digits.

    Parameters
    ----------
    rows : list of Row
    path : path-like
    """
    with Path(path).open('w', encoding='utf-8', newline='') as file:
        writer = csv.writer(file)
        writer.writerow(['time_s', 'z', 'conditioning_length_m', 'margin', 'near_singularity',
                         'level', 'message'])
        for row in rows:
            writer.writerow([*row[:4], int(row.near_singularity), row.level.name, row.message])
