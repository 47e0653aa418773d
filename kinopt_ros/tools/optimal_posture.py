"""Command line: the optimal posture and the characteristic length for given link lengths."""

import argparse
import json
import math
import sys

from kinopt_ros.kinetostatics.optimal_posture import optimal_posture
from kinopt_ros.kinetostatics.posture_record import optimal_posture_record

_MOST_ALTERNATIVES = 8


def main(args=None):
    """
    Print the optimal posture, as a table or as JSON.

    Parameters
    ----------
    args : sequence of str, optional
        Arguments; those of the process by default.

    Returns
    -------
    status : int
        0. Bad arguments end the process with status 2, usage and reason on stderr.
    """
    arguments = sys.argv[1:] if args is None else list(args)
    parser = _parser()
    options = parser.parse_args(list(map(_shown_number, arguments)))
    try:
        posture = optimal_posture(
            options.link_lengths, options.lower, options.upper, options.reference)
    except ValueError as error:
        parser.error(str(error))
    if options.json:
        names = [f'joint_{i}' for i in range(1, len(options.link_lengths) + 1)]
        print(json.dumps(optimal_posture_record(names, posture)))
    else:
        print(_table(posture))
    return 0


def _parser():
    parser = argparse.ArgumentParser(
        prog='optimal_posture',
        description='Posture of a planar serial arm with revolute joints whose normalised '
                    'Jacobian is closest to isotropy, and the characteristic length.',
        epilog='Angles are relative, counterclockwise, 0 where a link continues the one before '
               'it. Options that take angles need one per joint; inf and -inf are no limit.')
    parser.add_argument('link_lengths', nargs='+', type=float, metavar='LENGTH',
                        help='link lengths in m from base to tip, at least three')
    parser.add_argument('--json', action='store_true', help='one JSON object instead of a table')
    for name, meaning in (('lower', 'lower joint limits in rad'),
                          ('upper', 'upper joint limits in rad'),
                          ('reference', 'posture in rad; of equally good ones the nearest to '
                                        'it is given')):
        parser.add_argument(f'--{name}', nargs='+', type=float, metavar='ANGLE', help=meaning)
    return parser


def _shown_number(argument):
    """Put a blank before negative numbers: argparse takes -1e-3 and -inf for options."""
    try:
        float(argument)
    except ValueError:
        return argument
    return f' {argument}' if argument.startswith('-') else argument


def _table(posture):
    bound = 'not computed' if posture.lower_bound is None else f'{posture.lower_bound:.9f}'
    lines = [
        f'z                        {posture.z:.9f}' + (
            '  (isotropic)' if posture.isotropic else ''),
        f'proven lower bound on z  {bound}',
        f'margin to singularity    {posture.margin:.9f}',
        f'characteristic length    {posture.characteristic_length:.9g} m',
        f'conditioning circle      {posture.circle_radius:.9g} m (radius)',
        '',
        'joint    link [m]      angle [rad]   angle [deg]']
    for i, (length, angle) in enumerate(zip(posture.link_lengths, posture.joint_angles), 1):
        lines.append(f'{i:5d}    {length:<10.6g}  {angle:12.6f}  {math.degrees(angle):12.4f}')
    shown = posture.alternatives[:_MOST_ALTERNATIVES]
    if shown:
        lines += ['', 'other optima: z, angles [deg]']
    for alternative in shown:
        degrees = '  '.join(f'{math.degrees(a):9.4f}' for a in alternative.joint_angles)
        lines.append(f'  {alternative.z:.9f}  {degrees}')
    if len(posture.alternatives) > len(shown):
        lines.append(f'  and {len(posture.alternatives) - len(shown)} more (--json gives all)')
    return '\n'.join(lines)


if __name__ == '__main__':
    sys.exit(main())
