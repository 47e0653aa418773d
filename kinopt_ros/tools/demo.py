"""The demonstration: a monitor and a simulated arm as two processes, watched from a third."""

import argparse
import math
from pathlib import Path
import sys
import time

from kinopt_ros.monitor.verdict import Thresholds
from kinopt_ros.tools.child_processes import run_with_children, use_private_domain
from kinopt_ros.tools.recorder import Recorder

JOINT_NAMES = ['joint_1', 'joint_2', 'joint_3']
LINK_LENGTHS = [1.0, 1.0, math.sqrt(3.0) / 3.0]
WATCH_TIME = 15.0
LINE_PERIOD = 0.5
TITLE = 'An arm passes its best posture (z = 0) and straightens out (margin = 0)'
START_DEADLINE = 20.0


def main(args=None):
    """Run the demonstration; the exit status is returned."""
    parser = argparse.ArgumentParser(
        description='Watch a simulated arm pass its best posture and a singularity.')
    parser.add_argument('--picture', type=Path, default=Path('output/demo.png'),
                        help='where the picture goes (default: %(default)s)')
    parser.add_argument('--seconds', type=float, default=WATCH_TIME,
                        help='how long to watch (default: %(default)s)')
    options = parser.parse_args(args)
    use_private_domain()
    arm = ['-p', f'joint_names:=[{", ".join(JOINT_NAMES)}]',
           '-p', f'link_lengths:=[{", ".join(map(repr, LINK_LENGTHS))}]']

    def watch(processes):
        processes.start('singularity_monitor', *arm)
        processes.start('simulated_arm', *arm)
        return _watch(options.seconds, processes)

    return run_with_children(watch, lambda recording: _draw(recording, options.picture))


def _watch(seconds, processes):
    """Print a line from time to time and return what was heard."""
    with Recorder('singularity_monitor') as recorder:
        deadline = time.monotonic() + START_DEADLINE
        while not recorder.rows and time.monotonic() < deadline:
            _spin(recorder, processes, 0.1)
        if not recorder.rows:
            raise TimeoutError(f'nothing was heard of the monitor for {START_DEADLINE:g} s')
        end = time.monotonic() + seconds
        print('   time       z   conditioning length   margin   flag')
        while time.monotonic() < end:
            _spin(recorder, processes, LINE_PERIOD)
            print(_line(recorder.rows))
        return recorder.rows


def _spin(recorder, processes, seconds):
    recorder.spin_for(seconds)
    processes.check()


def _line(rows):
    row = rows[-1]
    return (f'{row.time - rows[0].time:5.1f} s  {row.z:.4f}              '
            f'{row.conditioning_length:.4f} m   {row.margin:.4f}   '
            f'{"NEAR SINGULARITY" if row.near_singularity else "clear"}')


def _draw(recording, path):
    try:
        from kinopt_ros.tools.pictures.over_time import over_time_figure
        from kinopt_ros.tools.pictures.style import draw
    except ImportError as error:
        print(f'error: no picture without matplotlib ({error})', file=sys.stderr)
        return 1
    draw(path, over_time_figure, recording, Thresholds(), TITLE)
    print(f'picture: {path}')
    return 0
