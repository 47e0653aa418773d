"""What all pictures share: colours, sizes, figures and files."""

import math

import matplotlib
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
import numpy as np

# Okabe and Ito's colours, told apart with any colour vision.
BLACK = '#000000'
BLUE = '#0072B2'
GREEN = '#009E73'
GREY = '#767676'
ORANGE = '#E69F00'
RED = '#D55E00'

COLORMAP = 'cividis'

# A figure is 8 inches wide, shown at 800 pixels: 100 pixels per inch on the page.
WIDTH = 8.0

# Points of the unit circle, counterclockwise from 1; the first 91 are the upper half.
CIRCLE = np.exp(1j * np.linspace(0.0, 2.0 * math.pi, 181))

# Around text that may lie on a line.
HALO = [withStroke(linewidth=3, foreground='white')]

STYLE = {
    'axes.axisbelow': True,
    'axes.titlesize': 11,
    'axes.labelsize': 11,
    'figure.facecolor': 'white',
    'font.size': 11,
    'grid.color': '#dddddd',
    'hatch.linewidth': 0.7,
    'legend.fontsize': 10,
    'legend.framealpha': 0.9,
    'mathtext.fontset': 'dejavusans',
    'savefig.dpi': 150,
    'svg.hashsalt': 'kinopt_ros',
    'xtick.labelsize': 10,
    'ytick.labelsize': 10,
}


def styled():
    """Context in which to draw and to save."""
    return matplotlib.rc_context(STYLE)


def new_figure(height):
    """Give an empty figure of the given height in inches, without any window."""
    return Figure(figsize=(WIDTH, height), layout='constrained')


def legend_below(figure, handles, **options):
    """Put a legend of one row under everything else; options as of Figure.legend."""
    # loc='outside lower center' needs matplotlib 3.7, and Jazzy's Ubuntu has 3.6.
    height = 0.42 / figure.get_figheight()
    figure.get_layout_engine().set(rect=(0.0, height, 1.0, 1.0 - height))
    figure.legend(handles=handles, loc='lower center', ncols=len(handles), **options)


def save(figure, path):
    """
    Write a figure to a file, in the format that its name ends with, the same bytes each time.

    Raises
    ------
    ValueError
        If the name does not end with .png or .svg.
    OSError
        If the file cannot be written.
    """
    path = str(path)
    if path.endswith('.png'):
        figure.savefig(path, metadata={'Software': None})
    elif path.endswith('.svg'):
        figure.savefig(path, metadata={'Date': None})
    else:
        raise ValueError(f'file {path}: its name must end with .png or .svg')


def draw(path, figure_of, *arguments):
    """Make a figure in the common style and write it to a path, with the folders it needs."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with styled():
        save(figure_of(*arguments), path)


def plane_axes(axes, unit='m', ticks=6):
    """Make axes show the plane of the arm at equal scales."""
    axes.set_aspect('equal', adjustable='box')
    axes.set_xlabel(f'x [{unit}]')
    axes.set_ylabel(f'y [{unit}]')
    axes.locator_params(nbins=ticks)
    axes.grid(True)


def fit(axes, points, margin=0.12):
    """Set the limits of plane axes around complex points."""
    x, y = points.real, points.imag
    pad = margin * max(x.max() - x.min(), y.max() - y.min())
    axes.set_xlim(x.min() - pad, x.max() + pad)
    axes.set_ylim(y.min() - pad, y.max() + pad)
