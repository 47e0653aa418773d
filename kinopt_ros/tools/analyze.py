"""
The command that says what the monitor would have said of a recording.

It writes the verdicts as CSV and as a picture, and sums them up.
"""

import argparse
from pathlib import Path
import reprlib
import sys

from rclpy.parameter import Parameter

from kinopt_ros.monitor.configuration import Configuration
from kinopt_ros.monitor.described_arm import arm_parameters, DescribedArm
from kinopt_ros.monitor.parameters import DESCRIPTION_TABLE, MONITOR_TABLE
from kinopt_ros.tools.parameter_file import parameters_of_file
from kinopt_ros.tools.recordings import read_recording
from kinopt_ros.tools.replay import replay, summary, write_csv

NODE = 'singularity_monitor'

# Places where something is wrong in a recording that are printed one by one.
MAX_PROBLEMS = 20

# Parameters of the monitor that the command line can set; a parameter file can set them all.
OPTIONS = ('joint_names', 'link_lengths', 'joint_offsets', 'joint_directions', 'z_max',
           'margin_min', 'hysteresis', 'min_dwell', 'stale_timeout', 'base_link', 'tip_link',
           'tool_offset', 'held_joints', 'held_positions')

_ITEM_TYPES = {
    Parameter.Type.BOOL: bool, Parameter.Type.STRING: str, Parameter.Type.DOUBLE: float,
    Parameter.Type.DOUBLE_ARRAY: float, Parameter.Type.INTEGER_ARRAY: int,
    Parameter.Type.STRING_ARRAY: str}
_ARRAYS = (Parameter.Type.DOUBLE_ARRAY, Parameter.Type.INTEGER_ARRAY,
           Parameter.Type.STRING_ARRAY)


def configuration_of(options):
    """
    Build the configuration that the command line asks for.

    A value given on the command line wins over one from the parameter file, and this over one
    derived from a robot description.

    Parameters
    ----------
    options : argparse.Namespace

    Returns
    -------
    configuration : Configuration

    Raises
    ------
    ValueError, OSError, ImportError
        If something asked for cannot be had; says what.
    """
    given = parameters_of_file(options.params_file, NODE) if options.params_file else {}
    given.update((name, value) for name in OPTIONS
                 if (value := getattr(options, name)) is not None)
    if options.robot_description:
        given['robot_description'] = options.robot_description.read_text(
            encoding='utf-8', errors='replace')
    for row in (*DESCRIPTION_TABLE, *MONITOR_TABLE):
        if row.name in given:
            given[row.name] = _typed(row, given[row.name])
    if given.get('base_link') or given.get('tip_link'):
        given = {**_derived(given), **given}
    n = len(given.get('joint_names', ()))
    defaults = {row.name: _default(row, n) for row in MONITOR_TABLE}
    return Configuration.from_parameters({**defaults, **given})


def _default(row, n_joints):
    return row.default(n_joints, NODE) if callable(row.default) else row.default


def _derived(given):
    """Parameters of the arm from a robot description."""
    values = {row.name: given.get(row.name, _default(row, 0)) for row in DESCRIPTION_TABLE}
    if not values['robot_description']:
        raise ValueError('base_link and tip_link are links of a robot description: give it with '
                         '--robot-description')
    arm = DescribedArm.from_parameters(values, given.get('joint_names'))
    subchain = arm.subchain(values['robot_description'])
    for name in subchain.tip_movers:
        print(f"warning: the operation point moves with joint '{name}', which is taken at 0",
              file=sys.stderr)
    return arm_parameters(subchain)


def _typed(row, value):
    """See that a value is of the kind that its parameter is; a whole number may be a double."""
    kind = _ITEM_TYPES[row.kind]
    items = value if row.kind in _ARRAYS else [value]
    accepted = (int, float) if kind is float else (kind,)
    if not isinstance(items, list) or not all(
            type(item) in accepted for item in items):
        raise ValueError(f'parameter {row.name} = {reprlib.repr(value)}: must be of the type '
                         f'{row.kind.name.lower()}')
    return [kind(item) for item in items] if row.kind in _ARRAYS else kind(value)


def _parser():
    parser = argparse.ArgumentParser(
        prog='analyze', description='What the monitor would have said of a recording.')
    parser.add_argument('recording', type=Path,
                        help='CSV (time in s, positions in rad) or rosbag2 (mcap, sqlite3)')
    parser.add_argument('--csv', type=Path, metavar='FILE',
                        help='where the verdicts go (default: RECORDING_analysis.csv, here)')
    parser.add_argument('--picture', type=Path, metavar='FILE',
                        help='where the picture goes (default: RECORDING_analysis.png, here)')
    parser.add_argument('--columns', nargs='+', metavar='NAME',
                        help='columns of a CSV without header; the time is called time')
    parser.add_argument('--topic', help='topic of a bag with joint states on several')
    arm = parser.add_argument_group("the arm and the thresholds, the monitor's parameters")
    arm.add_argument('--params-file', type=Path, metavar='FILE',
                     help="ROS parameter file, the monitor's own")
    arm.add_argument('--robot-description', type=Path, metavar='FILE',
                     help='URDF file, if the arm is to be found in it')
    rows = {row.name: row for row in (*DESCRIPTION_TABLE, *MONITOR_TABLE)}
    for row in map(rows.get, OPTIONS):
        arm.add_argument(f'--{row.name.replace("_", "-")}', dest=row.name,
                         nargs='+' if row.kind in _ARRAYS else None, type=_ITEM_TYPES[row.kind],
                         metavar='VALUE', help=row.description.replace('%', '%%'))
    return parser


def _checked_options(args):
    parser = _parser()
    options = parser.parse_args(args)
    stem = options.recording.resolve().stem
    options.csv = options.csv or Path(f'{stem}_analysis.csv')
    options.picture = options.picture or Path(f'{stem}_analysis.png')
    if options.recording.resolve() in (options.csv.resolve(), options.picture.resolve()):
        parser.error('the recording itself would be overwritten')
    return options


class _ProgressBar:
    """Bar on the terminal after the first second, where tqdm is installed."""

    def __init__(self):
        self._bar = None

    def __call__(self, done, total):
        if self._bar is None:
            try:
                from tqdm import tqdm
            except ImportError:
                self._bar = False
            else:
                self._bar = tqdm(total=total, delay=1.0, disable=None, unit='',
                                 unit_scale=True, leave=False)
        if self._bar:
            self._bar.update(done - self._bar.n)

    def close(self):
        if self._bar:
            self._bar.close()


def main(args=None):
    """Analyse a recording; the exit status is returned."""
    options = _checked_options(args)
    progress = _ProgressBar()
    try:
        configuration = configuration_of(options)
        analysis = replay(
            read_recording(options.recording, configuration.arm.joint_names, options.columns,
                           options.topic, progress), configuration)
    except (ValueError, OverflowError, OSError, ImportError) as error:
        return _fail(error)
    except KeyboardInterrupt:
        return _fail('interrupted')
    finally:
        progress.close()
    _report_problems(analysis.problems)
    if not analysis.rows:
        return _fail(f'{options.recording}: no message concerns the joints '
                     f'{", ".join(configuration.arm.joint_names)}')
    print('\n'.join(summary(analysis, configuration)))
    try:
        options.csv.parent.mkdir(parents=True, exist_ok=True)
        write_csv(analysis.rows, options.csv)
        print(f'verdicts       {options.csv}')
        return _draw(analysis.rows, configuration.thresholds, options)
    except OSError as error:
        return _fail(error)


def _draw(rows, thresholds, options):
    try:
        from kinopt_ros.tools.pictures.over_time import over_time_figure
        from kinopt_ros.tools.pictures.style import draw
    except ImportError as error:
        return _fail(f'no picture without matplotlib: pip install matplotlib ({error})')
    draw(options.picture, over_time_figure, rows, thresholds, options.recording.name)
    print(f'picture        {options.picture}')
    return 0


def _report_problems(problems):
    for place, reason in problems[:MAX_PROBLEMS]:
        print(f'warning: {place}: {reason}', file=sys.stderr)
    if len(problems) > MAX_PROBLEMS:
        print(f'warning: ... and {len(problems) - MAX_PROBLEMS} more places', file=sys.stderr)


def _fail(error):
    print(f'error: {error}', file=sys.stderr)
    return 1


if __name__ == '__main__':
    sys.exit(main())
