"""
Pictures of planar arms and of the paper's ideas, to PNG or SVG files.

    ros2 run kinopt_ros plot isocontours --link-lengths 1 1 1 -o isocontours.png
"""

import argparse
import math
from pathlib import Path
import sys

from kinopt_ros.kinetostatics.isotropic_chains import design_isotropic_arms
from kinopt_ros.kinetostatics.isotropic_sets import regular_polygon
from kinopt_ros.kinetostatics.optimal_posture import optimal_posture
from kinopt_ros.kinetostatics.planar_arm import PlanarArm
from kinopt_ros.kinetostatics.singular_postures import z_crit

_INSTALL_HINT = 'apt install python3-matplotlib, or pip install matplotlib'


def main(args=None):
    """Draw what the command line asks for; give the exit status, 0 or 1."""
    options = _parser().parse_args(args)
    try:
        from kinopt_ros.tools.pictures import style
    except ImportError as error:
        return _complain(f'pictures need matplotlib ({error}): {_INSTALL_HINT}')
    try:
        with style.styled():
            for path, figure in options.draw(options):
                style.save(figure, path)
                print(path)
    except (OSError, ValueError) as error:
        return _complain(error)
    return 0


def _complain(message):
    print(f'plot: {message}', file=sys.stderr)
    return 1


def _posture(options):
    from kinopt_ros.tools.pictures.postures import posture_figure
    arm = _arm(options)
    yield options.output, posture_figure(arm, _joint_angles(options, arm))


def _isocontours(options):
    from kinopt_ros.tools.pictures.contours import isocontours_figure
    arm = _arm(options)
    z_max = z_crit(arm) if options.z_max == 'z_crit' else options.z_max
    yield options.output, isocontours_figure(
        arm, _joint_angles(options, arm), tuple(options.joints), z_max, options.margin_min,
        optimum=options.joint_angles is None)


def _neighbourhood(options):
    from kinopt_ros.tools.pictures.contours import neighbourhood_figure
    arm = _arm(options)
    yield options.output, neighbourhood_figure(
        arm, optimal_posture(arm).joint_angles, tuple(options.joints), options.z_height)


def _surface(options):
    from kinopt_ros.tools.pictures.contours import surface_figure
    arm = _arm(options)
    yield options.output, surface_figure(arm, _joint_angles(options, arm), tuple(options.joints))


def _thresholds(options):
    from kinopt_ros.tools.pictures.thresholds import thresholds_figure
    arm = _arm(options)
    z_max = z_crit(arm) if options.z_max == 'z_crit' else options.z_max
    yield options.output, thresholds_figure(
        arm, z_max, options.margin_min, math.radians(options.neighbourhood))


def _sets(options):
    from kinopt_ros.tools.pictures.sets import rotation_figure, trivial_sets_figure, union_figure
    if options.union:
        figure = union_figure(*map(regular_polygon, options.union))
    elif options.rotation:
        n, angle = options.rotation
        figure = rotation_figure(regular_polygon(int(n)), math.radians(angle))
    else:
        figure = trivial_sets_figure(options.vertices)
    yield options.output, figure


def _chains(options):
    from kinopt_ros.tools.pictures.chains import chains_figure
    reach = 1.0 if options.reach is None and options.d_rms is None else options.reach
    chains = design_isotropic_arms(options.number, reach, options.d_rms)
    yield options.output, chains_figure(chains, options.at_most)


def _seam(options):
    from kinopt_ros.tools.pictures.paper import tool_angle_on_circle
    from kinopt_ros.tools.pictures.seams import seam_figure
    arm = _arm(options)
    optimum = optimal_posture(arm)
    tool_angle = (tool_angle_on_circle(arm, optimum) if options.tool_angle is None
                  else math.radians(options.tool_angle))
    yield options.output, seam_figure(arm, optimum, options.length, tool_angle)


def _figures(options):
    from kinopt_ros.tools.pictures.paper import paper_figures
    directory = Path(options.directory)
    directory.mkdir(parents=True, exist_ok=True)
    for name, figure in paper_figures():
        yield directory / f'{name}.png', figure


def _arm(options):
    return PlanarArm(options.link_lengths)


def _joint_angles(options, arm):
    """Joint angles in rad: those of the command line, or the arm's optimum."""
    if options.joint_angles is None:
        return optimal_posture(arm).joint_angles
    if len(options.joint_angles) != arm.n_joints:
        raise ValueError(f'--joint-angles has {len(options.joint_angles)} values: must hold '
                         f'{arm.n_joints}, one per link length')
    return [math.radians(angle) for angle in options.joint_angles]


def _parser():
    parser = argparse.ArgumentParser(prog='plot', description=__doc__.strip().splitlines()[0])
    commands = parser.add_subparsers(required=True, metavar='PICTURE')

    def command(name, draw, summary):
        sub = commands.add_parser(name, help=summary, description=summary)
        sub.set_defaults(draw=draw)
        return sub

    _add(command('posture', _posture, 'an arm in a posture, with its closest isotropic set and '
                 'the conditioning circle'), _link_lengths, _angles, _output)
    _add(command('isocontours', _isocontours, 'z over a full turn of two joints, with singular '
                 'lines, optima and flagged region'),
         _link_lengths, _angles, _joints, _threshold_options, _output)
    near = command('neighbourhood', _neighbourhood, 'the isocontours around the optimum, with the '
                   'ellipse of the Hessian')
    near.add_argument('--z-height', type=float, default=0.25, metavar='Z',
                      help='how far above its least value z is drawn (0.25)')
    _add(near, _link_lengths, _joints, _output)
    _add(command('surface', _surface, 'z as a surface over two joints'),
         _link_lengths, _angles, _joints, _output)
    thresholds = command('thresholds', _thresholds, 'what the two thresholds flag, miss and '
                         'falsely alarm')
    thresholds.add_argument('--neighbourhood', type=float, default=5.0, metavar='DEG',
                            help='near a singular posture: each joint within this (5)')
    _add(thresholds, _link_lengths, _threshold_options, _output)
    sets = command('sets', _sets, 'isotropic sets of points: regular polygons, or the union of '
                   'two, or one with its turned image')
    kinds = sets.add_mutually_exclusive_group()
    kinds.add_argument('--vertices', type=int, nargs='+', default=[3, 4, 5, 6], metavar='N',
                       help='draw these polygons (3 4 5 6)')
    kinds.add_argument('--union', type=int, nargs=2, metavar='N', help='draw two and their union')
    kinds.add_argument('--rotation', type=float, nargs=2, metavar=('N', 'DEG'),
                       help='draw one, its image turned by DEG, and their union')
    _add(sets, _output)
    chains = command('chains', _chains, 'the isotropic arms of n joints that a regular polygon '
                     'generates')
    chains.add_argument('-n', '--number', type=int, default=4, metavar='N',
                        help='number of joints (4)')
    size = chains.add_mutually_exclusive_group()
    size.add_argument('--reach', type=float, metavar='M', help='wanted reach in m (1)')
    size.add_argument('--d-rms', type=float, metavar='M', help='wanted d_rms in m')
    chains.add_argument('--at-most', type=int, default=12, help='how many to draw (12)')
    _add(chains, _output)
    seam = command('seam', _seam, 'the best place of a straight seam and z along it, for three '
                   'joints')
    seam.add_argument('--length', type=float, default=0.8, metavar='M',
                      help='length of the seam in m (0.8)')
    seam.add_argument('--tool-angle', type=float, metavar='DEG', help='from the seam to the last '
                      'link (as at the optimum, with the seam along the conditioning circle)')
    _add(seam, _link_lengths, _output)
    figures = command('figures', _figures, "all of the paper's figures")
    figures.add_argument('directory', nargs='?', default='docs/figures', metavar='DIR',
                         help='where to write them (docs/figures)')
    return parser


def _add(parser, *option_groups):
    for add_options in option_groups:
        add_options(parser)


def _link_lengths(parser):
    parser.add_argument('--link-lengths', type=float, nargs='+', metavar='M',
                        default=[1.0, 1.0, math.sqrt(3.0) / 3.0],
                        help="in m, base to tip (the paper's isotropic arm)")


def _angles(parser):
    parser.add_argument('--joint-angles', type=float, nargs='+', metavar='DEG',
                        help='posture in degrees (the optimum)')


def _joints(parser):
    parser.add_argument('--joints', type=int, nargs=2, default=[2, 3], metavar='I',
                        help='the two joints of the axes (2 3); the others are held')


def _threshold_options(parser):
    parser.add_argument('--z-max', type=_z_max, default=0.9, metavar='Z',
                        help='flagged above it (0.9); z_crit for the least z of the singular '
                        'postures')
    parser.add_argument('--margin-min', type=float, default=0.05, metavar='MARGIN',
                        help='flagged below it (0.05)')


def _z_max(text):
    return text if text == 'z_crit' else float(text)


def _output(parser):
    parser.add_argument('-o', '--output', required=True, metavar='FILE', help='.png or .svg')


if __name__ == '__main__':
    raise SystemExit(main())
