"""
The planar arm found in a spatial chain, against spatial kinematics of the test's own.

The oracle knows nothing of planes: it multiplies 4 x 4 matrices (rotations by scipy), builds the
spatial geometric Jacobian column by column, and leaves it to the comparison to pick rows.
"""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinopt_ros.kinetostatics.planar_subchain import (
    ChainJoint,
    FARTHEST,
    PARALLEL_TOLERANCE,
    planar_subchain,
)

FREE = ('revolute', 'continuous')


def pose(xyz=(0.0, 0.0, 0.0), turn=None):
    """Rigid displacement from a translation and a scipy rotation."""
    result = np.eye(4)
    result[:3, 3] = xyz
    if turn is not None:
        result[:3, :3] = turn.as_matrix()
    return result


def joint(name, axis=(0.0, 0.0, 1.0), xyz=(1.0, 0.0, 0.0), kind='revolute', **more):
    return ChainJoint(name, kind, pose(xyz), np.array(axis, dtype=float), **more)


def planar_chain(count=3):
    return [joint(f'j{i}') for i in range(1, count + 1)] + [joint('tip', kind='fixed')]


def spatial_kinematics(chain, positions, tool=(0.0, 0.0, 0.0)):
    """Axes, points on them and the tool point in the base link, and link poses by name."""
    frame = np.eye(4)
    axes, points, links = {}, {}, {}
    for member in chain:
        frame = frame @ member.origin
        direction = np.asarray(member.axis) / np.linalg.norm(member.axis)
        axes[member.name] = frame[:3, :3] @ direction
        points[member.name] = frame[:3, 3].copy()
        links[member.name] = frame.copy()
        position = positions.get(member.name, 0.0)
        if member.joint_type in FREE:
            frame = frame @ pose(turn=Rotation.from_rotvec(position * direction))
        elif member.joint_type == 'prismatic':
            frame = frame @ pose(position * direction)
    return axes, points, frame[:3, :3] @ tool + frame[:3, 3], links


def spatial_jacobian(chain, names, positions, tool=(0.0, 0.0, 0.0)):
    """Geometric Jacobian (6 x n, linear over angular) of the tool point."""
    axes, points, tip, _ = spatial_kinematics(chain, positions, tool)
    return np.column_stack([
        np.concatenate([np.cross(axes[name], tip - points[name]), axes[name]])
        for name in names])


def random_pose(rng, size=1.0):
    return pose(size * rng.normal(size=3), Rotation.random(random_state=rng))


def random_chain(rng, count):
    """
    Build a chain with `count` parallel axes hidden among fixed, held and sliding joints.

    Every frame is random; the parallel axes are made so from the frames that result at the
    held positions.
    """
    held = {}
    normal = Rotation.random(random_state=rng).as_matrix()[:, 0]
    chain, frame = [], np.eye(4)

    def add(name, kind, direction=None, position=0.0):
        nonlocal frame
        origin = random_pose(rng, 0.5)
        frame = frame @ origin
        axis = rng.normal(size=3) if direction is None else frame[:3, :3].T @ direction
        chain.append(ChainJoint(name, kind, origin, rng.uniform(0.1, 10.0) * axis))
        if kind in FREE:
            unit = axis / np.linalg.norm(axis)
            frame = frame @ pose(turn=Rotation.from_rotvec(position * unit))
        elif kind == 'prismatic':
            frame = frame @ pose(position * axis / np.linalg.norm(axis))

    add('pan', 'revolute')
    for i in range(count):
        if rng.random() < 0.5:
            add(f'fixed_{i}', 'fixed')
        if i and rng.random() < 0.4:
            held[f'held_{i}'] = rng.uniform(-1.0, 1.0)
            add(f'held_{i}', rng.choice(['revolute', 'prismatic']), position=held[f'held_{i}'])
        if i and rng.random() < 0.4:
            add(f'slide_{i}', 'prismatic', normal * rng.choice([-1.0, 1.0]))
        add(f'axis_{i}', rng.choice(FREE), normal * rng.choice([-1.0, 1.0]))
    add('wrist', 'revolute')
    add('tool', 'fixed')
    return chain, held


@pytest.mark.parametrize('seed', range(60))
def test_planar_jacobian_is_rows_of_the_spatial_one(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 8))
    chain, held = random_chain(rng, count)
    tool = rng.normal(size=3)
    held['wrist'] = rng.uniform(-3.0, 3.0)
    sub = planar_subchain(chain, tool_offset=tool, held_positions=held)
    assert sub.joint_names == tuple(f'axis_{i}' for i in range(count))
    for _ in range(3):
        positions = rng.uniform(-4.0, 4.0, count)
        theta = np.array(sub.joint_directions) * positions + sub.joint_offsets
        everything = {**held, **dict(zip(sub.joint_names, positions))}
        spatial = spatial_jacobian(chain, sub.joint_names, everything, tool)
        x, y, z = sub.plane_frame[:3, :3].T
        rows = np.vstack([z @ spatial[3:], x @ spatial[:3], y @ spatial[:3]])
        # A direction of -1 is a joint turning the other way round than its planar angle.
        planar = sub.arm().jacobian(theta) * sub.joint_directions
        np.testing.assert_allclose(planar, rows, atol=1e-9)


@pytest.mark.parametrize('seed', range(20))
def test_plane_frame_is_where_it_is_said_to_be(seed):
    rng = np.random.default_rng(100 + seed)
    chain, held = random_chain(rng, 4)
    sub = planar_subchain(chain, held_positions=held)
    # At any position of the joints before, the frame in the parent link maps the planar tip on
    # the spatial one, up to the displacement along the normal.
    positions = {'pan': rng.uniform(-3.0, 3.0), 'wrist': held.get('wrist', 0.0), **held}
    values = rng.uniform(-3.0, 3.0, 4)
    positions.update(zip(sub.joint_names, values))
    _, points, tip, links = spatial_kinematics(chain, positions)
    first = chain[[member.name for member in chain].index('axis_0')]
    parent = links['axis_0'] @ np.linalg.inv(first.origin)
    in_plane = np.linalg.inv(parent @ sub.plane_frame_in_parent) @ [*tip, 1.0]
    theta = np.array(sub.joint_directions) * values + sub.joint_offsets
    expected = sub.arm().operation_point_vectors(theta)[0]
    np.testing.assert_allclose(in_plane[0] + 1j * in_plane[1], expected, atol=1e-9)
    np.testing.assert_allclose(sub.plane_frame[:3, 3], spatial_kinematics(
        chain, held)[1]['axis_0'], atol=1e-12)
    assert sub.joint_offsets[0] == pytest.approx(0.0, abs=1e-12)


def test_hand_made_arm():
    # A quarter turn to the left at joint 2, joint 3 mounted upside down, tip 0.5 m to its side.
    chain = [joint('a', xyz=(0.0, 0.0, 7.0), lower=-1.0, upper=2.0),
             joint('b', xyz=(2.0, 0.0, 0.3)),
             joint('c', axis=(0.0, 0.0, -4.0), xyz=(0.0, 1.0, -5.0), kind='continuous'),
             joint('tip', kind='fixed', xyz=(-0.5, 0.0, 9.0))]
    sub = planar_subchain(chain)
    assert sub.joint_names == ('a', 'b', 'c')
    assert sub.link_lengths == pytest.approx((2.0, 1.0, 0.5))
    assert sub.joint_offsets == pytest.approx((0.0, math.pi / 2, math.pi / 2))
    assert sub.joint_directions == (1, 1, -1)
    assert sub.joint_lower == (-1.0, -math.inf, -math.inf)
    assert sub.joint_upper == (2.0, math.inf, math.inf)
    assert sub.held_positions == {} and sub.tip_movers == ()


def test_tool_offset_counts_in_the_tip_frame():
    chain = planar_chain()
    chain[-1] = ChainJoint('tip', 'fixed', pose((1.0, 0.0, 0.0), Rotation.from_euler('z', 90,
                                                                                    degrees=True)))
    sub = planar_subchain(chain, tool_offset=[2.0, 0.0, 5.0])
    assert sub.link_lengths[-1] == pytest.approx(math.sqrt(5.0))
    assert sub.joint_offsets[-1] == pytest.approx(math.atan2(2.0, 1.0))


def test_given_joint_names_restrict_the_arm():
    chain = planar_chain(5)
    sub = planar_subchain(chain, joint_names=['j2', 'j3', 'j4'])
    assert sub.joint_names == ('j2', 'j3', 'j4')
    assert sub.link_lengths == pytest.approx((1.0, 1.0, 2.0))
    assert sub.held_positions == {'j1': 0.0, 'j5': 0.0}
    # The fifth joint does move the tip in the plane, and the result says so.
    assert sub.tip_movers == ('j5',)


def test_joints_behind_the_run_are_reported_only_if_they_move_the_tip():
    chain = planar_chain()
    chain.insert(3, joint('roll', axis=(1.0, 0.0, 0.0), xyz=(1.0, 0.0, 0.0)))
    assert planar_subchain(chain).tip_movers == ()
    chain.insert(4, joint('pitch', axis=(0.0, 1.0, 0.0), xyz=(0.0, 0.0, 0.0)))
    assert planar_subchain(chain).tip_movers == ('pitch',)
    chain.insert(5, joint('lift', axis=(0.0, 0.0, 1.0), kind='prismatic', xyz=(0.0, 0.0, 0.0)))
    chain.insert(6, joint('push', axis=(1.0, 0.0, 1.0), kind='prismatic', xyz=(0.0, 0.0, 0.0)))
    sub = planar_subchain(chain)
    assert sub.tip_movers == ('pitch', 'push')
    assert sub.held_positions == dict.fromkeys(('roll', 'pitch', 'lift', 'push'), 0.0)


def test_axes_within_the_tolerance_count_as_parallel():
    def chain(angle):
        tilted = joint('j2', axis=(0.0, math.sin(angle), math.cos(angle)))
        return [joint('j1'), tilted, joint('j3'), joint('tip', kind='fixed')]

    sub = planar_subchain(chain(0.99 * PARALLEL_TOLERANCE))
    # The tolerance costs no more than its cosine.
    assert sub.link_lengths == pytest.approx((1.0, 1.0, 1.0), rel=2e-4)
    with pytest.raises(ValueError, match="'j2' at 0.0202 rad"):
        planar_subchain(chain(1.01 * PARALLEL_TOLERANCE))


def with_joint_between(**kinds):
    chain = planar_chain()
    chain.insert(2, joint('odd', xyz=(0.2, 0.0, 0.0), **kinds))
    return chain


NAMES = ['j1', 'j2', 'j3']
TILTED = (0.0, 1.0, 1.0)


@pytest.mark.parametrize('chain, arguments, words', [
    (planar_chain(2), {}, ['no 3 successive parallel axes', "'j2' at 0 rad"]),
    ([joint('tip', kind='fixed')], {}, ['no movable joint']),
    ([], {}, ['no movable joint']),
    (with_joint_between(axis=TILTED), {}, ["revolute 'odd' at 0.7854 rad (45 degrees)"]),
    (with_joint_between(axis=TILTED), {'joint_names': NAMES},
     ["revolute joint 'odd'", '0.7854 rad (45 degrees)', "'j1'", 'hold']),
    (with_joint_between(), {'joint_names': NAMES}, ["'odd'", '0 rad', 'hold']),
    (with_joint_between(axis=(1, 0, 0), kind='prismatic'), {}, ["prismatic 'odd' at 1.571 rad"]),
    (with_joint_between(axis=(1, 0, 0), kind='prismatic'), {'joint_names': NAMES},
     ["prismatic joint 'odd'", '90 degrees']),
    (with_joint_between(mimics='j1'), {}, ["'odd' mimics 'j1'", 'hold']),
    (with_joint_between(axis=TILTED), {'joint_names': ['j1', 'odd', 'j3']},
     ["axis of joint 'odd'", '0.7854 rad', "'j1'"]),
    (with_joint_between(kind='prismatic'), {'joint_names': ['j1', 'odd', 'j3']},
     ["'odd' is prismatic"]),
    (with_joint_between(kind='floating'), {}, ["'odd' is floating"]),
    (with_joint_between(), {'joint_names': ['j1', 'odd', 'j2'],
                            'held_positions': {'odd': 0.1}}, ['order']),
    (with_joint_between(), {'joint_names': ['j1', 'odd', 'j3'],
                            'held_positions': {'odd': 0.1, 'j2': 0.0}}, ["'odd' is held"]),
    (planar_chain(), {'joint_names': ['j1', 'j2', 'j9']}, ["no joint 'j9'"]),
    (planar_chain(), {'joint_names': ['j1', 'j2', 'j2']}, ['different']),
    (planar_chain(), {'joint_names': ['j1', 'j2']}, ['at least 3']),
    (planar_chain(), {'joint_names': ['j2', 'j1', 'j3']}, ['order', 'j1, j2, j3']),
    (planar_chain(), {'held_positions': {'j9': 0.0}}, ["'j9'"]),
    (planar_chain(), {'held_positions': {'tip': 0.0}}, ["'tip'"]),
    (planar_chain(), {'held_positions': {'j1': math.nan}}, ["'j1'", 'finite']),
    (planar_chain(), {'held_positions': {'j1': 'up'}}, ["'j1'", 'real numbers']),
    ([joint('j0', lower=-1.0, upper=1.0), *planar_chain()], {'held_positions': {'j0': 2.0}},
     ["'j0' = 2.0", '-1.0 .. 1.0']),
    (planar_chain(), {'tool_offset': [0.0, 1.0]}, ['tool_offset', '(2,)']),
    (planar_chain(), {'tool_offset': [0.0, 1.0, math.inf]}, ['tool_offset', 'finite']),
    (planar_chain(), {'tool_offset': [0.0, 1.0, 2 * FARTHEST]}, ['tool_offset', '1e+06']),
    (planar_chain(), {'tool_offset': [-1.0, 0.0, 1.0]}, ["axis of joint 'j3'", 'tool_offset']),
    ([joint('j1'), joint('j2', xyz=(0.0, 0.0, 3.0)), joint('j3'), joint('j4')], {},
     ["'j1' and 'j2' have the same axis"]),
    ([*planar_chain(), joint('k1', axis=(0, 1, 0)), joint('k2', axis=(0, 1, 0), xyz=(0, 0, 1)),
      joint('k3', axis=(0, 1, 0), xyz=(0, 0, 1))], {}, ['several runs', 'k1, k2, k3']),
    ([*planar_chain(), joint('stiff', axis=(1, 0, 0), lower=0.5, upper=1.0)], {},
     ["'stiff'", 'cannot be at 0']),
    ([joint('j1', axis=(0, 0, 0))], {}, ["axis of joint 'j1' is zero"]),
    ([joint('j1', axis=(0, 0, math.nan))], {}, ["axis of joint 'j1'", 'finite']),
    ([joint('j1', xyz=(0, math.nan, 0))], {}, ["origin of joint 'j1'", 'finite']),
    ([joint('j1', xyz=(0, 1e300, 0))], {}, ["'j1'", 'must be within 1e+06 m']),
    ([joint('j1', lower=1.0, upper=-1.0)], {}, ["'j1'", 'lower <= upper']),
    ([joint('j1', lower=math.nan)], {}, ["'j1'", 'lower <= upper']),
    ([joint('j1'), joint('j1')], {}, ['different names']),
    ([ChainJoint('j1', 'fixed', np.eye(3))], {}, ["origin of joint 'j1'", '(3, 3)']),
    ([ChainJoint('j1', 'fixed', np.diag([1.0, 1.0, -1.0, 1.0]))], {}, ['rigid']),
    ([ChainJoint('j1', 'fixed', 2.0 * np.eye(4))], {}, ['rigid']),
])
def test_refusals_say_what_is_wrong(chain, arguments, words):
    with pytest.raises(ValueError) as refusal:
        planar_subchain(chain, **arguments)
    for word in words:
        assert word in str(refusal.value)


def test_held_joint_joins_what_it_interrupted():
    chain = with_joint_between(axis=(0.0, 0.0, 1.0))
    sub = planar_subchain(chain, held_positions={'odd': math.pi / 2})
    # j2 - odd: 0.2 along x, then the odd joint turns what follows to the left.
    assert sub.joint_names == ('j1', 'j2', 'j3')
    assert sub.link_lengths == pytest.approx((1.0, math.hypot(0.2, 1.0), 1.0))
    assert sub.held_positions == {'odd': math.pi / 2}


def test_scale_does_not_matter():
    for scale in (1e-9, 1e3):
        chain = [ChainJoint(item.name, item.joint_type, pose(scale * item.origin[:3, 3]),
                            item.axis) for item in planar_chain()]
        assert planar_subchain(chain).link_lengths == pytest.approx((scale,) * 3, rel=1e-12)
