"""
Analysing recordings: what comes out of files that the tests write, against direct computation.

The oracle takes singular values by numpy.linalg and keeps the flag by a rule of its own.
"""

import csv
import math
import os
from pathlib import Path
import shutil
import sys

import numpy as np
import pytest

from kinopt_ros.monitor.verdict import Level
from kinopt_ros.tools import analyze, recordings, replay
from kinopt_ros.tools.recordings import MAX_LINE, read_recording

ROOT = Path(__file__).parents[2]
UR5_RECORDING = Path(os.environ.get(
    'KINOPT_UR5_RECORDING', ROOT.parent / 'shared' / 'data' / 'ur5_movement1_q.csv'))
UR5_COLUMNS = ['time', 'shoulder_pan_joint', 'shoulder_lift_joint', 'elbow_joint',
               'wrist_1_joint', 'wrist_2_joint', 'wrist_3_joint']
NAMES = ['joint_1', 'joint_2', 'joint_3']
LENGTHS = [1.0, 0.8, 0.5]
ARM = ['--joint-names', *NAMES, '--link-lengths', *map(str, LENGTHS)]


def oracle(lengths, angles):
    """Give z, conditioning length and margin from the singular values of the centred block."""
    phi = np.cumsum(angles, axis=1)
    links = np.array(lengths)[:, None] * np.array([np.cos(phi.T), np.sin(phi.T)])
    vectors = np.cumsum(links[:, ::-1], axis=1)[:, ::-1].transpose(2, 0, 1)
    n = len(lengths)
    centred = vectors - vectors.mean(axis=2, keepdims=True)
    s = np.linalg.svd(centred, compute_uv=False)
    size = np.sum(vectors ** 2, axis=(1, 2))
    return np.column_stack([1.0 - s.sum(axis=1) ** 2 / (2.0 * size),
                            size / (math.sqrt(n) * s.sum(axis=1)),
                            s[:, 1] * s.sum(axis=1) / size])


def oracle_flag(values, z_max=0.9, margin_min=0.05, hysteresis=0.1):
    raised, flags = False, []
    for z, _, margin in values:
        if z > z_max or margin < margin_min:
            raised = True
        elif (margin > margin_min * (1.0 + hysteresis)
              and 1.0 - z > (1.0 - z_max) * (1.0 + hysteresis)):
            raised = False
        flags.append(raised)
    return flags


@pytest.fixture
def motion():
    """Times and angles of an arm that stretches and folds, with jitter in time."""
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.uniform(0.005, 0.015, 600)) + 12.0
    phase = 2.0 * math.pi * (times - times[0]) / 3.0
    angles = np.column_stack([phase, 2.0 * np.sin(phase), 1.5 * np.sin(2.0 * phase) + 0.4])
    return times, angles


def write_rows(path, rows, header=None):
    with path.open('w', encoding='utf-8', newline='') as file:
        writer = csv.writer(file)
        writer.writerows([header] * (header is not None))
        writer.writerows(rows)
    return path


def rows_of(path):
    with Path(path).open(encoding='utf-8', newline='') as file:
        return list(csv.DictReader(file))


def numbers_of(rows):
    return np.array([[float(row[name]) for name in ('z', 'conditioning_length_m', 'margin')]
                     for row in rows])


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run the command in a folder of its own; gives the exit status and the rows written."""
    monkeypatch.chdir(tmp_path)

    def command(recording, *arguments):
        status = analyze.main([str(recording), '--csv', 'out.csv', '--picture', 'out.png',
                               *map(str, arguments)])
        return status, rows_of('out.csv') if Path('out.csv').exists() else []

    return command


def check_against_oracle(rows, times, angles, lengths=tuple(LENGTHS)):
    expected = oracle(lengths, angles)
    np.testing.assert_allclose([float(row['time_s']) for row in rows], times, atol=2e-9)
    np.testing.assert_allclose(numbers_of(rows), expected, atol=1e-9)
    flags = oracle_flag(expected)
    assert [row['near_singularity'] == '1' for row in rows] == flags
    assert [row['level'] for row in rows] == ['WARN' if flag else 'OK' for flag in flags]
    return flags


def test_csv_without_header(run, tmp_path, motion, capsys):
    times, angles = motion
    status, rows = run(write_rows(tmp_path / 'r.csv', np.column_stack(motion)), *ARM)
    assert status == 0
    flags = check_against_oracle(rows, times, angles)
    assert 0 < sum(flags) < len(flags)
    assert (tmp_path / 'out.png').read_bytes().startswith(b'\x89PNG')
    told = capsys.readouterr()
    assert told.err == ''
    worst = np.argmin(oracle(LENGTHS, angles)[:, 2])
    assert f'worst moment   {times[worst]:.3f} s: margin' in told.out
    raised = [i for i in range(len(flags)) if flags[i] and not (i and flags[i - 1])]
    cleared = [i for i in range(1, len(flags)) if flags[i - 1] and not flags[i]]
    assert len(raised) > 1 and f'raised {len(raised)} times' in told.out
    for i in raised:
        assert f'\n  {times[i]:.3f} s to ' in told.out
    held = np.diff(times) @ np.array(flags[:-1])
    assert f'up for {held:.3f} s of {times[-1] - times[0]:.3f} s' in told.out
    assert f'{times[raised[0]]:.3f} s to {times[cleared[0]]:.3f} s' in told.out


def test_csv_with_header_in_any_order(run, tmp_path, motion):
    times, angles = motion
    table = np.column_stack([angles[:, 2], np.full(len(times), math.nan), times, angles[:, :2]])
    path = write_rows(tmp_path / 'r.csv', table, ['joint_3', 'other', 'time', *NAMES[:2]])
    status, rows = run(path, *ARM)
    assert status == 0
    check_against_oracle(rows, times, angles)


def test_named_columns_offsets_and_directions(run, tmp_path, motion):
    times, angles = motion
    positions = (angles - [0.3, -1.0, 2.0]) * [1, -1, -1]
    path = write_rows(tmp_path / 'r.csv', np.column_stack([times, times, positions]))
    status, rows = run(path, *ARM, '--columns', 'time', 'other', *NAMES,
                       '--joint-offsets', 0.3, -1.0, 2.0, '--joint-directions', 1, -1, -1)
    assert status == 0
    check_against_oracle(rows, times, angles)


def write_bag(path, messages, storage, topics=('/joint_states',)):
    """Write a bag of (time, topic, names, positions)."""
    rosbag2 = pytest.importorskip('rosbags.rosbag2')
    from rosbags.typesys import get_typestore, Stores
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    kind = recordings.JOINT_STATE
    plugin = rosbag2.StoragePlugin.MCAP if storage == 'mcap' else rosbag2.StoragePlugin.SQLITE3
    with rosbag2.Writer(path, version=9, storage_plugin=plugin) as writer:
        connections = {topic: writer.add_connection(topic, kind, typestore=store)
                       for topic in topics}
        for time, topic, names, positions in messages:
            stamp = types['builtin_interfaces/msg/Time'](int(time), 0)
            message = types[kind](
                types['std_msgs/msg/Header'](stamp, ''), list(names),
                np.array(positions, dtype=float), np.array([]), np.array([]))
            writer.write(connections[topic], round(time * 1e9),
                         store.serialize_cdr(message, kind))
    return path


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_bag(run, tmp_path, motion, storage):
    times, angles = motion
    messages = [(time, '/joint_states', ['gripper', *NAMES[::-1]], [0.1, *row[::-1]])
                for time, row in zip(times, angles)]
    bag = write_bag(tmp_path / 'bag', messages, storage)
    status, rows = run(bag, *ARM)
    assert status == 0
    check_against_oracle(rows, times - times[0], angles)
    # The file within the bag will do as well.
    file = next(path for path in bag.iterdir() if path.suffix in ('.mcap', '.db3'))
    assert run(file, *ARM) == (0, rows)


def test_bag_of_several_publishers_and_topics(run, tmp_path, motion, capsys):
    times, angles = motion
    messages = []
    for time, row in zip(times, angles):
        messages.append((time, '/js', NAMES[:1], row[:1]))
        messages.append((time + 1e-4, '/js', NAMES[1:], row[1:]))
        messages.append((time + 2e-4, '/others', NAMES, [math.nan] * 3))
    bag = write_bag(tmp_path / 'bag', messages, 'mcap', ('/js', '/others', '/empty'))
    status, _ = run(bag, *ARM)
    assert status == 1 and "['/empty', '/js', '/others']" in capsys.readouterr().err
    status, rows = run(bag, *ARM, '--topic', '/js')
    assert status == 0
    # Every message that completes a posture is judged: all but the very first.
    check_against_oracle(rows[::2], times + 1e-4 - times[0], angles)
    assert len(rows) == 2 * len(times) - 1
    assert run(bag, *ARM, '--topic', '/nowhere')[0] == 1
    assert "not on /nowhere" in capsys.readouterr().err


def test_bad_rows_are_told_and_flagged(run, tmp_path, capsys):
    good = '0.5,1.2,0.7'
    lines = [f'0.00,{good}', '0.01,0.5,nan,0.7', '0.02,0.5,1.2', f'soon,{good}',
             '0.03,x,1.2,0.7', '', f'0.025,{good}', f'inf,{good}', '0.04,"0.5,1.2',
             '0.05,0.5,1.2,0.7,9.9', f'0.06,{good}']
    path = tmp_path / 'r.csv'
    path.write_text('\n'.join(lines), encoding='utf-8')
    status, rows = run(path, *ARM)
    told = capsys.readouterr()
    assert status == 0
    expected = {2: "joint 'joint_2': position must be finite (nan)",
                3: 'one position per name (2 positions, 3 names)', 4: 'no finite time',
                5: "joint 'joint_1': position must be finite", 7: 'before 0.03 s',
                8: 'no finite time', 9: '1 positions, 3 names', 10: '4 positions, 3 names'}
    warnings = told.err.splitlines()
    assert len(warnings) == len(expected)
    for warning, (line, words) in zip(warnings, expected.items()):
        assert warning.startswith(f'warning: line {line}: ') and words in warning
    # As the node: a bad message gives NaN and the flag, the next good one recovers.
    levels = ['OK', 'ERROR', 'ERROR', 'ERROR', 'ERROR', 'ERROR', 'OK']
    assert [row['level'] for row in rows] == levels
    assert [row['near_singularity'] for row in rows] == ['0', '1', '1', '1', '1', '1', '0']
    assert np.isnan(numbers_of(rows[1:6])).all() and not np.isnan(numbers_of(rows[::6])).any()
    assert '2 postures, 5 bad messages, 0 times stale, 3 without a usable time' in told.out


def test_many_bad_rows_do_not_flood(run, tmp_path, capsys):
    lines = ['0.0,0.5,1.2,0.7'] + [f'{i},x,x,x' for i in range(1, 501)]
    (tmp_path / 'r.csv').write_text('\n'.join(lines), encoding='utf-8')
    run(tmp_path / 'r.csv', *ARM)
    warnings = capsys.readouterr().err.splitlines()
    assert len(warnings) == 21 and 'and 480 more' in warnings[-1]


def test_silence_is_stale_at_the_moment_at_which_it_would_have_been(run, tmp_path, capsys):
    path = write_rows(tmp_path / 'r.csv', [
        [time, 0.5, 1.2, 0.7] for time in (0.0, 0.1, 2.0, 2.1, 2.5, 9.0)])
    status, rows = run(path, *ARM, '--stale-timeout', 0.5)
    assert status == 0
    times = [0.0, 0.1, 0.6, 2.0, 2.1, 2.5, 3.0, 9.0]
    assert [float(row['time_s']) for row in rows] == pytest.approx(times)
    stale = [i for i, row in enumerate(rows) if row['level'] == 'STALE']
    assert stale == [2, 6]
    assert all(rows[i]['near_singularity'] == '1' for i in stale)
    assert '0.600 s to 2.000 s, posture not known' in capsys.readouterr().out


def hostile(**files):
    return [pytest.param(content, words, id=name) for name, (content, words) in files.items()]


@pytest.mark.parametrize('content, words', hostile(
    empty=(b'', 'holds no row'),
    blank=(b'\n\n , ,\n', 'holds no row'),
    zeros=(bytes(50_000), 'joint_1'),
    long_line=(b'1,' * MAX_LINE, f'more than {MAX_LINE} characters'),
    endless_quote=(b'"' + b'x\n' * 1000, 'joint_1'),
    header_alone=(b'time,joint_1,joint_2,joint_3\n', 'no message concerns'),
    joint_missing=(b'time,joint_1,joint_2\n1,2,3\n', "0 columns for the joint 'joint_3'"),
    joint_twice=(b'time,joint_1,joint_1,joint_2,joint_3\n', "2 columns for the joint 'joint_1'"),
    five_columns=(b'1,2,3,4,5\n', '--columns'),
    latin_1=('Zeit,Gelenk\xe4\n'.encode('latin-1'), 'joint_1'),
    no_times=(b'x,1,2,3\n' * 9, 'no message concerns'),
    utf_16=('time,joint_1,joint_2,joint_3\n1,2,3,4'.encode('utf-16'), 'joint_1'),
))
def test_hostile_csv_is_one_clear_line(run, tmp_path, capsys, content, words):
    path = tmp_path / 'r.csv'
    path.write_bytes(content)
    status, rows = run(path, *ARM)
    errors = [line for line in capsys.readouterr().err.splitlines() if line.startswith('error')]
    assert status == 1 and rows == []
    assert len(errors) == 1 and words in errors[0]


def test_random_bytes_never_get_through(tmp_path):
    rng = np.random.default_rng(5)
    for _ in range(200):
        (tmp_path / 'r.csv').write_bytes(rng.bytes(300))
        try:
            items = list(read_recording(tmp_path / 'r.csv', NAMES, ['time', *NAMES]))
        except ValueError:
            continue
        for item in items:
            assert not isinstance(item, recordings.RecordedMessage) or math.isfinite(item.time)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_damaged_bags_are_one_clear_line(run, tmp_path, motion, storage, capsys):
    rng = np.random.default_rng(6)
    messages = [(time, '/joint_states', NAMES, row) for time, row in zip(*motion)]
    bag = write_bag(tmp_path / 'bag', messages, storage)
    whole = next(path for path in bag.iterdir() if path.suffix in ('.mcap', '.db3'))
    content = whole.read_bytes()
    for trial in range(30):
        damaged = bytearray(content[:rng.integers(1, len(content))] if trial % 2 else content)
        for place in rng.integers(0, len(damaged), 40):
            damaged[place] = rng.integers(256)
        whole.write_bytes(damaged)
        status, rows = run(bag, *ARM)
        errors = capsys.readouterr().err
        assert 'Traceback' not in errors
        assert status in (0, 1)
        assert (status == 1) == ('error: ' in errors)
        Path('out.csv').unlink(missing_ok=True)
    whole.write_bytes(b'')
    assert run(bag, *ARM)[0] == 1
    shutil.rmtree(bag)
    bag.mkdir()
    assert run(bag, *ARM)[0] == 1
    assert 'metadata' in capsys.readouterr().err


def test_undecodable_message_of_a_bag_is_told(tmp_path, monkeypatch):
    rosbag2 = pytest.importorskip('rosbags.rosbag2')
    from rosbags.typesys import get_typestore, Stores
    store = get_typestore(Stores.ROS2_JAZZY)
    with rosbag2.Writer(tmp_path / 'bag', version=9) as writer:
        connection = writer.add_connection('/js', recordings.JOINT_STATE, typestore=store)
        for i, data in enumerate([b'', b'\x00\x01\x00\x00' + b'\xff' * 40]):
            writer.write(connection, i, data)
    items = list(read_recording(tmp_path / 'bag', NAMES))
    assert [item.place for item in items] == ['message 1', 'message 2']
    assert all('is no sensor_msgs/msg/JointState' in item.reason for item in items)


@pytest.mark.parametrize('missing, words', [
    ('rosbags.rosbag2', 'pip install rosbags'),
    ('kinopt_ros.tools.pictures.over_time', 'matplotlib')])
def test_missing_extras_are_said_with_the_remedy(
        run, tmp_path, motion, monkeypatch, capsys, missing, words):
    bag = write_bag(tmp_path / 'bag', [(time, '/joint_states', NAMES, row)
                                       for time, row in zip(*motion)], 'mcap')
    monkeypatch.setitem(sys.modules, missing, None)
    status, rows = run(bag, *ARM)
    assert status == 1 and words in capsys.readouterr().err
    # A missing picture takes nothing from the numbers.
    assert bool(rows) == ('matplotlib' in words)


def test_progress_goes_up_to_the_end(tmp_path, motion):
    path = write_rows(tmp_path / 'r.csv', np.column_stack(motion))
    told = []
    list(read_recording(path, NAMES, progress=lambda *pair: told.append(pair)))
    assert [done for done, _ in told] == sorted(done for done, _ in told)
    assert told[-1] == (path.stat().st_size, path.stat().st_size)


def test_params_file_and_who_wins(tmp_path, capsys):
    def configuration(text, *arguments):
        (tmp_path / 'p.yaml').write_text(text, encoding='utf-8')
        options = analyze._checked_options(
            ['r.csv', '--params-file', str(tmp_path / 'p.yaml'), *map(str, arguments)])
        return analyze.configuration_of(options)

    text = ('/**:\n  ros__parameters:\n    joint_names: [a, b, c]\n    link_lengths: [1.0, 2.0, '
            '3.0]\n    z_max: 0.8\n/left:\n  singularity_monitor:\n    ros__parameters:\n'
            '      margin_min: 0.07\nother_node:\n  ros__parameters:\n    z_max: 0.1\n')
    result = configuration(text)
    assert result.arm.joint_names == ('a', 'b', 'c')
    assert (result.thresholds.z_max, result.thresholds.margin_min) == (0.8, 0.07)
    assert result.thresholds.hysteresis == 0.1
    assert configuration(text, '--z-max', 0.7).thresholds.z_max == 0.7
    # Explicit values win over those from a robot description.
    urdf = ['--robot-description', ROOT / 'test' / 'fixtures' / 'ur5.urdf',
            '--base-link', 'base_link', '--tip-link', 'tool0']
    result = configuration('/**:\n  ros__parameters:\n    link_lengths: [1.0, 2.0, 3.0]\n', *urdf)
    assert result.arm.joint_names == ('shoulder_lift_joint', 'elbow_joint', 'wrist_1_joint')
    assert result.arm.planar_arm.link_lengths == (1.0, 2.0, 3.0)
    assert result.arm.joint_offsets == pytest.approx((0.0, 0.0, math.pi / 2))
    assert "moves with joint 'wrist_2_joint'" in capsys.readouterr().err
    result = configuration(
        '/**:\n  ros__parameters:\n    z_max: 0.8\n', *urdf, '--held-joints', 'wrist_2_joint',
        '--held-positions', 1.5707963267948966, '--tool-offset', 0, 0, 0.1)
    assert result.arm.planar_arm.link_lengths[-1] == pytest.approx(math.hypot(0.09465, 0.1823))


@pytest.mark.parametrize('text, words', [
    ('', 'no parameters for singularity_monitor'),
    ('[1, 2]', 'no parameters'),
    ('other:\n  ros__parameters:\n    z_max: 0.5\n', 'no parameters'),
    ('a: [', 'not a ROS parameter file'),
    ('&a\n/**:\n  *a', 'not a ROS parameter file'),
    ('/**:\n  ros__parameters:\n    link_lengths: 3\n', 'link_lengths = 3: must be of the type'),
    ('/**:\n  ros__parameters:\n    link_lengths: [a, b, c]\n', 'must be of the type'),
    ('/**:\n  ros__parameters:\n    joint_directions: [1.0, 1.0, 1.0]\n', 'joint_directions'),
    ('/**:\n  ros__parameters:\n    z_max: 1.5\n', 'z_max = 1.5'),
    ('/**:\n  ros__parameters:\n    joint_names: []\n', 'joint_names'),
])
def test_bad_params_files_are_one_clear_line(run, tmp_path, capsys, text, words):
    (tmp_path / 'p.yaml').write_text(text, encoding='utf-8')
    arm = [] if 'joint_names' in text else ARM
    arm = ARM[:4] if 'link_lengths' in text else arm
    status, _ = run(tmp_path / 'r.csv', '--params-file', tmp_path / 'p.yaml', *arm)
    lines = capsys.readouterr().err.splitlines()
    assert status == 1 and len(lines) >= 1 and lines[0].startswith('error: ')
    assert words in lines[0]


@pytest.mark.parametrize('arguments, words', [
    (['no_such_file.csv', *ARM], 'no_such_file.csv'), (['r.csv'], 'joint_names is required'),
    (['r.csv', '--base-link', 'base', '--tip-link', 'tip'], '--robot-description'),
    (['r.csv', '--robot-description', 'none.urdf', '--base-link', 'base'], 'none.urdf'),
    (['r.csv', '--robot-description', str(ROOT / 'test' / 'fixtures' / 'ur5.urdf'),
      '--base-link', 'base_link', '--tip-link', 'tool0', '--held-joints', 'wrist_2_joint'],
     'held_positions = []')])
def test_what_is_missing_is_said(capsys, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert analyze.main(arguments) == 1
    assert words in capsys.readouterr().err


@pytest.mark.parametrize('arguments, words', [
    (['r.csv', '--csv', 'r.csv'], 'overwritten'),
    (['r.csv', '--z-max', 'high'], '--z-max'), ([], 'recording')])
def test_wrong_command_lines(capsys, arguments, words):
    with pytest.raises(SystemExit) as end:
        analyze.main(arguments)
    assert end.value.code == 2 and words in capsys.readouterr().err


def test_analysis_of_nothing_is_empty():
    configuration = analyze.configuration_of(analyze._checked_options(['r.csv', *ARM]))
    assert replay.replay([], configuration) == ([], [])
    assert replay.flag_spans([]) == []


def test_flag_spans_of_single_verdicts():
    def row(time, raised, margin=0.5):
        return replay.Row(time, 0.5, 1.0, margin, raised, Level.OK, '')

    rows = [row(0.0, True, 0.1), row(1.0, False), row(2.0, True, math.nan), row(3.0, True, 0.2),
            row(4.0, False), row(5.0, True, 0.3)]
    assert replay.flag_spans(rows) == [(0.0, 1.0, 0.1), (2.0, 4.0, 0.2), (5.0, 5.0, 0.3)]


@pytest.mark.skipif(not UR5_RECORDING.exists(), reason='the UR5 recording is not here')
def test_recording_of_a_ur5(run, capsys):
    status, rows = run(UR5_RECORDING, '--params-file', ROOT / 'config' / 'ur5.yaml',
                       '--columns', *UR5_COLUMNS)
    assert status == 0
    data = np.loadtxt(UR5_RECORDING, delimiter=',')
    angles = data[:, 2:5] + [0.0, 0.0, math.pi / 2]
    flags = check_against_oracle(rows, data[:, 0], angles, (0.425, 0.39225, 0.09465))
    # It passes close by the stretched elbow, once.
    assert sum(np.diff(np.array(flags, dtype=int)) == 1) == 1
    assert 'raised once' in capsys.readouterr().out
    closest = np.argmin(np.abs(data[:, 3]))
    assert flags[closest]
