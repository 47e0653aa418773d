"""Pictures of z over two conditioning joints: isocontours, the neighbourhood, the surface."""

import math

from matplotlib.lines import Line2D
from matplotlib.patches import Patch
import numpy as np

from kinopt_ros.kinetostatics.hessian import index_expansion
from kinopt_ros.kinetostatics.isocontours import check_joints, index_over_grid
from kinopt_ros.tools.pictures.style import BLACK, COLORMAP, legend_below, new_figure, RED

_FILL_LEVELS = np.linspace(0.0, 1.0, 21)
_LINE_LEVELS = np.linspace(0.1, 0.9, 9)
# Dark lines on the light half of the colour map.
_LINE_COLORS = ['white'] * 5 + [BLACK] * 4
_HALF_TURN = 180.0


def isocontours_figure(arm, posture, joints=(2, 3), z_max=0.9, margin_min=0.05, samples=361,
                       optimum=True):
    """
    Draw z over a full turn of two joints, with singular lines, optima and the flagged region.

    The other joints are held as in `posture`, which is marked; with `optimum`, that it is one,
    its mirror image is marked too if n = 3.
    """
    grid = index_over_grid(arm, samples, joints, posture)
    x, y = np.degrees(grid.first), np.degrees(grid.second)
    figure = new_figure(7.4)
    axes = figure.subplots()
    # The first angle runs along the first axis of the grid, and along x.
    filled = axes.contourf(x, y, grid.index.z.T, _FILL_LEVELS, cmap=COLORMAP)
    figure.colorbar(filled, ax=axes, label='z [-]', ticks=_FILL_LEVELS[::2], shrink=0.85)
    lines = axes.contour(x, y, grid.index.z.T, _LINE_LEVELS, colors=_LINE_COLORS, linewidths=1.0)
    axes.clabel(lines, fmt='%.1f', fontsize=9)
    handles = [_draw_flagged(axes, x, y, grid.index, z_max, margin_min)]
    handles += _draw_singular(axes, arm.n_joints, joints, posture)
    handles.append(_draw_posture(axes, arm.n_joints, joints, posture, optimum))
    _angle_axes(axes, joints)
    axes.set_aspect('equal')
    axes.set_title(f'Isocontours of z, links {_lengths(arm)} m'
                   + _held(arm.n_joints, joints, posture))
    legend_below(figure, handles)
    return figure


def neighbourhood_figure(arm, posture, joints=(2, 3), z_height=0.25, samples=241):
    """
    Draw the isocontours around an optimum up to `z_height` above it, at equal scales.

    The dashed ellipse is the one of the Hessian at half that height.

    Raises
    ------
    ValueError
        If z_height is not positive, or the joints are not two different ones of 2 ... n.
    """
    if not z_height > 0.0:
        raise ValueError(f'z_height = {z_height}: must be positive')
    check_joints(joints, arm.n_joints)
    hessian = _hessian_of_slice(arm, posture, joints)
    # As far as the second-order expansion of z reaches z_height above the optimum, and more.
    half_widths = np.minimum(
        1.5 * np.sqrt(2.0 * z_height * np.diag(np.linalg.inv(hessian))), math.pi)
    centre = np.array([posture[joint - 1] for joint in joints])
    ranges = np.transpose([centre - half_widths, centre + half_widths])
    grid = index_over_grid(arm, samples, joints, posture, *ranges)
    x, y = np.degrees(grid.first), np.degrees(grid.second)
    least = float(grid.index.z.min())
    # Axes of about 6 inches width, and room for title and legend.
    figure = new_figure(1.7 + min(6.0 * half_widths[1] / half_widths[0], 6.0))
    axes = figure.subplots()
    levels = least + z_height * np.linspace(0.0, 1.0, 11)
    filled = axes.contourf(x, y, grid.index.z.T, levels, cmap=COLORMAP, extend='max')
    lines = axes.contour(x, y, grid.index.z.T, levels[2:-1:2], linewidths=1.0,
                         colors=['white', 'white', BLACK, BLACK])
    axes.clabel(lines, fmt='%.2f', fontsize=9)
    figure.colorbar(filled, ax=axes, label='z [-]', shrink=0.85, format='%.2f')
    star = axes.plot(*np.degrees(centre), '*', markersize=16, color='white',
                     markeredgecolor=BLACK, linestyle='none', label='optimum')[0]
    ellipse = _draw_ellipse(axes, hessian, centre, 0.5 * z_height)
    axes.set_aspect('equal')
    axes.set_xlabel(_angle_name(joints[0]))
    axes.set_ylabel(_angle_name(joints[1]))
    axes.set_title(f'z near the optimum, links {_lengths(arm)} m'
                   + _held(arm.n_joints, joints, posture))
    legend_below(figure, [star, ellipse])
    return figure


def surface_figure(arm, posture, joints=(2, 3), samples=145):
    """Draw z as a surface over a full turn of two joints."""
    grid = index_over_grid(arm, samples, joints, posture)
    x, y = np.meshgrid(np.degrees(grid.first), np.degrees(grid.second), indexing='ij')
    figure = new_figure(6.2)
    axes = figure.add_subplot(projection='3d')
    surface = axes.plot_surface(x, y, grid.index.z, cmap=COLORMAP, vmin=0.0, vmax=1.0,
                                rcount=samples, ccount=samples, linewidth=0, antialiased=False)
    axes.view_init(elev=58, azim=-60)
    _angle_axes(axes, joints, step=90)
    axes.xaxis.labelpad = axes.yaxis.labelpad = 12
    axes.set_zlim(0.0, 1.0)
    axes.set_zlabel('z [-]')
    axes.set_box_aspect((1.0, 1.0, 0.6), zoom=0.86)
    figure.colorbar(surface, ax=axes, label='z [-]', shrink=0.7)
    axes.set_title(f'z over the conditioning joints, links {_lengths(arm)} m'
                   + _held(arm.n_joints, joints, posture))
    return figure


def _draw_flagged(axes, x, y, index, z_max, margin_min):
    """Hatch where z > z_max or margin < margin_min; give the handle of the legend."""
    beyond = np.maximum(index.z - z_max, margin_min - index.margin).T
    if beyond.max() > 0.0:
        axes.contourf(x, y, beyond, [0.0, np.inf], colors='none', hatches=['////'])
        axes.contour(x, y, beyond, [0.0], colors=BLACK, linewidths=2.4)
    return Patch(facecolor='none', edgecolor=BLACK, hatch='////',
                 label=f'flagged: z > {z_max:.4g} or margin < {margin_min:.4g}')


def _draw_singular(axes, n_joints, joints, posture):
    """Draw the singular lines or points of a slice; give the handles of the legend."""
    inner = set(range(2, n_joints))
    folded = all(abs(math.sin(posture[joint - 1])) < 1e-9 for joint in inner - set(joints))
    varied = [joint in inner for joint in joints]
    if not folded:
        return []
    if all(varied):
        ticks = np.arange(3) * _HALF_TURN
        points = [(a, b) for a in ticks for b in ticks]
        axes.plot(*zip(*points), 'X', color=RED, markersize=9, clip_on=False)
        return [Line2D([], [], marker='X', color=RED, linestyle='none', label='singular')]
    draw_line = axes.axvline if varied[0] else axes.axhline
    for at in (0.0, _HALF_TURN, 2.0 * _HALF_TURN):
        draw_line(at, color=RED, linewidth=2.5, linestyle='--', clip_on=False)
    return [Line2D([], [], color=RED, linewidth=2.5, linestyle='--', label='singular')]


def _draw_posture(axes, n_joints, joints, posture, optimum):
    at = np.array([posture[joint - 1] for joint in joints])
    # For n > 3 the mirror image is in another slice.
    marked = np.array([at, -at] if optimum and n_joints == 3 else [at])
    name = 'posture' if not optimum else 'optimum' if len(marked) == 1 else 'optima'
    return axes.plot(*np.degrees(marked % (2.0 * math.pi)).T, '*', markersize=17, color='white',
                     markeredgecolor=BLACK, linestyle='none', label=name)[0]


def _hessian_of_slice(arm, posture, joints):
    """Second derivatives of z by the two joints, in 1/rad^2."""
    places = [joint - 2 for joint in joints]
    hessian = index_expansion(arm, np.array([posture[1:]])).hessian[0]
    return hessian[np.ix_(places, places)]


def _draw_ellipse(axes, hessian, centre, height):
    """Draw where the second-order expansion of z is `height` above its value at the centre."""
    values, vectors = np.linalg.eigh(hessian)
    turn = np.linspace(0.0, 2.0 * math.pi, 181)
    circle = np.array([np.cos(turn), np.sin(turn)])
    offsets = vectors @ (np.sqrt(2.0 * height / values)[:, np.newaxis] * circle)
    ratio = math.sqrt(values[1] / values[0])
    return axes.plot(*np.degrees(centre[:, np.newaxis] + offsets), '--', color=RED, linewidth=2,
                     label=f'ellipse of the Hessian, axes {ratio:.2f} : 1')[0]


def _angle_axes(axes, joints, step=60):
    axes.set_xlabel(_angle_name(joints[0]))
    axes.set_ylabel(_angle_name(joints[1]))
    axes.set_xticks(range(0, 361, step))
    axes.set_yticks(range(0, 361, step))


def _angle_name(joint):
    return rf'$\theta_{{{joint}}}$ [°]'


def _lengths(arm):
    return ', '.join(f'{length:.4g}' for length in arm.link_lengths)


def _held(n_joints, joints, posture):
    """Tell in words at which angles the joints outside the slice are held."""
    held = [joint for joint in range(2, n_joints + 1) if joint not in joints]
    if not held:
        return ''
    angles = ', '.join(rf'$\theta_{{{joint}}}$ = {math.degrees(posture[joint - 1]):.1f}°'
                       for joint in held)
    return f'\nheld: {angles}'
