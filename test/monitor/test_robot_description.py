"""Robot descriptions: known arms come out right, strange and hostile ones are refused at once."""

import math
from pathlib import Path
import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
import yaml

from kinopt_ros.kinetostatics.planar_subchain import PARALLEL_TOLERANCE
from kinopt_ros.monitor import robot_description
from kinopt_ros.monitor.robot_description import chain_of, planar_subchain_of

pytest.importorskip('urdf_parser_py', reason=robot_description.INSTALL_HINT)

HERE = Path(__file__).parent
FIXTURES = HERE.parent / 'fixtures'
CONFIG = HERE.parents[1] / 'config'
LIMIT = '<limit lower="-2" upper="3" effort="1" velocity="1"/>'

# Arm, its tip link for the operation point of its configuration.
ARMS = {'ur3e': 'wrist_2_link', 'ur5': 'wrist_2_link', 'ur5e': 'wrist_2_link',
        'ur10e': 'wrist_2_link', 'scara': 'tool', 'planar_4r': 'tip'}


def fixture_text(name):
    return (FIXTURES / f'{name}.urdf').read_text(encoding='utf-8')


def configured(name):
    text = (CONFIG / f'{name}.yaml').read_text(encoding='utf-8')
    return yaml.safe_load(text)['/**']['ros__parameters']


def joint_xml(name, parent, child, body='<axis xyz="0 0 1"/>' + LIMIT, kind='revolute',
              origin='<origin xyz="1 0 0"/>'):
    return (f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="{child}"/>{origin}{body}</joint>')


def robot_xml(joints, links='abcdef', extra=''):
    return ('<robot name="r">' + ''.join(f'<link name="{name}"/>' for name in links)
            + ''.join(joints) + extra + '</robot>')


def arm_xml(**changes):
    """Build an arm a - b - c - d - e of three parallel joints and a fixed one."""
    joints = {'j1': joint_xml('j1', 'a', 'b'), 'j2': joint_xml('j2', 'b', 'c'),
              'j3': joint_xml('j3', 'c', 'd'),
              'tip': joint_xml('tip', 'd', 'e', body='', kind='fixed')}
    extra = changes.pop('extra', '')
    return robot_xml({**joints, **changes}.values(), extra=extra)


@pytest.mark.parametrize('name', ARMS)
def test_configuration_agrees_with_the_description(name):
    parameters = configured(name)
    sub = planar_subchain_of(fixture_text(name), 'base_link', ARMS[name])
    assert list(sub.joint_names) == parameters['joint_names']
    assert sub.link_lengths == pytest.approx(parameters['link_lengths'], abs=1e-12)
    assert sub.joint_offsets == pytest.approx(parameters['joint_offsets'], abs=1e-12)
    assert list(sub.joint_directions) == parameters['joint_directions']
    assert sub.joint_lower == pytest.approx(parameters['joint_lower'], abs=1e-12)
    assert sub.joint_upper == pytest.approx(parameters['joint_upper'], abs=1e-12)
    assert sub.tip_movers == ()


# Denavit-Hartenberg rows (a, d, alpha) as the manufacturer prints them.
UR_TABLES = {
    'ur3e': [(0, 0.15185, 1), (-0.24355, 0, 0), (-0.2132, 0, 0), (0, 0.13105, 1),
             (0, 0.08535, -1), (0, 0.0921, 0)],
    'ur5': [(0, 0.089159, 1), (-0.425, 0, 0), (-0.39225, 0, 0), (0, 0.10915, 1),
            (0, 0.09465, -1), (0, 0.0823, 0)],
    'ur5e': [(0, 0.1625, 1), (-0.425, 0, 0), (-0.3922, 0, 0), (0, 0.1333, 1), (0, 0.0997, -1),
             (0, 0.0996, 0)],
    'ur10e': [(0, 0.1807, 1), (-0.6127, 0, 0), (-0.57155, 0, 0), (0, 0.17415, 1),
              (0, 0.11985, -1), (0, 0.11655, 0)],
}


def dh_points(rows, angles):
    """Origins of the Denavit-Hartenberg frames, in the controller's base frame."""
    frame, points = np.eye(4), []
    for (a, d, quarters), angle in zip(rows, angles):
        step = np.eye(4)
        turn = Rotation.from_euler('z', angle)
        step[:3, :3] = (turn * Rotation.from_euler('x', quarters * math.pi / 2)).as_matrix()
        step[:3, 3] = turn.apply([a, 0.0, d])
        frame = frame @ step
        points.append(frame[:3, 3])
    return points


@pytest.mark.parametrize('name', UR_TABLES)
def test_fixture_moves_as_the_manufacturers_table(name):
    rng = np.random.default_rng(7)
    chain = chain_of(fixture_text(name), 'base_link', 'tool0')
    turn_back = Rotation.from_euler('z', math.pi)
    for _ in range(5):
        angles = rng.uniform(-3.0, 3.0, 6)
        values = iter(angles)
        frame = np.eye(4)
        for joint in chain:
            frame = frame @ joint.origin
            if joint.joint_type != 'fixed':
                frame[:3, :3] = frame[:3, :3] @ Rotation.from_rotvec(
                    next(values) * joint.axis).as_matrix()
        expected = turn_back.apply(dh_points(UR_TABLES[name], angles)[-1])
        np.testing.assert_allclose(frame[:3, 3], expected, atol=1e-12)


@pytest.mark.parametrize('name', UR_TABLES)
def test_ur_operation_point_is_where_wrist_2_and_wrist_3_meet(name):
    rng = np.random.default_rng(8)
    sub = planar_subchain_of(fixture_text(name), 'base_link', 'wrist_2_link')
    for _ in range(5):
        angles = rng.uniform(-3.0, 3.0, 6)
        points = dh_points(UR_TABLES[name], angles)
        theta = np.array(sub.joint_directions) * angles[1:4] + sub.joint_offsets
        # Distance of frame 5's origin from the shoulder, seen along the parallel axes.
        pan = Rotation.from_euler('z', angles[0])
        seen = pan.inv().apply(points[4] - points[0])
        expected = math.hypot(seen[0], seen[2])
        assert abs(sub.arm().operation_point_vectors(theta)[0]) == pytest.approx(expected)


def test_tool0_of_a_ur_depends_on_wrist_2_and_says_so():
    text = fixture_text('ur5')
    sub = planar_subchain_of(text, 'base_link', 'tool0')
    # At wrist 2 = 0 the flange is straight out of the plane and the lengths are the same.
    assert sub.link_lengths == pytest.approx((0.425, 0.39225, 0.09465))
    assert sub.tip_movers == ('wrist_2_joint',)
    sub = planar_subchain_of(text, 'base_link', 'tool0',
                             held_positions={'wrist_2_joint': math.pi / 2})
    assert sub.link_lengths[-1] == pytest.approx(math.hypot(0.09465, 0.0823))
    # What is held on purpose is no news.
    assert sub.tip_movers == ()


def test_scara_needs_a_reach():
    with pytest.raises(ValueError, match="axis of joint 'joint_4'.*tool_offset"):
        planar_subchain_of(fixture_text('scara'), 'base_link', 'flange')
    sub = planar_subchain_of(fixture_text('scara'), 'base_link', 'flange',
                             tool_offset=(0.0, 0.03, 0.0))
    assert sub.link_lengths == pytest.approx((0.22, 0.13, 0.03))


@pytest.mark.parametrize('seed', range(20))
def test_text_of_a_random_chain_comes_back(seed):
    rng = np.random.default_rng(seed)
    joints, expected = [], []
    for i in range(5):
        xyz, rpy, axis = rng.normal(size=(3, 3))
        numbers = [' '.join(repr(float(value)) for value in v) for v in (xyz, rpy, axis)]
        joints.append(joint_xml(
            f'j{i}', 'abcdef'[i], 'abcdef'[i + 1], f'<axis xyz="{numbers[2]}"/>' + LIMIT,
            origin=f'<origin xyz="{numbers[0]}" rpy="{numbers[1]}"/>'))
        # Lower case: scipy's rotations about fixed axes.
        expected.append((Rotation.from_euler('xyz', rpy).as_matrix(), xyz, axis))
    rng.shuffle(joints)
    for joint, (turn, xyz, axis) in zip(chain_of(robot_xml(joints), 'a', 'f'), expected):
        np.testing.assert_allclose(joint.origin[:3, :3], turn, atol=1e-12)
        np.testing.assert_array_equal(joint.origin[:3, 3], xyz)
        np.testing.assert_array_equal(joint.axis, axis)
        assert (joint.lower, joint.upper) == (-2.0, 3.0)


def test_defaults_of_urdf():
    chain = chain_of(arm_xml(j1=joint_xml('j1', 'a', 'b', '', 'continuous', origin='')), 'a', 'e')
    np.testing.assert_array_equal(chain[0].origin, np.eye(4))
    np.testing.assert_array_equal(chain[0].axis, (1.0, 0.0, 0.0))
    assert (chain[0].lower, chain[0].upper) == (-math.inf, math.inf)
    assert chain[0].parent_link == 'a'


def test_extensions_are_not_looked_at(capfd):
    extra = ('<material name="m"/><gazebo><sensor/></gazebo><ros2_control name="x" type="y">'
             '<joint name="j1"><command_interface name="position"/></joint></ros2_control>'
             '<transmission name="t"/>')
    visual = joint_xml('j2', 'b', 'c', '<axis xyz="0 0 1"/><dynamics damping="nonsense"/>' + LIMIT)
    sub = planar_subchain_of(arm_xml(j2=visual, extra=extra), 'a', 'e')
    assert sub.joint_names == ('j1', 'j2', 'j3')
    assert capfd.readouterr() == ('', '')


def test_missing_parser_is_said_with_the_remedy(monkeypatch):
    monkeypatch.setitem(__import__('sys').modules, 'urdf_parser_py.urdf', None)
    with pytest.raises(ImportError, match='urdfdom-py.*urdf-parser-py'):
        planar_subchain_of(arm_xml(), 'a', 'e')


def test_declared_encoding_does_not_matter():
    text = '<?xml version="1.0" encoding="utf-16"?>' + arm_xml().replace('"j1"', '"Gelenk-ä"')
    assert planar_subchain_of(text, 'a', 'e').joint_names[0] == 'Gelenk-ä'


TILT = math.tan(2.0 * PARALLEL_TOLERANCE)


@pytest.mark.parametrize('text, words', [
    ('', ['no text']),
    ('   ', ['no text']),
    (None, ['no text']),
    (b'<robot/>', ['no text']),
    ('hello', ['not well-formed']),
    ('<robot name="r">', ['not well-formed']),
    ('\x00' * 10, ['not well-formed']),
    ('<robot name="\ud800"/>', ['not well-formed']),
    ('<sdf version="1.6"/>', ['<sdf>', '<robot>']),
    ('<robot name="r" version="2.0"/>', ['version']),
    ('<robot name="r"/>', ["base_link = 'a'"]),
    (arm_xml(extra='<xacro:include filename="x"/>'), ['xacro']),
    (arm_xml(extra='<link name="a"/>'), ["two links are named 'a'"]),
    (arm_xml(extra='<link/>'), ['<link> has no name']),
    (arm_xml(extra='<joint type="fixed"/>'), ['<joint> has no name']),
    (arm_xml(j3=joint_xml('j2', 'c', 'd')), ["two joints are named 'j2'"]),
    (arm_xml(j2=joint_xml('j2', 'b', 'zz')), ["'j2'", "'zz'", 'not defined']),
    (arm_xml(j2=joint_xml('j2', 'zz', 'c')), ["'j2'", "'zz'", 'not defined']),
    (arm_xml(extra=joint_xml('j9', 'f', 'c')), ["'c' has two parents", "'j2'", "'j9'"]),
    (arm_xml(j1=joint_xml('j1', 'e', 'b')), ["'e'", 'loop']),
    (arm_xml(j1=joint_xml('j1', 'b', 'b')), ['loop']),
    (arm_xml(j2=''), ["tip_link = 'e'", "base_link = 'a'", "ends at the link 'c'"]),
    (arm_xml(j2=joint_xml('j2', 'b', 'c', kind='hinge')), ['Invalid joint type']),
    (arm_xml(j2=joint_xml('j2', 'b', 'c', kind='floating')), ["'j2' is floating"]),
    (arm_xml(j2=joint_xml('j2', 'b', 'c', kind='planar')), ["'j2' is planar"]),
    (arm_xml(j2=joint_xml('j2', 'b', 'c', '')), ["'j2'", '<limit>']),
    (arm_xml(j2=joint_xml('j2', 'b', 'c', '<limit lower="0" upper="1"/>')), ['effort']),
    (arm_xml(j2=joint_xml('j2', 'b', 'c', LIMIT.replace('-2', '5'))), ["'j2'", '5.0 .. 3.0']),
    (arm_xml(j2=joint_xml('j2', 'b', 'c', LIMIT.replace('-2', 'nan'))), ["'j2'", 'nan .. 3.0']),
    (arm_xml(j2=joint_xml('j2', 'b', 'c', '<axis xyz="0 0 0"/>' + LIMIT)), ["'j2' is zero"]),
    (arm_xml(j2=joint_xml('j2', 'b', 'c', '<axis xyz="0 nan 0"/>' + LIMIT)), ["'j2'", 'finite']),
    (arm_xml(j2=joint_xml('j2', 'b', 'c', '<axis xyz="0 1"/>' + LIMIT)), ['vector length']),
    (arm_xml(j2=joint_xml('j2', 'b', 'c', '<axis/>' + LIMIT)), ["<axis> of joint 'j2'", 'xyz']),
    (arm_xml(j2=joint_xml('j2', 'b', 'c', f'<axis xyz="0 {TILT} 1"/>' + LIMIT)),
     ["'j2' at 0.04 rad"]),
    (arm_xml(j2=joint_xml('j2', 'b', 'c', '<mimic joint="j1"/>' + LIMIT)), ["'j2' mimics 'j1'"]),
    (arm_xml(j2=joint_xml('j2', 'b', 'c', '<mimic/>' + LIMIT)), ["<mimic> of joint 'j2'"]),
    (arm_xml(j2=joint_xml('j2', 'b', 'c', LIMIT + LIMIT)), ["'j2'", 'more than one <limit>']),
    (arm_xml(j2='<joint name="j2" type="fixed"><parent/><child link="c"/></joint>'),
     ["<parent> of joint 'j2'", 'link']),
    (arm_xml(j2='<joint name="j2" type="fixed"><child link="c"/></joint>'), ['parent']),
    (arm_xml(j2='<joint name="j2"><parent link="b"/><child link="c"/></joint>'), ['type']),
    *[(arm_xml(j2=joint_xml('j2', 'b', 'c', origin=f'<origin {attribute}/>')), words)
      for attribute, words in [
          ('xyz="nan 0 0"', ["origin of joint 'j2'", 'finite']),
          ('xyz="0 inf 0"', ["origin of joint 'j2'", 'finite']),
          ('xyz="0 1e999 0"', ["origin of joint 'j2'", 'finite']),
          ('xyz="0 1e300 0"', ["'j2'", '1e+06 m']),
          ('rpy="0 nan 0"', ["origin of joint 'j2'", 'finite']),
          ('rpy="0 0"', ['vector length']),
          ('xyz="${x} 0 0"', ['could not convert']),
          ('xyz="1 0 0" quat_xyzw="0 0 0 1"', ["'j2'", 'quat_xyzw'])]],
])
def test_refusals_say_what_is_wrong(text, words):
    with pytest.raises(ValueError) as refusal:
        planar_subchain_of(text, 'a', 'e')
    for word in words:
        assert word in str(refusal.value)


@pytest.mark.parametrize('base, tip, words', [
    ('nowhere', 'e', ["base_link = 'nowhere'"]), ('a', 'nowhere', ["tip_link = 'nowhere'"]),
    ('e', 'a', ["tip_link = 'a' is not below base_link = 'e'"]),
    ('a', 'f', ["tip_link = 'f' is not below"]), ('a', 'a', ['no movable joint'])])
def test_links_that_make_no_chain(base, tip, words):
    with pytest.raises(ValueError) as refusal:
        planar_subchain_of(arm_xml(), base, tip)
    for word in words:
        assert word in str(refusal.value)


LAUGHS = ('<!DOCTYPE r [<!ENTITY a "ha">' + ''.join(
    f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip('abcdefghi', 'bcdefghij')) + ']>')
MANY = 400_000


@pytest.mark.parametrize('text, words', [
    (LAUGHS + '<robot name="&j;"/>', ['document types']),
    ('<!DOCTYPE r SYSTEM "file:///etc/passwd"><robot name="r"/>', ['document types']),
    ('<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot name="&x;"/>',
     ['document types']),
    (arm_xml().replace('"a"', '"&a;"'), ['not well-formed']),
    ('<robot name="r">' + '<a>' * 1_300_000, ['nested more than 100 deep']),
    ('<robot name="r">' + ' ' * 4_000_000, ['characters', '4000000']),
    (robot_xml([], links=[str(i) for i in range(20_000)]), ['more than 10000']),
    ('<robot name="r"><joint name="j">' + '<origin/>' * MANY, ['more than one <origin>']),
    (arm_xml(j2=joint_xml('j2', 'b', 'c', origin=f'<origin xyz="{"1 " * MANY}"/>')),
     ['xyz', 'at most 1000']),
    (arm_xml(j2=joint_xml('j2', 'b', 'c', f'<mimic joint="{"1" * MANY}"/>')),
     ['joint', 'at most 1000']),
    (f'<robot name="r"><joint name="{"n" * MANY}"/></robot>', ['name', 'at most 1000']),
    (f'<{"n" * MANY}/>', ['<robot>']),
    ('<robot name="r">' + ''.join(f'<a b{i}="1"/>' for i in range(MANY // 2)) + '</robot>',
     ["base_link = 'a'"]),
])
def test_hostile_documents_are_refused_at_once(text, words, capfd):
    start = time.perf_counter()
    with pytest.raises(ValueError) as refusal:
        planar_subchain_of(text, 'a', 'e')
    # A quarter of a second where this was written. urdf_parser_py alone takes up to 7 s and
    # writes 18 MB on stderr.
    assert time.perf_counter() - start < 5.0
    assert len(str(refusal.value)) < 1000
    for word in words:
        assert word in str(refusal.value)
    assert capfd.readouterr() == ('', '')


def test_longest_chain_accepted_is_read_at_once():
    count = 4_999
    joints = [joint_xml(f'j{i}', f'l{i}', f'l{i + 1}', LIMIT, 'prismatic', '')
              for i in range(count)]
    text = robot_xml(joints, links=[f'l{i}' for i in range(count + 1)])
    start = time.perf_counter()
    with pytest.raises(ValueError, match='no 3 successive parallel axes') as refusal:
        planar_subchain_of(text, 'l0', f'l{count}')
    assert len(str(refusal.value)) < 2000
    assert time.perf_counter() - start < 10.0
