"""An arm that comes from a robot description, through the node and as a process."""

import math
import os
from pathlib import Path
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Bool, String
from support import (
    assert_numbers,
    Bench,
    DEADLINE,
    expected_numbers,
    LENGTHS,
    NAMES,
    NEVER_STALE,
    REGULAR,
)

FIXTURES = Path(__file__).parents[1] / 'fixtures'
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                     durability=DurabilityPolicy.TRANSIENT_LOCAL)
UR5 = (FIXTURES / 'ur5.urdf').read_text()
UR5_NAMES = ['shoulder_lift_joint', 'elbow_joint', 'wrist_1_joint']
UR5_LENGTHS = [0.425, 0.39225, 0.09465]
UR5_LINKS = {'base_link': 'base_link', 'tip_link': 'wrist_2_link'}
FROM_DESCRIPTION = {'joint_names': None, 'link_lengths': None}


def ur5_angles(positions):
    return np.array(positions) + [0.0, 0.0, math.pi / 2.0]


def singular_values_oracle(urdf, tip, positions, tool=(0.0, 0.0, 0.0)):
    """
    Compute z, l_P and margin from the URDF by a spatial Jacobian.

    The columns are axis x (P - centre), projected on the plane normal to the first axis.
    """
    joints = {joint.find('child').get('link'): joint
              for joint in ElementTree.fromstring(urdf).iter('joint')}
    path, link = [], tip
    while link in joints:
        path.insert(0, joints[link])
        link = joints[link].find('parent').get('link')
    frame, centres, axes = np.eye(4), [], []
    for joint in path:
        origin = joint.find('origin')
        frame = frame @ displacement([float(x) for x in origin.get('xyz').split()],
                                     [float(x) for x in origin.get('rpy').split()])
        if joint.get('name') in positions:
            axis = np.array([float(x) for x in joint.find('axis').get('xyz').split()])
            centres.append(frame[:3, 3])
            axes.append(frame[:3, :3] @ axis)
            frame = frame @ turn(axis, positions[joint.get('name')])
    point = (frame @ [*tool, 1.0])[:3]
    normal = axes[0]
    # A joint whose axis points the other way counts for its own direction of turning.
    arms = np.array([point - centre for centre in centres])
    arms -= np.outer(arms @ normal, normal)
    basis = np.linalg.svd(normal[None, :])[2][1:]
    block = basis @ arms.T
    n = len(arms)
    size = np.sum(block ** 2)
    s = np.linalg.svd(block - block.mean(axis=1, keepdims=True), compute_uv=False)
    return (1.0 - s.sum() ** 2 / (2.0 * size), size / (math.sqrt(n) * s.sum()),
            s[1] * s.sum() / size)


def displacement(xyz, rpy):
    frame = turn([0, 0, 1], rpy[2]) @ turn([0, 1, 0], rpy[1]) @ turn([1, 0, 0], rpy[0])
    frame[:3, 3] = xyz
    return frame


def turn(axis, angle):
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    frame = np.eye(4)
    frame[:3, :3] += math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    return frame


# --- the parameter robot_description ---------------------------------------------------------


def described(make_bench, urdf=UR5, links=UR5_LINKS, **parameters):
    return make_bench({**FROM_DESCRIPTION, **links, 'robot_description': urdf, **parameters})


def test_ur5_from_its_description(make_bench):
    bench = described(make_bench)
    assert bench.get('joint_names') == UR5_NAMES
    assert bench.get('link_lengths') == pytest.approx(UR5_LENGTHS, abs=1e-9)
    assert bench.get('joint_lower') == pytest.approx([-2.0 * math.pi] * 3)
    assert bench.get('joint_upper') == pytest.approx([2.0 * math.pi] * 3)
    for positions in ([-0.9, 1.3, -0.6], [0.2, 0.0, 1.0], [3.0, -2.0, 0.5]):
        numbers, _ = bench.cycle(positions, UR5_NAMES)
        assert_numbers(numbers, expected_numbers(UR5_LENGTHS, ur5_angles(positions)), 1e-7)
        assert_numbers(numbers, singular_values_oracle(
            UR5, 'wrist_2_link', dict(zip(UR5_NAMES, positions))), 1e-7)


ARMS = {
    'ur3e': ('wrist_2_link', UR5_NAMES), 'ur5e': ('wrist_2_link', UR5_NAMES),
    'ur10e': ('wrist_2_link', UR5_NAMES), 'scara': ('tool', ['joint_1', 'joint_2', 'joint_4']),
    'planar_4r': ('tip', ['joint_1', 'joint_2', 'joint_3', 'joint_4']),
}


@pytest.mark.parametrize('name', ARMS)
def test_arms_that_people_own(make_bench, name):
    tip, names = ARMS[name]
    urdf = (FIXTURES / f'{name}.urdf').read_text()
    bench = described(make_bench, urdf, {'base_link': 'base_link', 'tip_link': tip})
    assert bench.get('joint_names') == names
    rng = np.random.default_rng(6)
    for positions in rng.uniform(-2.0, 2.0, (3, len(names))):
        numbers, _ = bench.cycle(positions, names)
        assert_numbers(
            numbers, singular_values_oracle(urdf, tip, dict(zip(names, positions))), 1e-7)


def test_limits_are_those_of_the_description(make_bench):
    urdf = (FIXTURES / 'planar_4r.urdf').read_text()
    bench = described(make_bench, urdf, {'base_link': 'base_link', 'tip_link': 'tip'})
    assert bench.get('joint_lower') == [-2.9, -2.6, -2.6, -math.inf]
    assert bench.get('joint_upper') == [2.9, 2.6, 2.6, math.inf]
    bench.cycle([0.0, 0.3, -2.5, 50.0], ARMS['planar_4r'][1])
    bench.wait(lambda: bench.diagnostics and 'joint nearest to its limit' in bench.values,
               'diagnostics with the nearest limit')
    assert bench.values['joint nearest to its limit'] == 'joint_3'
    assert float(bench.values['distance to the nearest joint limit (rad)']) == pytest.approx(0.1)


def test_distance_to_a_limit_never_changes_the_index(make_bench):
    bench = make_bench({'joint_lower': [-1.0] * 3, 'joint_upper': [1.0] * 3,
                        'diagnostics_period': 0.0})
    numbers, flag = bench.cycle(REGULAR)
    assert_numbers(numbers, expected_numbers(LENGTHS, REGULAR))
    assert flag is False
    bench.wait(lambda: bench.diagnostics and bench.level == 0, 'diagnostics')
    # The wrist stands beyond: negative.
    assert bench.values['joint nearest to its limit'] == NAMES[2]
    assert float(bench.values['distance to the nearest joint limit (rad)']) == pytest.approx(-1.0)


def test_no_limit_no_distance(make_bench):
    bench = make_bench({'diagnostics_period': 0.0})
    bench.cycle(REGULAR)
    bench.wait(lambda: bench.diagnostics and bench.level == 0, 'diagnostics')
    assert not [key for key in bench.values if 'limit' in key]


def test_explicit_parameters_win(make_bench):
    bench = described(make_bench, link_lengths=[0.5, 0.4, 0.3], joint_upper=[1.0, 2.0, 3.0])
    assert bench.get('link_lengths') == [0.5, 0.4, 0.3]
    assert bench.get('joint_upper') == [1.0, 2.0, 3.0]
    assert bench.get('joint_lower') == pytest.approx([-2.0 * math.pi] * 3)
    positions = [-0.9, 1.3, -0.6]
    numbers, _ = bench.cycle(positions, UR5_NAMES)
    assert_numbers(numbers, expected_numbers([0.5, 0.4, 0.3], ur5_angles(positions)), 1e-7)


def test_explicit_offsets_and_directions_win(make_bench):
    bench = described(make_bench, joint_offsets=[0.0, 0.0, 0.0], joint_directions=[1, -1, 1])
    numbers, _ = bench.cycle([-0.9, 1.3, -0.6], UR5_NAMES)
    assert_numbers(numbers, expected_numbers(UR5_LENGTHS, [-0.9, -1.3, -0.6]), 1e-7)


def test_exactly_the_joints_that_are_named(make_bench):
    urdf = (FIXTURES / 'planar_4r.urdf').read_text()
    names = ['joint_2', 'joint_3', 'joint_4']
    bench = described(make_bench, urdf, {'base_link': 'base_link', 'tip_link': 'tip'},
                      joint_names=names)
    positions = [0.4, 1.0, -2.0]
    numbers, _ = bench.cycle(positions, names)
    assert_numbers(
        numbers, singular_values_oracle(urdf, 'tip', dict(zip(names, positions))), 1e-7)


def test_held_joint(make_bench):
    """Joint 2 stands still at a stated angle; the other three are the arm."""
    urdf = (FIXTURES / 'planar_4r.urdf').read_text()
    names = ['joint_1', 'joint_3', 'joint_4']
    bench = described(make_bench, urdf, {'base_link': 'base_link', 'tip_link': 'tip'},
                      held_joints=['joint_2'], held_positions=[0.7])
    assert bench.get('joint_names') == names
    positions = {'joint_1': 0.4, 'joint_3': 1.0, 'joint_4': -2.0}
    numbers, _ = bench.cycle(list(positions.values()), names)
    held = urdf.replace('<joint name="joint_2" type="revolute">',
                        '<joint name="joint_2" type="fixed">').replace(
        '<origin xyz="0.40 0 0.03" rpy="0 0 0"/>', '<origin xyz="0.40 0 0.03" rpy="0 0 0.7"/>')
    assert_numbers(numbers, singular_values_oracle(held, 'tip', positions), 1e-7)


def test_tool_offset(make_bench):
    urdf = (FIXTURES / 'planar_4r.urdf').read_text()
    tool, names = [0.05, 0.12, 0.3], ARMS['planar_4r'][1]
    bench = described(make_bench, urdf, {'base_link': 'base_link', 'tip_link': 'tip'},
                      tool_offset=tool)
    positions = [0.4, 1.0, -2.0, 0.3]
    numbers, _ = bench.cycle(positions, names)
    assert_numbers(
        numbers, singular_values_oracle(urdf, 'tip', dict(zip(names, positions)), tool), 1e-7)


def test_joints_that_would_move_the_tip_are_named(make_bench, capfd):
    described(make_bench, links={'base_link': 'base_link', 'tip_link': 'tool0'})
    warning, = (line for line in capfd.readouterr().err.splitlines() if 'wrist_2_joint' in line)
    assert warning.startswith('[WARN]')
    assert 'wrist_3_joint' not in warning.partition('would')[0]


def test_operation_point_that_nothing_moves_needs_no_warning(make_bench, capfd):
    described(make_bench)
    assert '[WARN]' not in capfd.readouterr().err


def test_optimal_posture_of_a_described_arm(make_bench):
    from std_srvs.srv import Trigger
    bench = described(make_bench)
    import json
    record = json.loads(bench.call(Trigger, 'get_optimal_posture').message)
    assert record['joint_names'] == UR5_NAMES
    numbers, _ = bench.cycle(record['joint_positions'], UR5_NAMES)
    assert numbers.z == pytest.approx(record['z'], abs=1e-7)


# --- the latched topic robot_description -----------------------------------------------------


class Late:
    """A monitor that waits for its description, a publisher of descriptions, a listener."""

    def __init__(self, context, executor, namespace='/'):
        self.executor = executor
        self.prefix = namespace.rstrip('/')
        self.context = context
        self.peer = Node('describer', context=context, namespace=namespace)
        executor.add_node(self.peer)
        self.publisher = self.peer.create_publisher(
            String, f'{self.prefix}/robot_description', LATCHED)
        self.bench = None

    def start(self, **parameters):
        name = f'{self.prefix}/singularity_monitor'
        self.bench = WaitingBench(
            self.context, self.executor, {**FROM_DESCRIPTION, **UR5_LINKS, **parameters},
            namespace=self.prefix or None, name=name,
            joint_states=f'{self.prefix}/joint_states')
        return self.bench

    def describe(self, urdf):
        self.publisher.publish(String(data=urdf))

    def close(self):
        if self.bench is not None:
            self.bench.close()
        self.executor.remove_node(self.peer)
        self.peer.destroy_node()


class WaitingBench(Bench):
    """A bench whose monitor does not subscribe to joint states before it knows its arm."""

    def _is_connected(self):
        return (all(s.get_publisher_count() > 0 for s in self.peer.subscriptions)
                and all(p.get_subscription_count() > 0 for p in self.monitor.publishers
                        if p.msg_type is Bool))

    def is_monitoring(self):
        return (self.publisher.get_subscription_count() > 0
                and any(s.topic_name.endswith('joint_states') and s.get_publisher_count() > 0
                        for s in self.monitor.subscriptions))


@pytest.fixture
def late(context, executor):
    late = Late(context, executor)
    yield late
    late.close()


def assert_monitors_the_ur5(bench):
    bench.wait(bench.is_monitoring, 'the watch')
    positions = [-0.9, 1.3, -0.6]
    count = len(bench.cycles)
    bench.send(positions, UR5_NAMES)
    expected = expected_numbers(UR5_LENGTHS, ur5_angles(positions))
    bench.wait(lambda: any(not math.isnan(n.z) for n, _ in bench.cycles[count:]), 'an answer')
    assert_numbers(bench.cycles[-1][0], expected, 1e-7)


def assert_never_ok(bench):
    assert all(flag is True for _, flag in bench.cycles)
    assert all(math.isnan(numbers.z) for numbers, _ in bench.cycles)
    assert all(a.status[0].level != b'\x00' for a in bench.diagnostics)


def test_description_published_before_the_start(late):
    late.describe(UR5)
    assert_monitors_the_ur5(late.start())


def test_description_published_after_the_start(late):
    bench = late.start()
    bench.wait(lambda: bench.diagnostics, 'diagnostics')
    assert bench.level == 3
    assert 'robot_description' in bench.status.message
    for _ in range(5):
        bench.send([-0.9, 1.3, -0.6], UR5_NAMES)
        bench.linger(0.02)
    assert_never_ok(bench)
    late.describe(UR5)
    assert_monitors_the_ur5(bench)
    bench.wait(lambda: bench.level == 0, 'level OK')


def test_listeners_hear_that_nothing_is_known(late):
    """A watchdog that joins while the description is missing is told so, again and again."""
    bench = late.start()
    count = len(bench.cycles)
    bench.wait(lambda: len(bench.cycles) > count, 'a raised flag while there is no arm')
    assert_never_ok(bench)


@pytest.mark.parametrize('bad', ['', 'no XML', '<robot name="r"><link name="a"/></robot>',
                                 '<!DOCTYPE r [<!ENTITY a "b">]><robot name="&a;"/>',
                                 UR5.replace('xyz="-0.425 0 0"', 'xyz="nan 0 0"')],
                         ids=['empty', 'text', 'no arm', 'entity', 'nan'])
def test_bad_description_then_a_good_one(late, bad):
    late.describe(bad)
    bench = late.start()
    bench.wait(lambda: bench.diagnostics and 'robot_description: ' in bench.status.message,
               'the reason')
    assert bench.level != 0
    assert_never_ok(bench)
    late.describe(UR5)
    assert_monitors_the_ur5(bench)


def test_diagnostics_keep_their_own_period_once_the_arm_is_known(late):
    bench = late.start(diagnostics_period=100.0, stale_timeout=NEVER_STALE)
    bench.wait(lambda: bench.diagnostics, 'diagnostics')
    late.describe(UR5)
    assert_monitors_the_ur5(bench)
    bench.wait_for_level(0)
    heard = len(bench.diagnostics)
    # Longer than the period while the description is awaited.
    bench.linger(1.3)
    assert len(bench.diagnostics) == heard


def test_second_description_changes_nothing_and_says_so(late, capfd):
    late.describe(UR5)
    bench = late.start()
    assert_monitors_the_ur5(bench)
    late.describe((FIXTURES / 'ur10e.urdf').read_text())
    heard = []
    bench.wait(lambda: heard.append(capfd.readouterr().err) or 'restart' in ''.join(heard),
               'a warning')
    assert_monitors_the_ur5(bench)
    assert bench.get('link_lengths') == pytest.approx(UR5_LENGTHS)


def test_description_in_a_namespace(context, executor):
    late = Late(context, executor, '/left/cell')
    try:
        late.describe(UR5)
        assert_monitors_the_ur5(late.start())
    finally:
        late.close()


# --- errors at start, as a process -----------------------------------------------------------

RUN = 'import sys; from kinopt_ros.executables import singularity_monitor as m; sys.exit(m())'
BAD_START = {
    'base only': ({'base_link': 'base_link'}, ['tip_link']),
    'tip only': ({'tip_link': 'tool0'}, ['base_link']),
    'no such link': ({**UR5_LINKS, 'tip_link': 'hand', 'robot_description': UR5},
                     ['tip_link', 'hand']),
    'wrong way round': ({'base_link': 'wrist_2_link', 'tip_link': 'base_link',
                         'robot_description': UR5}, ['base_link']),
    'too short': ({'base_link': 'base_link', 'tip_link': 'forearm_link',
                   'robot_description': UR5}, ['3']),
    'not parallel': ({**UR5_LINKS, 'robot_description': UR5, 'joint_names':
                      ['shoulder_pan_joint', 'shoulder_lift_joint', 'elbow_joint']},
                     ['shoulder_', '90']),
    'no such joint': ({**UR5_LINKS, 'robot_description': UR5,
                       'joint_names': ['a', 'elbow_joint', 'wrist_1_joint']}, ["'a'"]),
    'no XML': ({**UR5_LINKS, 'robot_description': 'no XML'}, ['robot description', 'XML']),
    'entities': ({**UR5_LINKS, 'robot_description':
                  '<!DOCTYPE r [<!ENTITY a "b">]><robot name="r"/>'}, ['entities']),
    'tool offset': ({**UR5_LINKS, 'robot_description': UR5, 'tool_offset': [0.0, 1.0]},
                    ['tool_offset', '[0.0, 1.0]']),
    'held joints': ({**UR5_LINKS, 'robot_description': UR5,
                     'held_joints': ['wrist_1_joint']}, ['held_positions']),
    'joint held twice': ({**UR5_LINKS, 'robot_description': UR5,
                          'held_joints': ['wrist_2_joint', 'wrist_2_joint'],
                          'held_positions': [0.0, 1.0]}, ['held_joints', 'twice']),
    'unknown held joint': ({**UR5_LINKS, 'robot_description': UR5, 'held_joints': ['rail'],
                            'held_positions': [0.0]}, ['rail']),
    'number of lengths': ({**UR5_LINKS, 'robot_description': UR5,
                           'link_lengths': [1.0, 1.0]}, ['link_lengths', '3']),
}


@pytest.mark.parametrize('case', BAD_START)
def test_bad_start_is_one_line_and_status_1(tmp_path, case):
    import yaml
    parameters, words = BAD_START[case]
    path = tmp_path / 'arm.yaml'
    path.write_text(yaml.safe_dump({'/**': {'ros__parameters': parameters}}))
    done = subprocess.run(
        [sys.executable, '-c', RUN, '--ros-args', '--params-file', str(path)],
        capture_output=True, text=True, timeout=DEADLINE, env=dict(os.environ))
    assert done.returncode == 1, done.stderr
    assert 'Traceback' not in done.stderr
    line, = done.stderr.strip().splitlines()
    for word in words:
        assert word in line, line


def test_bad_description_in_process_leaves_no_node(context):
    from rclpy.parameter import Parameter

    from kinopt_ros.monitor.singularity_monitor import SingularityMonitor
    executor = SingleThreadedExecutor(context=context)
    with pytest.raises(ValueError, match='robot description'):
        SingularityMonitor(context=context, parameter_overrides=[
            Parameter('base_link', value='a'), Parameter('tip_link', value='b'),
            Parameter('robot_description', value='<robot')])
    executor.shutdown()


def test_description_that_does_not_fit_explicit_parameters_ends_the_process(late):
    """Two link lengths for three joints: found out when the description arrives on the topic."""
    late.describe(UR5)
    with subprocess.Popen(
            [sys.executable, '-c', RUN, '--ros-args', '-p', 'base_link:=base_link', '-p',
             'tip_link:=wrist_2_link', '-p', 'link_lengths:=[1.0, 1.0]'],
            stderr=subprocess.PIPE, text=True) as process:
        try:
            _, error = process.communicate(timeout=DEADLINE)
        finally:
            process.kill()
    assert process.returncode == 1, error
    assert 'Traceback' not in error
    line, = (line for line in error.strip().splitlines() if not line.startswith('[INFO]'))
    assert 'link_lengths' in line and '3' in line, error
