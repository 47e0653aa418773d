"""The plot command: every picture is drawn and shows what it should; errors are one line."""

from itertools import cycle
import math
import os
from pathlib import Path
import subprocess
import sys

import numpy as np
import pytest

matplotlib = pytest.importorskip('matplotlib')

from kinopt_ros.kinetostatics.index import kinetostatic_index  # noqa: E402
from kinopt_ros.kinetostatics.isotropic_chains import design_isotropic_arms  # noqa: E402
from kinopt_ros.kinetostatics.optimal_posture import optimal_posture  # noqa: E402
from kinopt_ros.kinetostatics.planar_arm import PlanarArm  # noqa: E402
from kinopt_ros.tools import plot  # noqa: E402
from kinopt_ros.tools.pictures.chains import chains_figure  # noqa: E402
from kinopt_ros.tools.pictures.contours import isocontours_figure, neighbourhood_figure  # noqa: E402
from kinopt_ros.tools.pictures.paper import paper_figures, tool_angle_on_circle  # noqa: E402
from kinopt_ros.tools.pictures.postures import joint_centres, posture_figure  # noqa: E402
from kinopt_ros.tools.pictures.seams import seam_figure  # noqa: E402
from kinopt_ros.tools.pictures.style import save, styled  # noqa: E402

ISOTROPIC = PlanarArm((1.0, 1.0, math.sqrt(3.0) / 3.0))
EQUILATERAL = PlanarArm((1.0, 1.0, 1.0))

COMMANDS = [
    'posture --link-lengths 1 0.9 0.8 0.7 0.6 0.5',
    'posture --joint-angles 10 20 30',
    'isocontours --link-lengths 1 1 1 --z-max z_crit --margin-min 0.1',
    'isocontours --link-lengths 1 .8 .6 .4 --joints 3 4 --joint-angles 0 180 10 20',
    'isocontours --link-lengths 1 .8 .6 .4 --joints 2 3',
    'neighbourhood --link-lengths 1 1 1 1 --joints 4 2 --z-height 0.1',
    'surface --link-lengths 1 1 1',
    'thresholds --link-lengths 1 1 1 --neighbourhood 10',
    'sets', 'sets --vertices 3 4 5 6 7', 'sets --union 5 6', 'sets --rotation 3 45',
    'chains -n 5 --d-rms 0.5 --at-most 4', 'chains -n 3',
    'seam --length 0.4 --tool-angle 60',
]


def is_picture(path):
    head = path.read_bytes()[:300]
    return head.startswith(b'\x89PNG') if path.suffix == '.png' else b'<?xml' in head


@pytest.mark.parametrize(('command', 'suffix'), list(zip(COMMANDS, cycle(['.png', '.svg']))))
def test_every_picture_is_drawn(command, suffix, tmp_path, capsys):
    path = tmp_path / f'picture{suffix}'
    assert plot.main([*command.split(), '-o', str(path)]) == 0
    assert is_picture(path) and path.stat().st_size > 5000
    assert capsys.readouterr() == (f'{path}\n', '')


@pytest.fixture(scope='module')
def figures():
    with styled():
        return dict(paper_figures())


def test_figures_of_the_paper_are_all_there(figures):
    numbered = sorted(name[:5] for name in figures if name.startswith('fig'))
    assert numbered == [f'fig{i:02d}' for i in range(1, 16)]


def test_nothing_is_small_or_beyond_the_edge(figures):
    for name, figure in figures.items():
        with styled():
            figure.draw_without_rendering()
            box = figure.get_tightbbox()
        width, height = figure.get_size_inches()
        assert width == 8.0
        assert box.x0 >= -0.01 and box.y0 >= -0.01, (name, box)
        assert box.x1 <= width + 0.01 and box.y1 <= height + 0.01, (name, box)
        # In points, where a figure 8 inches wide is shown at 800 pixels.
        sizes = {text.get_fontsize() for text in figure.findobj(matplotlib.text.Text)}
        assert min(sizes) >= 9, name


def test_axes_have_units(figures):
    for name, figure in figures.items():
        for axes in figure.axes:
            labels = [axes.get_xlabel(), axes.get_ylabel()]
            if axes.get_visible() and any(labels):
                assert all('[' in label for label in labels if label), (name, labels)


def test_pictures_in_docs_are_these(figures):
    directory = Path(__file__).parents[2] / 'docs' / 'figures'
    assert set(figures) <= {path.stem for path in directory.glob('*.png')}


def test_the_same_picture_has_the_same_bytes(tmp_path):
    for suffix in ('.png', '.svg'):
        paths = [tmp_path / f'{i}{suffix}' for i in range(2)]
        for path in paths:
            assert plot.main(['posture', '-o', str(path)]) == 0
        assert paths[0].read_bytes() == paths[1].read_bytes()


def test_posture_shows_the_arm_where_forward_kinematics_put_it():
    angles = np.radians([30.0, 40.0, 50.0])
    axes = posture_figure(EQUILATERAL, angles).axes[0]
    phi = np.cumsum(angles)
    corners = np.cumsum(np.concatenate([[0.0], np.exp(1j * phi)]))
    lines = [line.get_xdata() + 1j * np.asarray(line.get_ydata()) for line in axes.lines]
    assert any(len(line) == 4 and np.allclose(line, corners) for line in lines)
    joints, tip = joint_centres(EQUILATERAL, angles)
    assert np.append(joints, tip) == pytest.approx(corners)
    radius = np.abs(lines[0])
    assert radius == pytest.approx(abs(corners[-1]))


def test_isotropic_set_covers_the_joints_of_an_isotropic_posture():
    optimum = optimal_posture(ISOTROPIC).joint_angles
    axes = posture_figure(ISOTROPIC, optimum).axes[0]
    squares, = [line for line in axes.lines if line.get_marker() == 's']
    joints, _ = joint_centres(ISOTROPIC, optimum)
    assert squares.get_xdata() + 1j * squares.get_ydata() == pytest.approx(joints, abs=1e-6)


def test_isocontours_mark_optima_and_singular_lines():
    optimum = optimal_posture(EQUILATERAL).joint_angles
    axes = isocontours_figure(EQUILATERAL, optimum, samples=181).axes[0]
    stars, = [line for line in axes.lines if line.get_marker() == '*']
    assert sorted(stars.get_xdata()) == pytest.approx([81.8, 278.2], abs=0.1)
    assert sorted(stars.get_ydata()) == pytest.approx([155.2, 204.8], abs=0.1)
    lines = [line.get_xdata()[0] for line in axes.lines if line.get_linestyle() == '--']
    assert lines == [0.0, 180.0, 360.0]


def test_isocontours_run_along_the_right_axes(monkeypatch):
    drawn = []

    def record(self, x, y, z, *args, **kwargs):
        drawn.append((x, y, z))
        return contour(self, x, y, z, *args, **kwargs)

    contour = matplotlib.axes.Axes.contour
    monkeypatch.setattr(matplotlib.axes.Axes, 'contour', record)
    optimum = optimal_posture(EQUILATERAL).joint_angles
    axes = isocontours_figure(EQUILATERAL, optimum, samples=13).axes[0]
    assert [axes.get_xlabel(), axes.get_ylabel()] == [r'$\theta_{2}$ [°]', r'$\theta_{3}$ [°]']
    x, y, z = drawn[0]
    assert (x[4], y[7]) == pytest.approx((120.0, 210.0))
    # matplotlib's rows run along y.
    assert z[7, 4] == pytest.approx(
        kinetostatic_index(EQUILATERAL, np.radians([0.0, 120.0, 210.0])).z)


@pytest.mark.parametrize(('arm', 'ratio'), [(ISOTROPIC, '1.22 : 1'), (EQUILATERAL, '2.04 : 1')])
def test_neighbourhood_names_the_ratio_of_the_axes(arm, ratio):
    figure = neighbourhood_figure(arm, optimal_posture(arm).joint_angles, samples=61)
    assert any(ratio in text.get_text() for text in figure.legends[0].get_texts())


def test_seam_is_drawn_at_its_place():
    optimum = optimal_posture(ISOTROPIC)
    tool_angle = tool_angle_on_circle(ISOTROPIC, optimum)
    assert math.degrees(tool_angle) == pytest.approx(150.0)
    plane, graph = seam_figure(ISOTROPIC, optimum, 0.5, tool_angle).axes
    seam, = [line for line in plane.lines if line.get_label() == 'seam']
    assert np.ptp(seam.get_xdata()) == pytest.approx(0.5) and np.ptp(seam.get_ydata()) == 0.0
    along, = [line for line in graph.lines if line.get_label() == 'z along the seam']
    assert along.get_ydata().max() == pytest.approx(
        kinetostatic_index(ISOTROPIC, optimum.joint_angles).z + 0.0335, abs=1e-3)


def test_chains_beyond_the_limit_are_counted():
    chains = design_isotropic_arms(5, reach=1.0)
    figure = chains_figure(chains, at_most=2)
    assert figure._suptitle.get_text() == 'the first 2 of 12 chains'
    assert chains_figure(chains[:2])._suptitle is None


@pytest.mark.parametrize(('command', 'message'), [
    ('posture --link-lengths 1 1', 'link_lengths has shape (2,)'),
    ('posture --joint-angles 1 2', '--joint-angles has 2 values: must hold 3'),
    ('isocontours --joints 1 2', 'joints = (1, 2): must be two different ones of 2 ... 3'),
    ('neighbourhood --joints 2 7', 'joints = (2, 7): must be two different ones of 2 ... 3'),
    ('neighbourhood --z-height 0', 'z_height = 0.0: must be positive'),
    ('thresholds --z-max 2', 'z_max = 2.0: must be within [0, 1]'),
    ('sets --vertices 2', 'n = 2: a polygon must have at least 3 vertices'),
    ('chains -n 2', 'n = 2: must be from 3 to 9'),
    ('chains --at-most 0', 'at_most = 0: must be at least 1'),
    ('seam --link-lengths 1 1 1 1', 'arm has n = 4 joints: must have 3'),
    ('seam --length 9', 'cannot trace a seam that long'),
])
def test_bad_values_are_one_line(command, message, tmp_path, capsys):
    path = tmp_path / 'x.png'
    assert plot.main([*command.split(), '-o', str(path)]) == 1
    error = capsys.readouterr().err
    assert error.startswith('plot: ') and message in error and error.count('\n') == 1
    assert not path.exists()


def test_bad_files_are_one_line(tmp_path, capsys):
    assert plot.main(['sets', '-o', str(tmp_path / 'x.pdf')]) == 1
    assert 'its name must end with .png or .svg' in capsys.readouterr().err
    assert plot.main(['sets', '-o', str(tmp_path / 'missing' / 'x.png')]) == 1
    assert 'No such file' in capsys.readouterr().err
    with pytest.raises(ValueError, match='must end with .png or .svg'):
        save(matplotlib.figure.Figure(), 'x.jpg')


@pytest.mark.parametrize('command', [[], ['nothing'], ['posture'], ['posture', '-o']])
def test_bad_command_lines_have_status_2(command, capsys):
    with pytest.raises(SystemExit) as exit_:
        plot.main(command)
    assert exit_.value.code == 2 and 'usage: plot' in capsys.readouterr().err


def test_missing_matplotlib_is_one_line(tmp_path):
    (tmp_path / 'matplotlib.py').write_text("raise ImportError('No module named matplotlib')\n")
    root = str(Path(__file__).parents[2])
    result = subprocess.run(
        [sys.executable, '-m', 'kinopt_ros.tools.plot', 'sets', '-o', str(tmp_path / 'x.png')],
        env={**os.environ, 'PYTHONPATH': os.pathsep.join([str(tmp_path), root])},
        capture_output=True, text=True, check=False)
    assert result.returncode == 1 and result.stdout == ''
    assert result.stderr.count('\n') == 1 and 'pip install matplotlib' in result.stderr
