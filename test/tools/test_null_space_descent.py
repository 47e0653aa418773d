"""The example that closes the loop: the controller's mathematics, and a short run of it all."""

import math
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

from kinopt_ros.kinetostatics.planar_arm import PlanarArm
from kinopt_ros.tools import child_processes
from kinopt_ros.tools.child_processes import ChildProcesses
from kinopt_ros.tools.resolved_rate import LineFollower, resolved_rates, StraightLine, tool_pose

ARM = PlanarArm((0.5, 0.4, 0.3, 0.2))
POSTURE = [2.3, 1.6, -0.3, -1.6]
NO_LIMIT = 1e9


def forward_kinematics(lengths, angles):
    """Tool angle and tip by rotation matrices, link by link."""
    frame = np.eye(3)
    for length, angle in zip(lengths, angles):
        c, s = math.cos(angle), math.sin(angle)
        frame = frame @ np.array([[c, -s, c * length], [s, c, s * length], [0.0, 0.0, 1.0]])
    return np.array([sum(angles), frame[0, 2], frame[1, 2]])


def random_problem(rng, m=3, n=4):
    return rng.normal(size=(m, n)), rng.normal(size=m), rng.normal(size=n)


def test_pose_is_the_forward_kinematics():
    rng = np.random.default_rng(0)
    for _ in range(20):
        angles = rng.uniform(-3.0, 3.0, 4)
        np.testing.assert_allclose(
            tool_pose(ARM, angles), forward_kinematics(ARM.link_lengths, angles), atol=1e-14)


@pytest.mark.parametrize('m, n', [(3, 4), (2, 4), (3, 7)])
def test_rates_are_the_closest_to_the_secondary_ones_that_make_the_twist(m, n):
    """Without a limit: least |rates - secondary| subject to J rates = twist, by its KKT system."""
    rng = np.random.default_rng(10 * m + n)
    for _ in range(20):
        jacobian, twist, secondary = random_problem(rng, m, n)
        kkt = np.block([[np.eye(n), jacobian.T], [jacobian, np.zeros((m, m))]])
        expected = np.linalg.solve(kkt, np.concatenate([secondary, twist]))[:n]
        rates = resolved_rates(jacobian, twist, secondary, NO_LIMIT)
        np.testing.assert_allclose(rates.joint_rates, expected, atol=1e-10)


def test_secondary_rates_move_no_tool():
    rng = np.random.default_rng(1)
    for _ in range(20):
        jacobian, _, secondary = random_problem(rng)
        basis = scipy.linalg.null_space(jacobian)
        rates = resolved_rates(jacobian, np.zeros(3), secondary, NO_LIMIT).joint_rates
        np.testing.assert_allclose(rates, basis @ basis.T @ secondary, atol=1e-12)


def test_limit_slows_the_twist_as_a_whole_and_then_leaves_nothing_to_the_null_space():
    rng = np.random.default_rng(2)
    for _ in range(20):
        jacobian, twist, secondary = random_problem(rng)
        least = np.linalg.lstsq(jacobian, twist, rcond=None)[0]
        demand = np.abs(least).max()
        rates = resolved_rates(jacobian, twist, secondary, 0.5 * demand)
        assert rates.demand == pytest.approx(demand)
        assert np.abs(rates.joint_rates).max() <= 0.5 * demand * (1.0 + 1e-12)
        np.testing.assert_allclose(jacobian @ rates.joint_rates, 0.5 * twist, atol=1e-10)


def test_null_space_motion_gets_the_largest_share_within_the_limit():
    rng = np.random.default_rng(3)
    bounded = 0
    for _ in range(50):
        jacobian, twist, secondary = random_problem(rng)
        least = np.linalg.lstsq(jacobian, twist, rcond=None)[0]
        basis = scipy.linalg.null_space(jacobian)
        self_motion = basis @ basis.T @ secondary
        limit = 1.2 * np.abs(least).max()
        # max share: |least + share self_motion| <= limit, as a linear programme.
        share = scipy.optimize.linprog(
            [-1.0], A_ub=np.concatenate([self_motion, -self_motion])[:, None],
            b_ub=np.concatenate([limit - least, limit + least]), bounds=[(0.0, 1.0)]).x[0]
        bounded += share < 1.0
        rates = resolved_rates(jacobian, twist, secondary, limit).joint_rates
        np.testing.assert_allclose(rates, least + share * self_motion, atol=1e-9)
        np.testing.assert_allclose(jacobian @ rates, twist, atol=1e-10)
    assert 5 < bounded < 50


def test_nothing_wanted_is_nothing_done():
    rates = resolved_rates(ARM.jacobian(POSTURE), np.zeros(3), [0.0] * 4, 1.0)
    assert rates.joint_rates.tolist() == [0.0] * 4
    assert rates.demand == 0.0


def test_line_starts_and_ends_at_rest_and_its_twist_is_its_derivative():
    line = StraightLine(np.array([0.4, 1.0, 2.0]), 0.6 - 0.8j, 5.0)
    np.testing.assert_allclose(line.pose(-1.0), [0.4, 1.0, 2.0])
    np.testing.assert_allclose(line.pose(2.5), [0.4, 1.3, 1.6], atol=1e-14)
    np.testing.assert_allclose(line.pose(7.0), [0.4, 1.6, 1.2], atol=1e-14)
    for t in (-1.0, 0.0, 5.0, 7.0):
        np.testing.assert_allclose(line.twist(t), 0.0, atol=1e-12)
    for t in np.linspace(0.1, 4.9, 13):
        difference = (line.pose(t + 1e-6) - line.pose(t - 1e-6)) / 2e-6
        np.testing.assert_allclose(line.twist(t), difference, atol=1e-8)


def follow(secondary, rate_limit=NO_LIMIT, duration=4.0, period=0.01, extra=0.0):
    """Bring an arm along a short line; give the largest distance and tool angle error."""
    follower = LineFollower(ARM, POSTURE, 0.2 + 0.1j, duration, rate_limit)
    start = forward_kinematics(ARM.link_lengths, POSTURE)
    distances, rates = [], []
    for i in range(round((duration + extra) / period)):
        follower.step(i * period, period, secondary)
        s = min((i + 1) * period / duration, 1.0)
        share = s ** 3 * (10.0 - 15.0 * s + 6.0 * s * s)
        pose = forward_kinematics(ARM.link_lengths, follower.joint_angles)
        angle, x, y = pose - start - share * np.array([0.0, 0.2, 0.1])
        assert follower.distance == pytest.approx(math.hypot(x, y), abs=1e-12)
        assert follower.angle_error == pytest.approx(abs(angle), abs=1e-12)
        distances.append(follower.distance)
        rates.append(max(map(abs, follower.joint_rates)))
    return distances, rates


def test_tracking_is_close_with_and_without_null_space_motion():
    straight, _ = follow([0.0] * 4)
    assert 0.0 < max(straight) < 2e-4
    turning, _ = follow([0.0, -0.3, 0.2, 0.1])
    assert max(turning) < 5e-4


def test_slowed_by_the_limit_the_tool_catches_up():
    distances, rates = follow([0.0] * 4, rate_limit=0.15, extra=8.0)
    assert max(rates) <= 0.15 * (1.0 + 1e-12)
    assert max(distances) > 0.01
    assert distances[-1] < 1e-4


RUN = ['-c', 'import sys; from kinopt_ros.tools.null_space_descent import main; sys.exit(main())']


@pytest.fixture
def example(tmp_path):
    """Give a factory of runs of the example, in a session whose descendants can be found."""
    runs = []

    def start(*arguments):
        mark = f'KINOPT_TEST_RUN={tmp_path.name}-{os.getpid()}'
        key, value = mark.split('=')
        run = subprocess.Popen(
            [sys.executable, *RUN, *arguments], text=True, start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL,
            env={**os.environ, key: value}, cwd=tmp_path)
        runs.append((run, mark))
        return run, mark

    yield start
    for run, mark in runs:
        for process in marked_processes(mark):
            os.kill(process, signal.SIGKILL)
        run.communicate()


def marked_processes(mark):
    """Process ids of everything that inherited a mark in its environment."""
    found = []
    for entry in os.listdir('/proc'):
        if entry.isdigit():
            try:
                with open(f'/proc/{entry}/environ', 'rb') as environment:
                    if mark.encode() in environment.read().split(b'\0'):
                        found.append(int(entry))
            except OSError:
                continue
    return found


needs_proc = pytest.mark.skipif(
    not os.path.isdir('/proc/self'), reason='looks for processes in /proc')


@needs_proc
def test_short_run_over_dds(example, tmp_path):
    pytest.importorskip('matplotlib')
    run, mark = example('--seconds', '6', '--picture', 'folder/picture.png')
    output, error = run.communicate(timeout=60)
    assert run.returncode == 0, error
    assert 'Traceback' not in error
    assert marked_processes(mark) == []
    assert (tmp_path / 'folder' / 'picture.png').read_bytes().startswith(b'\x89PNG')
    table = {line[:38].strip(): tuple(map(float, line[38:].split()))
             for line in output.splitlines() if line[38:].strip() and line[:38].strip()
             and line[38:].replace('.', '').replace(' ', '').isdigit()}
    plain, descending = table['worst margin']
    assert plain < 0.05 < 0.1 < descending
    assert table['time flagged (s)'][0] > 0.0
    assert table['time flagged (s)'][1] == 0.0
    plain, descending = table['largest position error (mm)']
    assert descending < 2.0 < plain
    plain, descending = table['largest joint rate needed (rad/s)']
    assert descending < 1.0 < plain
    assert max(table['largest joint rate (rad/s)']) <= 1.0


@needs_proc
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_interrupted_it_ends_with_its_children(example, number):
    run, mark = example('--seconds', '3600')
    line = run.stdout.readline()
    assert line.startswith('following a line'), run.communicate()
    # Itself, two monitors, and what they have started in turn.
    assert len(marked_processes(mark)) >= 3
    run.send_signal(number)
    _, error = run.communicate(timeout=30)
    assert run.returncode == 0, error
    assert 'Traceback' not in error
    assert marked_processes(mark) == []


@pytest.mark.parametrize('seconds', ['0', 'nan', '-1', 'soon'])
def test_bad_duration_is_refused(seconds, capsys):
    from kinopt_ros.tools.null_space_descent import main
    with pytest.raises(SystemExit) as refusal:
        main(['--seconds', seconds])
    assert refusal.value.code == 2
    assert '--seconds' in capsys.readouterr().err


def ended(processes):
    deadline = time.monotonic() + 30.0
    while time.monotonic() < deadline:
        try:
            processes.check()
        except ChildProcessError as error:
            return str(error)
    raise AssertionError('the child does not end')


def test_child_that_ends_by_itself_is_told():
    with ChildProcesses() as processes:
        # Without parameters the node refuses to start.
        processes.start('singularity_monitor')
        assert ended(processes) == 'singularity_monitor ended with status 1'
    assert processes.failed == ['singularity_monitor']


def test_child_that_does_not_end_is_killed(monkeypatch):
    monkeypatch.setattr(child_processes, 'PATIENCE', 0.0)
    handlers = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with ChildProcesses() as processes:
        processes.start('simulated_arm')
    # No child is left, and the signals mean what they did.
    ended(processes)
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == handlers


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_signal_is_met_at_the_next_check(number):
    with ChildProcesses() as processes:
        processes.check()
        # Wherever it arrives, it raises nothing there. Raised in this very thread: of a signal
        # to the whole process another one may take note, and later.
        signal.raise_signal(number)
        with pytest.raises(KeyboardInterrupt):
            processes.check()
