"""
The planar part of a spatial serial chain: revolute joints with parallel axes, projected.

A chain is a sequence of joints from the base to the tip. The rigid parts between parallel axes
are projected on a plane normal to them, which leaves a planar arm: displacements along the axes
are dropped, because no joint of the planar arm changes them. Nothing here reads a file.
"""

from dataclasses import dataclass
import math

import numpy as np

from kinopt_ros.kinetostatics.planar_arm import MIN_JOINTS, PlanarArm

# Two axes count as parallel up to this angle in rad (1.15 degrees). Calibrated descriptions
# tilt nominally parallel axes by some mrad; a link tilted by the full tolerance is 0.02 % short.
PARALLEL_TOLERANCE = 0.02

# A projected link counts as having no length below this fraction of the longest one.
ZERO_LENGTH_TOLERANCE = 1e-6

# Distance in m from the base link beyond which a chain is refused: a mistaken unit, and the
# digits of its links would be lost.
FARTHEST = 1e6

# How far an origin may be from a rigid displacement, element by element of R R^T and det R.
RIGID_TOLERANCE = 1e-6

TURNING = ('revolute', 'continuous')
MOVABLE = (*TURNING, 'prismatic')
JOINT_TYPES = (*MOVABLE, 'fixed')


@dataclass(frozen=True, eq=False)
class ChainJoint:
    """
    One joint of a serial chain, in URDF's conventions.

    Attributes
    ----------
    name : str
    joint_type : str
        'revolute', 'continuous', 'prismatic' or 'fixed'.
    origin : array, shape (4, 4)
        Pose of the joint frame in the frame of the link before it, at position zero (m).
    axis : array, shape (3,)
        Axis in the joint frame, of any length but zero; not used when fixed.
    lower, upper : float
        Position limits in rad or m; infinite where there are none.
    mimics : str or None
        The joint that this one follows, if it does.
    parent_link : str
        The link before the joint.
    """

    name: str
    joint_type: str
    origin: np.ndarray
    axis: np.ndarray = (1.0, 0.0, 0.0)
    lower: float = -math.inf
    upper: float = math.inf
    mimics: str | None = None
    parent_link: str = ''

    def motion(self, position):
        """Displacement (4 x 4) of the link after the joint, in the joint frame."""
        displacement = np.eye(4)
        if self.joint_type == 'prismatic':
            displacement[:3, 3] = position * unit(self.axis)
        elif self.joint_type in TURNING:
            displacement[:3, :3] = rotation(unit(self.axis), position)
        return displacement


@dataclass(frozen=True, eq=False)
class PlanarSubchain:
    """
    The planar arm found in a chain, and how to read its angles from joint positions.

    With q_i the position of joint i, theta_i = joint_directions[i] q_i + joint_offsets[i] are
    the relative joint angles of `arm()`, in the plane frame.

    The plane frame has its z axis along the first joint's axis, averaged with the others where
    they differ within the tolerance, its origin at the first joint, and its x axis along the
    first link at position zero; hence joint_offsets[0] = 0.

    Attributes
    ----------
    joint_names : tuple of str
        Base to tip.
    link_lengths : tuple of float
        m.
    joint_offsets : tuple of float
        rad, in [-pi, pi].
    joint_directions : tuple of int
        +1 or -1.
    joint_lower, joint_upper : tuple of float
        Limits of the positions q_i in rad, not of the angles theta_i; infinite where none.
    plane_frame : array, shape (4, 4)
        Pose of the plane frame in the base link, movable joints before the first one being at
        their held position, zero by default.
    parent_link : str
        The link that carries the first joint.
    plane_frame_in_parent : array, shape (4, 4)
        Pose of the plane frame in `parent_link`, whatever the joints before do.
    held_positions : dict of str to float
        Position assumed of each movable joint that is not in the planar arm.
    tip_movers : tuple of str
        The joints behind the last axis that are not held and of which each would move the
        operation point if it left zero: the index takes no account of them.
    """

    joint_names: tuple
    link_lengths: tuple
    joint_offsets: tuple
    joint_directions: tuple
    joint_lower: tuple
    joint_upper: tuple
    plane_frame: np.ndarray
    parent_link: str
    plane_frame_in_parent: np.ndarray
    held_positions: dict
    tip_movers: tuple

    def arm(self):
        """Give the arm as a PlanarArm."""
        return PlanarArm(self.link_lengths)


@dataclass(frozen=True, eq=False)
class _PlacedJoint:
    """A joint with its place in the base link when all joints are at the position assumed."""

    joint: ChainJoint
    held: bool
    frame: np.ndarray

    @property
    def name(self):
        return self.joint.name

    @property
    def point(self):
        return self.frame[:3, 3]

    @property
    def axis(self):
        return self.frame[:3, :3] @ unit(self.joint.axis)

    @property
    def free(self):
        return self.joint.joint_type != 'fixed' and not self.held

    @property
    def turns(self):
        return self.free and self.joint.joint_type in TURNING and self.joint.mimics is None


def planar_subchain(chain, joint_names=None, tool_offset=None, held_positions=None):
    """
    Planar arm in a spatial serial chain.

    Without `joint_names` it is the longest run of revolute or continuous joints with parallel
    axes. Fixed and held joints within a run are rigid. So is a prismatic joint that slides along
    the common normal, since it moves nothing in the plane; any other movable joint ends the run.

    The operation point is the tip's origin, or the `tool_offset` in the tip's frame. Joints
    behind the last axis that are not held are taken at zero; those that would move the operation
    point are listed in the result's `tip_movers`.

    Parameters
    ----------
    chain : sequence of ChainJoint
        All joints from the base link to the tip link; the tip's frame is the frame of the link
        behind the last joint.
    joint_names : sequence of str, optional
        Exactly the joints of the planar arm, base to tip.
    tool_offset : array-like, shape (3,), optional
        Operation point in the tip's frame, m.
    held_positions : dict of str to float, optional
        Positions (rad or m) of joints that are to count as rigid.

    Returns
    -------
    subchain : PlanarSubchain

    Raises
    ------
    ValueError
        If there are not three parallel axes, or two runs equally long; if a joint between the
        given ones, or a mimic joint anywhere, is neither fixed nor held; if a projected link has
        no length; if an argument does not fit the chain.
    """
    held = _checked_held_positions(held_positions, chain)
    placed, tip = _placed(chain, held)
    if joint_names is None:
        run = _longest_run(placed)
    else:
        run = _named_run(placed, joint_names)
    normal = _common_normal(run)
    points = np.array([member.point for member in run] + [_tool_point(tip, tool_offset)])
    return _projected(placed, run, normal, points, held)


def _projected(placed, run, normal, points, held):
    """Project the points on the plane and put the result together."""
    links = np.diff(points, axis=0)
    links -= np.outer(links @ normal, normal)
    lengths = np.linalg.norm(links, axis=1)
    _check_lengths(run, lengths)
    first = links[0] / lengths[0]
    second = np.cross(normal, first)
    angles = np.arctan2(links @ second, links @ first)
    offsets = np.angle(np.exp(1j * np.diff(angles, prepend=0.0)))
    plane = np.eye(4)
    plane[:3] = np.column_stack([first, second, normal, run[0].point])
    # Through the joint's own frame: the pose in its parent does not know of the joints before.
    in_joint = np.linalg.inv(run[0].frame) @ plane
    members = [member.joint for member in run]
    behind = [item for item in placed[placed.index(run[-1]) + 1:] if item.free]
    _check_assumed(behind)
    return PlanarSubchain(
        joint_names=tuple(joint.name for joint in members),
        link_lengths=tuple(lengths.tolist()),
        joint_offsets=tuple(offsets.tolist()),
        joint_directions=tuple(1 if member.axis @ normal > 0.0 else -1 for member in run),
        joint_lower=tuple(float(joint.lower) for joint in members),
        joint_upper=tuple(float(joint.upper) for joint in members),
        plane_frame=plane,
        parent_link=members[0].parent_link,
        plane_frame_in_parent=members[0].origin @ in_joint,
        held_positions={item.name: held.get(item.name, 0.0) for item in placed
                        if item.joint.joint_type != 'fixed' and item not in run},
        tip_movers=_tip_movers(behind, points[-1], normal, lengths.max()))


def _tip_movers(behind, tip_point, normal, longest):
    """Names of the joints behind the run that displace the operation point in the plane."""
    movers = []
    for item in behind:
        if item.joint.joint_type == 'prismatic':
            moves = not parallel(item.axis, normal)
        else:
            # A point off the axis moves on a circle, and no plane sees a circle as a point.
            radius = np.linalg.norm(np.cross(item.axis, tip_point - item.point))
            moves = radius > ZERO_LENGTH_TOLERANCE * longest
        if moves:
            movers.append(item.name)
    return tuple(movers)


def _check_assumed(behind):
    """See that joints can be at the position zero assumed of them."""
    for item in behind:
        if not item.joint.lower <= 0.0 <= item.joint.upper:
            raise ValueError(
                f"joint '{item.name}' behind the planar arm cannot be at 0, its limits are "
                f'{item.joint.lower} .. {item.joint.upper}: hold it with held_positions')


def _check_lengths(run, lengths):
    limit = ZERO_LENGTH_TOLERANCE * lengths.max()
    for i, length in enumerate(lengths):
        if length > limit:
            continue
        if i + 1 < len(run):
            raise ValueError(f"joints '{run[i].name}' and '{run[i + 1].name}' have the same "
                             'axis: the projected link between them has no length')
        raise ValueError(f"the operation point lies on the axis of joint '{run[i].name}': the "
                         'last projected link has no length; give a tool_offset or another '
                         'tip link')


def _longest_run(placed):
    """Find the longest run of parallel axes."""
    _refuse_mimics(placed)
    runs = [[]]
    for item in placed:
        if not item.free or _slides_along_normal(item, runs[-1]):
            continue
        if not item.turns:
            runs.append([])
        elif runs[-1] and not parallel(item.axis, runs[-1][0].axis):
            runs.append([item])
        else:
            runs[-1].append(item)
    longest = max(runs, key=len)
    if len(longest) < MIN_JOINTS:
        raise ValueError(
            f'the chain has no {MIN_JOINTS} successive parallel axes of revolute or continuous '
            f'joints (tolerance {PARALLEL_TOLERANCE} rad): {_account(placed)}')
    equals = [run for run in runs if len(run) == len(longest)]
    if len(equals) > 1:
        texts = _listed(f'({_listed(item.name for item in run)})' for run in equals)
        raise ValueError(f'the chain has several runs of {len(longest)} parallel axes, {texts}: '
                         'choose one with joint_names')
    return longest


def _named_run(placed, joint_names):
    """Find exactly the joints asked for, and see that everything between them is rigid."""
    _refuse_mimics(placed)
    names = _checked_names(joint_names, placed)
    members = [item for item in placed if item.name in names]
    if tuple(item.name for item in members) != names:
        raise ValueError(f'joint_names = {list(names)}: must be in the order of the chain, base '
                         f'to tip: {_listed(item.name for item in members)}')
    for item in members:
        _check_member(item, members)
    first, last = placed.index(members[0]), placed.index(members[-1])
    for item in placed[first:last]:
        if item.free and item not in members and not _slides_along_normal(item, members):
            raise ValueError(
                f"{item.joint.joint_type} joint '{item.name}' lies between joints of the planar "
                f'arm, its axis at {angle_text(item.axis, members[0].axis)} to that of '
                f"'{members[0].name}': hold it with held_positions")
    return members


def _check_member(item, members):
    if not item.turns:
        state = 'held' if item.held else item.joint.joint_type
        raise ValueError(f"joint_names: joint '{item.name}' is {state}, must be a revolute or "
                         'continuous joint that is not held')
    if not parallel(item.axis, members[0].axis):
        raise ValueError(
            f"joint_names: the axis of joint '{item.name}' is at "
            f"{angle_text(item.axis, members[0].axis)} to that of '{members[0].name}', must be "
            f'parallel within {PARALLEL_TOLERANCE} rad')


def _refuse_mimics(placed):
    for item in placed:
        if item.free and item.joint.mimics is not None:
            raise ValueError(f"joint '{item.name}' mimics '{item.joint.mimics}' and does not move "
                             'on its own: hold it with held_positions')


def _slides_along_normal(item, run):
    return bool(run) and item.joint.joint_type == 'prismatic' and parallel(
        item.axis, run[0].axis)


def _account(placed):
    """Say of each movable joint why it does or does not continue the joint before it."""
    movable = [item for item in placed if item.joint.joint_type != 'fixed']
    if not movable:
        return 'it has no movable joint'
    texts = []
    before = None
    for item in movable:
        text = f"{item.joint.joint_type} '{item.name}'"
        if item.held:
            text += ' held'
        elif before is not None:
            text += f" at {angle_text(item.axis, before.axis)} to '{before.name}'"
        texts.append(text)
        before = before if item.held else item
    return _listed(texts)


def _common_normal(run):
    """Mean of the axes, all turned to the first one's side."""
    first = run[0].axis
    return unit(sum(math.copysign(1.0, member.axis @ first) * member.axis for member in run))


def _tool_point(tip, tool_offset):
    if tool_offset is None:
        return tip[:3, 3]
    offset = _numbers('tool_offset', tool_offset, (3,))
    _check_near(offset, 'tool_offset')
    return tip[:3, :3] @ offset + tip[:3, 3]


def _placed(chain, held):
    """Poses of all joints in the base link, and the pose of the tip."""
    pose = np.eye(4)
    placed = []
    for joint in chain:
        _check_joint(joint)
        frame = pose @ joint.origin
        pose = frame @ joint.motion(held.get(joint.name, 0.0))
        _check_near(pose[:3, 3], f"the frame behind joint '{joint.name}'")
        placed.append(_PlacedJoint(joint, joint.name in held, frame))
    return placed, pose


def _check_near(point, what):
    if np.max(np.abs(point)) > FARTHEST:
        raise ValueError(f'{what} at {point.tolist()} m: must be within {FARTHEST:g} m')


def _check_joint(joint):
    if joint.joint_type not in JOINT_TYPES:
        raise ValueError(f"joint '{joint.name}' is {joint.joint_type}: the joints of the chain "
                         f"must be {', '.join(JOINT_TYPES)}")
    origin = _numbers(f"origin of joint '{joint.name}'", joint.origin, (4, 4))
    turn = origin[:3, :3]
    rigid = (np.allclose(turn @ turn.T, np.eye(3), rtol=0.0, atol=RIGID_TOLERANCE)
             and np.linalg.det(turn) > 0.0 and np.array_equal(origin[3], (0.0, 0.0, 0.0, 1.0)))
    if not rigid:
        raise ValueError(f"origin of joint '{joint.name}': must be a rigid displacement")
    if joint.joint_type == 'fixed':
        return
    axis = _numbers(f"axis of joint '{joint.name}'", joint.axis, (3,))
    if not axis.any():
        raise ValueError(f"axis of joint '{joint.name}' is zero: must have a direction")
    # Written so that NaN is refused as well.
    if not joint.lower <= joint.upper:
        raise ValueError(f"joint '{joint.name}' has limits {joint.lower} .. {joint.upper}: must "
                         'be lower <= upper')


def _checked_held_positions(held_positions, chain):
    held = {}
    names = [joint.name for joint in chain]
    if len(set(names)) != len(names):
        raise ValueError(f'chain: its joints must have different names, got {_listed(names)}')
    movable = {joint.name: joint for joint in chain if joint.joint_type in MOVABLE}
    for name, value in (held_positions or {}).items():
        if name not in movable:
            raise ValueError(f"held_positions names '{name}': must be one of the movable joints "
                             f'of the chain: {_listed(movable)}')
        position = float(_numbers(f"held_positions of '{name}'", value, ()))
        joint = movable[name]
        if not joint.lower <= position <= joint.upper:
            raise ValueError(f"held_positions of '{name}' = {position}: must be within the "
                             f'limits {joint.lower} .. {joint.upper}')
        held[name] = position
    return held


def _checked_names(joint_names, placed):
    names = tuple(joint_names)
    known = [item.name for item in placed]
    for name in names:
        if name not in known:
            raise ValueError(f"joint_names: no joint '{name}' in the chain, must be of: "
                             f'{_listed(known)}')
    if len(set(names)) != len(names) or len(names) < MIN_JOINTS:
        raise ValueError(f'joint_names = {list(names)}: must be at least {MIN_JOINTS} different '
                         'joints')
    return names


def _numbers(what, value, shape):
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError(f'{what}: must be real numbers') from error
    if numbers.shape != shape:
        raise ValueError(f'{what} has shape {numbers.shape}: must be {shape}')
    if not np.isfinite(numbers).all():
        raise ValueError(f'{what} = {numbers.tolist()}: must be finite')
    return numbers


def _listed(texts, most=20):
    """Join texts for a message, however many there are."""
    texts = list(texts)
    return ', '.join(texts[:most]) + (', ...' if len(texts) > most else '')


def parallel(axis, other):
    """Tell whether two unit vectors are parallel or opposite within PARALLEL_TOLERANCE."""
    return line_angle(axis, other) <= PARALLEL_TOLERANCE


def line_angle(axis, other):
    """Angle in rad, 0 .. pi/2, between the lines along two unit vectors."""
    return math.atan2(np.linalg.norm(np.cross(axis, other)), abs(axis @ other))


def angle_text(axis, other):
    """Angle between two axes for a message."""
    angle = line_angle(axis, other)
    return f'{angle:.4g} rad ({math.degrees(angle):.4g} degrees)'


def unit(vector):
    """Vector of length one; no length is too large or too small for it."""
    vector = np.asarray(vector, dtype=float)
    vector = vector / np.max(np.abs(vector))
    return vector / np.linalg.norm(vector)


def rotation(axis, angle):
    """Rotation matrix about a unit vector (Rodrigues' formula)."""
    x, y, z = axis
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * across + (1.0 - math.cos(angle)) * across @ across
