"""The node's topics: names, types, quality of service, and what they carry."""

import math

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from support import assert_numbers, expected_numbers, ISOTROPIC, LENGTHS, NAMES, REGULAR, STRETCHED

PUBLISHED = {
    'z': 'std_msgs/msg/Float64',
    'conditioning_length': 'std_msgs/msg/Float64',
    'margin': 'std_msgs/msg/Float64',
    'near_singularity': 'std_msgs/msg/Bool',
}


def subscription_qos(bench, topic='/joint_states'):
    info, = bench.peer.get_subscriptions_info_by_topic(topic)
    return info.qos_profile


def test_topic_names_and_types(bench):
    topics = dict(bench.peer.get_publisher_names_and_types_by_node('singularity_monitor', '/'))
    for name, kind in PUBLISHED.items():
        assert topics.pop(f'/singularity_monitor/{name}') == [kind]
    assert topics.pop('/diagnostics') == ['diagnostic_msgs/msg/DiagnosticArray']
    subscriptions = dict(
        bench.peer.get_subscriber_names_and_types_by_node('singularity_monitor', '/'))
    assert subscriptions['/joint_states'] == ['sensor_msgs/msg/JointState']


def test_joint_states_are_best_effort_keep_last_10(bench):
    # The graph does not tell the depth of a peer, so it is asked of the node itself.
    own, = (s for s in bench.monitor.subscriptions if s.msg_type is JointState)
    assert own.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert own.qos_profile.history == HistoryPolicy.KEEP_LAST
    assert own.qos_profile.depth == 10
    assert own.qos_profile.durability == DurabilityPolicy.VOLATILE
    assert subscription_qos(bench).reliability == ReliabilityPolicy.BEST_EFFORT


def test_best_effort_publisher_is_heard(bench):
    publisher = bench.peer.create_publisher(
        JointState, 'joint_states', QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))
    subscription, = (s for s in bench.monitor.subscriptions if s.msg_type is JointState)
    bench.wait(lambda: publisher.get_subscription_count() == 1
               and subscription.get_publisher_count() == 2, 'discovery of the second publisher')
    numbers, _ = bench.cycle(REGULAR, publisher=publisher)
    assert_numbers(numbers, expected_numbers(LENGTHS, REGULAR))


@pytest.mark.parametrize('policy, value, attribute, expected', [
    ('reliability', 'reliable', 'reliability', ReliabilityPolicy.RELIABLE),
    ('depth', 3, 'depth', 3),
    ('history', 'keep_all', 'history', HistoryPolicy.KEEP_ALL),
])
def test_qos_is_overridable(make_bench, policy, value, attribute, expected):
    bench = make_bench({f'qos_overrides./joint_states.subscription.{policy}': value})
    own, = (s for s in bench.monitor.subscriptions if s.msg_type is JointState)
    assert getattr(own.qos_profile, attribute) == expected
    if policy == 'reliability':
        assert subscription_qos(bench).reliability == expected


@pytest.mark.parametrize('positions', [
    ISOTROPIC, REGULAR, STRETCHED, [4000.0, -123.4, 1e6], [0.0, math.pi, math.pi]])
def test_numbers_equal_an_independent_computation(bench, positions):
    numbers, _ = bench.cycle(positions)
    assert_numbers(numbers, expected_numbers(LENGTHS, positions))


def test_numbers_of_random_arms(make_bench):
    rng = np.random.default_rng(20)
    for n in (3, 5, 9):
        names = [f'joint_{i}' for i in range(n)]
        lengths = (10.0 ** rng.uniform(-2.0, 1.0, n)).tolist()
        offsets = rng.uniform(-3.0, 3.0, n).tolist()
        directions = rng.choice([-1, 1], n).tolist()
        bench = make_bench({
            'joint_names': names, 'link_lengths': lengths, 'joint_offsets': offsets,
            'joint_directions': directions},
            cli_args=['--ros-args', '-r', f'__node:=arm_{n}', '-r', f'joint_states:=arm_{n}'],
            name=f'/arm_{n}', joint_states=f'/arm_{n}')
        for positions in rng.uniform(-4.0, 4.0, (5, n)):
            angles = np.array(directions) * positions + offsets
            numbers, _ = bench.cycle(positions, names)
            assert_numbers(numbers, expected_numbers(lengths, angles))


def test_every_accepted_message_is_one_cycle_on_every_topic(bench):
    for i in range(25):
        bench.cycle([0.0, 0.1 * i, 1.0])
    assert set(bench.counts.values()) == {25}


def test_flag_follows_both_thresholds(bench):
    # By the paper's bound the stretched arm has margin 0; the isotropic one is clear of both.
    assert bench.cycle(ISOTROPIC)[1] is False
    assert bench.cycle(STRETCHED)[1] is True
    assert bench.cycle(ISOTROPIC)[1] is False


def test_positions_are_taken_by_name(bench):
    expected = expected_numbers(LENGTHS, REGULAR)
    names = ['gripper', NAMES[2], 'rail', NAMES[0], NAMES[1]]
    numbers, _ = bench.cycle(
        [math.nan, REGULAR[2], math.inf, REGULAR[0], REGULAR[1]], names)
    assert_numbers(numbers, expected)
    # Another order on the same topic: nothing is kept of the first.
    numbers, _ = bench.cycle(REGULAR[::-1], NAMES[::-1])
    assert_numbers(numbers, expected)
    numbers, _ = bench.cycle(REGULAR)
    assert_numbers(numbers, expected)


@pytest.mark.parametrize('names, positions', [
    (['gripper'], [1.0]),
    ([], []),
    ([], [1.0, 2.0, 3.0]),
    (['gripper', 'gripper'], [math.nan]),
    (['Shoulder', 'elbow ', '/wrist'], [0.0, 1.0, 2.0]),
])
def test_message_without_our_joints_is_ignored(bench, names, positions):
    bench.cycle(REGULAR)
    heard = len(bench.diagnostics)
    bench.send(positions, names)
    # In order behind the ignored one; an answer to that would have come before.
    numbers, flag = bench.cycle(ISOTROPIC)
    assert_numbers(numbers, expected_numbers(LENGTHS, ISOTROPIC))
    assert len(bench.cycles) == 2
    assert all(a.status[0].level == b'\x00' for a in bench.diagnostics[heard:])


def test_namespace(make_bench):
    bench = make_bench(namespace='/left/arm', name='/left/arm/singularity_monitor',
                       joint_states='/left/arm/joint_states')
    numbers, _ = bench.cycle(REGULAR)
    assert_numbers(numbers, expected_numbers(LENGTHS, REGULAR))
    bench.wait(lambda: bench.diagnostics, 'diagnostics')
    assert bench.status.name == 'left/arm/singularity_monitor: posture'
    assert bench.status.hardware_id == 'left/arm/singularity_monitor'


def test_remapping(make_bench):
    bench = make_bench(
        cli_args=['--ros-args', '-r', '__node:=watch', '-r', '__ns:=/cell', '-r',
                  'joint_states:=/robot/states', '-r', '/diagnostics:=/cell/diagnostics'],
        name='/cell/watch', joint_states='/robot/states', diagnostics='/cell/diagnostics')
    numbers, _ = bench.cycle(REGULAR)
    assert_numbers(numbers, expected_numbers(LENGTHS, REGULAR))
    bench.wait(lambda: bench.diagnostics, 'diagnostics')
    assert bench.status.name == 'cell/watch: posture'


def test_private_topic_can_be_remapped(make_bench):
    bench = make_bench(cli_args=['--ros-args', '-r', '/elsewhere/unused:=/x'])
    assert bench.peer.count_publishers('/singularity_monitor/z') == 1
    other = make_bench(
        cli_args=['--ros-args', '-r', '__node:=second', '-r', '~/z:=/second/z'], name='/second')
    assert other.peer.count_publishers('/second/z') == 1


def test_two_monitors_side_by_side(make_bench):
    left = make_bench(namespace='left', name='/left/singularity_monitor',
                      joint_states='/left/joint_states')
    right = make_bench({'link_lengths': [1.0, 2.0, 3.0]}, namespace='right',
                       name='/right/singularity_monitor', joint_states='/right/joint_states')
    assert_numbers(left.cycle(REGULAR)[0], expected_numbers(LENGTHS, REGULAR))
    assert_numbers(right.cycle(REGULAR)[0], expected_numbers([1.0, 2.0, 3.0], REGULAR))
    assert (len(left.cycles), len(right.cycles)) == (1, 1)


def test_serialized_garbage_does_not_end_the_node(bench):
    header = b'\x00\x01\x00\x00'
    for payload in (b'', header, header + b'\xff' * 60, header + bytes(11)):
        bench.publisher.publish(payload)
    numbers, _ = bench.cycle(REGULAR)
    assert_numbers(numbers, expected_numbers(LENGTHS, REGULAR))
