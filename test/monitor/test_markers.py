"""What RViz is shown: where the markers are, what they mean, and what they cost nobody."""

import math
from pathlib import Path
import time
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from support import expected_numbers, ISOTROPIC, LENGTHS, NAMES, REGULAR, STRETCHED
from visualization_msgs.msg import Marker, MarkerArray

from kinopt_ros.monitor import markers
from kinopt_ros.monitor.configuration import Configuration

FIXTURES = Path(__file__).parents[1] / 'fixtures'
FASTEST = {'marker_rate': 100.0}


def watch(bench):
    """Subscribe to the markers; give the list of what is heard."""
    heard = []
    bench.peer.create_subscription(MarkerArray, f'{bench.name}/markers', heard.append, 100)
    own, = (p for p in bench.monitor.publishers if p.topic_name == f'{bench.name}/markers')
    bench.wait(lambda: own.get_subscription_count() == 1, 'discovery of the markers')
    return heard


def shown(bench, heard, positions, names=NAMES):
    """Feed a posture until it is shown, as the rate permits; give its markers by namespace."""
    stamp = (1000 + len(bench.cycles), 0)

    def arrived():
        if not (heard and stamp_of(heard[-1]) == stamp):
            bench.cycle(positions, names, stamp=stamp)
            bench.linger(0.01)
        return heard and stamp_of(heard[-1]) == stamp

    bench.wait(arrived, 'markers')
    return by_namespace(heard[-1])


def stamp_of(array):
    stamp = array.markers[-1].header.stamp
    return stamp.sec, stamp.nanosec


def by_namespace(array):
    return {marker.ns: marker for marker in array.markers if marker.action == Marker.ADD}


def matrix_of(pose):
    """4 x 4 displacement of a pose message."""
    q = pose.orientation
    x, y, z, w = np.array([q.x, q.y, q.z, q.w])
    assert x * x + y * y + z * z + w * w == pytest.approx(1.0)
    frame = np.eye(4)
    frame[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    frame[:3, 3] = pose.position.x, pose.position.y, pose.position.z
    return frame


def points_of(marker):
    """Points of a marker in its header's frame, shape (k, 3)."""
    local = np.array([[p.x, p.y, p.z, 1.0] for p in marker.points])
    return (local @ matrix_of(marker.pose).T)[:, :3]


def planar_joints(lengths, angles):
    """Joint centres and the operation point in the arm's plane, shape (n + 1, 2)."""
    absolute = np.cumsum(angles)
    steps = np.array(lengths)[:, None] * np.column_stack([np.cos(absolute), np.sin(absolute)])
    return np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)])


# --- cost -----------------------------------------------------------------------------------


def test_nothing_is_computed_when_nobody_subscribes(make_bench, monkeypatch):
    made = []
    monkeypatch.setattr(markers, 'Marker', CountedMarker(made))
    closest = Configuration.attained_model_set
    monkeypatch.setattr(Configuration, 'attained_model_set',
                        lambda *given: (made.append('model set'), closest(*given))[1])
    bench = make_bench(FASTEST)
    for i in range(10):
        bench.cycle([0.0, 0.1 * i, 1.0])
    assert made == []
    heard = watch(bench)
    shown(bench, heard, REGULAR)
    assert {'marker', 'model set'} == set(made)


class CountedMarker:
    """The message class, with a note of each one that is made."""

    def __init__(self, made):
        self._made = made

    def __call__(self, **fields):
        self._made.append('marker')
        return Marker(**fields)

    def __getattr__(self, name):
        return getattr(Marker, name)


def test_rate_is_limited(make_bench):
    bench = make_bench({'marker_rate': 0.1})
    heard = watch(bench)
    shown(bench, heard, REGULAR)
    start, count = time.monotonic(), len(heard)
    for i in range(50):
        bench.cycle([0.0, 0.1 * i, 1.0])
    bench.linger(0.05)
    assert len(heard) - count <= 1 + (time.monotonic() - start) * 0.1
    # A change of the rate counts at once.
    assert bench.set(marker_rate=100.0)[0].successful
    shown(bench, heard, ISOTROPIC)


# --- frame ----------------------------------------------------------------------------------


@pytest.mark.parametrize('parameters, frame', [
    ({}, 'base_link'), ({'base_frame': 'cell'}, 'cell')])
def test_frame_and_stamp(make_bench, parameters, frame):
    bench = make_bench({**FASTEST, **parameters})
    heard = watch(bench)
    bench.cycle(REGULAR, stamp=(12, 34))
    bench.wait(lambda: heard, 'markers')
    added = by_namespace(heard[0]).values()
    assert {(m.header.frame_id, m.header.stamp.sec, m.header.stamp.nanosec)
            for m in added} == {(frame, 12, 34)}
    links = points_of(by_namespace(heard[0])['links'])
    np.testing.assert_allclose(links[:, :2], planar_joints(LENGTHS, REGULAR), atol=1e-9)
    np.testing.assert_allclose(links[:, 2], 0.0, atol=1e-12)


def test_each_array_replaces_the_one_before(make_bench):
    bench = make_bench(FASTEST)
    heard = watch(bench)
    shown(bench, heard, REGULAR)
    assert heard[-1].markers[0].action == Marker.DELETEALL
    identities = [(m.ns, m.id) for m in heard[-1].markers if m.action == Marker.ADD]
    assert len(set(identities)) == len(identities)
    # RViz draws nothing of a marker with a zero scale or no opacity.
    for marker in by_namespace(heard[-1]).values():
        assert marker.color.a > 0.0
        assert max(marker.scale.x, marker.scale.z) > 0.0


def urdf_forward_kinematics(urdf, positions):
    """Place every link of a URDF tree in its root, from the XML directly."""
    placed, joints = {}, list(ElementTree.fromstring(urdf).iter('joint'))
    children = {joint.find('child').get('link') for joint in joints}
    parents = {joint.find('parent').get('link') for joint in joints}
    root, = parents - children
    placed[root] = np.eye(4)
    while len(placed) <= len(joints):
        for joint in joints:
            parent, child = joint.find('parent').get('link'), joint.find('child').get('link')
            if parent in placed and child not in placed:
                placed[child] = placed[parent] @ origin_of(joint) @ motion_of(joint, positions)
    return placed


def origin_of(joint):
    origin = joint.find('origin')
    roll, pitch, yaw = map(float, origin.get('rpy').split())
    frame = np.eye(4)
    frame[:3, :3] = (turned([0, 0, 1], yaw) @ turned([0, 1, 0], pitch)
                     @ turned([1, 0, 0], roll))
    frame[:3, 3] = [float(x) for x in origin.get('xyz').split()]
    return frame


def motion_of(joint, positions):
    frame = np.eye(4)
    if joint.get('type') in ('revolute', 'continuous'):
        axis = [float(x) for x in joint.find('axis').get('xyz').split()]
        frame[:3, :3] = turned(axis, positions.get(joint.get('name'), 0.0))
    return frame


def turned(axis, angle):
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


DESCRIBED = [
    ('ur5', 'base_link', 'wrist_2_link', 'shoulder_link',
     {'shoulder_lift_joint': -0.9, 'elbow_joint': 1.3, 'wrist_1_joint': -0.6}),
    ('planar_4r', 'base_link', 'tip', 'wall_plate',
     {'joint_1': 0.4, 'joint_2': -1.1, 'joint_3': 0.8, 'joint_4': 2.0}),
    ('scara', 'base_link', 'tool', 'base_link',
     {'joint_1': 0.4, 'joint_2': -1.1, 'joint_4': 0.8}),
]


@pytest.mark.parametrize('name, base, tip, parent, positions', DESCRIBED,
                         ids=[case[0] for case in DESCRIBED])
def test_markers_stand_on_the_described_robot(make_bench, name, base, tip, parent, positions):
    urdf = (FIXTURES / f'{name}.urdf').read_text()
    bench = make_bench({**FASTEST, 'joint_names': None, 'link_lengths': None, 'base_link': base,
                        'tip_link': tip, 'robot_description': urdf})
    heard = watch(bench)
    array = shown(bench, heard, list(positions.values()), list(positions))
    placed = urdf_forward_kinematics(urdf, positions)
    in_parent = np.linalg.inv(placed[parent])
    carried = {joint.get('name'): joint.find('child').get('link')
               for joint in ElementTree.fromstring(urdf).iter('joint')}
    centres = [in_parent @ placed[carried[joint]] for joint in positions]
    points, tip_frame = points_of(array['joints']), in_parent @ placed[tip]
    assert array['joints'].header.frame_id == parent
    axis = centres[0][:3, 2]
    # Along the common axis a link may be staggered; in the plane the points coincide.
    for point, centre in zip([*points, points_of(array['operation point'])[0]],
                             [*centres, tip_frame]):
        across = (point - centre[:3, 3]) - axis * (axis @ (point - centre[:3, 3]))
        np.testing.assert_allclose(across, 0.0, atol=1e-7)
    np.testing.assert_allclose(points[0], centres[0][:3, 3], atol=1e-7)
    np.testing.assert_allclose((points - points[0]) @ axis, 0.0, atol=1e-7)


def test_text_stands_at_the_operation_point_of_a_tilted_plane(make_bench):
    name, base, tip, parent, positions = DESCRIBED[1]
    urdf = (FIXTURES / f'{name}.urdf').read_text()
    bench = make_bench({**FASTEST, 'joint_names': None, 'link_lengths': None, 'base_link': base,
                        'tip_link': tip, 'robot_description': urdf})
    array = shown(bench, watch(bench), list(positions.values()), list(positions))
    text = matrix_of(array['text'].pose)[:3, 3]
    point = points_of(array['operation point'])[0]
    normal = matrix_of(array['links'].pose)[:3, 2]
    np.testing.assert_allclose(np.cross(text - point, normal), 0.0, atol=1e-7)


# --- meaning --------------------------------------------------------------------------------


def test_isotropic_set_is_isotropic_around_the_operation_point(make_bench):
    bench = make_bench(FASTEST)
    heard = watch(bench)
    for positions in (REGULAR, [1.0, -0.7, 0.9], ISOTROPIC):
        array = shown(bench, heard, positions)
        points = points_of(array['isotropic set'])[:, :2]
        tip = points_of(array['operation point'])[0, :2]
        length = expected_numbers(LENGTHS, positions).conditioning_length
        around = (points - tip) / length
        n = len(around)
        # The centroid at P, the second moment a multiple of the identity, K K^T = n 1.
        np.testing.assert_allclose(around.sum(axis=0), 0.0, atol=1e-7)
        np.testing.assert_allclose(around.T @ around, n * np.eye(2), atol=1e-7)
        joints = planar_joints(LENGTHS, positions)
        # It is the closest: its distance to the joint centres gives z of the definition.
        difference = (joints[:-1] - joints[-1]) / length - around
        assert np.sum(difference ** 2) / (2 * n) == pytest.approx(
            expected_numbers(LENGTHS, positions).z, abs=1e-7)
        spokes = points_of(array['isotropic set spokes'])[:, :2]
        np.testing.assert_allclose(spokes[0::2], np.tile(tip, (n, 1)), atol=1e-9)
        np.testing.assert_allclose(spokes[1::2], points, atol=1e-9)
    # At the isotropic posture the set lies on the joint centres.
    np.testing.assert_allclose(points, joints[:-1], atol=1e-6)


@pytest.mark.parametrize('lengths, optimum', [
    (LENGTHS, ISOTROPIC), ([1.0, 1.0, 1.0], np.radians([0.0, 81.8, 155.2]).tolist())])
def test_conditioning_circle(make_bench, lengths, optimum):
    """The locus of P at the optimum while joint 1 turns, around the first joint."""
    bench = make_bench({**FASTEST, 'link_lengths': lengths})
    heard = watch(bench)
    bench.wait(lambda: 'conditioning circle' in shown(bench, heard, REGULAR), 'the circle')
    points = points_of(by_namespace(heard[-1])['conditioning circle'])
    np.testing.assert_allclose(points[0], points[-1], atol=1e-9)
    radius = np.linalg.norm(planar_joints(lengths, optimum)[-1])
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), radius, atol=2e-3)
    assert len(points) > 30


def test_conditioning_circle_follows_the_link_lengths(make_bench):
    bench = make_bench(FASTEST)
    heard = watch(bench)
    assert bench.set(link_lengths=[2.0 * a for a in LENGTHS])[0].successful
    radius = 2.0 * np.linalg.norm(planar_joints(LENGTHS, ISOTROPIC)[-1])

    def has_followed():
        circle = shown(bench, heard, REGULAR).get('conditioning circle')
        return circle is not None and abs(np.linalg.norm(points_of(circle)[0]) - radius) < 1e-4

    bench.wait(has_followed, 'the circle of the new lengths')


def test_colours_go_by_the_margin(make_bench):
    bench = make_bench(FASTEST)
    heard = watch(bench)
    colours = []
    for positions in (STRETCHED, REGULAR, ISOTROPIC):
        array = shown(bench, heard, positions)
        colours.append([getattr(array['links'].color, c) for c in 'rgb'])
        assert array['joints'].color == array['links'].color
    worst, between, best = np.array(colours)
    # Red to blue, and in proportion to the margin in between.
    assert worst[0] > worst[2] and best[2] > best[0]
    margin = expected_numbers(LENGTHS, REGULAR).margin
    np.testing.assert_allclose(between, worst + margin * (best - worst), atol=1e-6)


def test_text_tells_the_three_numbers(make_bench):
    bench = make_bench(FASTEST)
    array = shown(bench, watch(bench), REGULAR)
    expected = expected_numbers(LENGTHS, REGULAR)
    words = array['text'].text.split()
    assert float(words[words.index('z') + 1]) == pytest.approx(expected.z, abs=1e-3)
    assert float(words[words.index('l_P') + 1]) == pytest.approx(
        expected.conditioning_length, rel=1e-2)
    assert float(words[words.index('margin') + 1]) == pytest.approx(expected.margin, abs=1e-3)


def test_polygon_is_the_set_that_is_drawn(make_bench):
    """What is drawn belongs to the numbers beside it: the set that z is the distance to."""
    bench = make_bench({**FASTEST, 'model_set': 'polygon'})
    positions = [0.3, -1.5, -2.0]
    array = shown(bench, watch(bench), positions)
    numbers, _ = bench.cycles[-1]
    joints = planar_joints(LENGTHS, positions)
    around = points_of(array['isotropic set'])[:, :2] - joints[-1]
    difference = (joints[:-1] - joints[-1] - around) / numbers.conditioning_length
    assert np.sum(difference ** 2) / 6.0 == pytest.approx(numbers.z, abs=1e-6)


def test_unknown_posture_draws_no_arm(make_bench):
    bench = make_bench({'marker_rate': 0.1})
    heard = watch(bench)
    shown(bench, heard, REGULAR)
    assert 'links' in by_namespace(heard[-1])
    # At once, whatever the rate: an arm that is not seen is not shown as safe.
    bench.cycle([0.0, math.nan, 0.0])
    bench.wait(lambda: 'links' not in by_namespace(heard[-1]), 'markers of the lost posture')
    array = by_namespace(heard[-1])
    assert not {'links', 'joints', 'operation point', 'isotropic set'} & set(array)
    assert 'elbow' in array['text'].text
    assert heard[-1].markers[0].action == Marker.DELETEALL


def test_stale_posture_draws_no_arm(make_bench):
    bench = make_bench({**FASTEST, 'stale_timeout': 0.1})
    heard = watch(bench)
    bench.send(REGULAR)
    bench.wait(lambda: heard and 'links' in by_namespace(heard[-1]), 'the arm')
    bench.wait(lambda: 'links' not in by_namespace(heard[-1]), 'its disappearance')
    assert all(name in by_namespace(heard[-1])['text'].text for name in NAMES)
