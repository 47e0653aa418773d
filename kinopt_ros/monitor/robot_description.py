"""
From a robot description (URDF) to the planar arm in it.

The description arrives over a topic, so anything may be in it. It is read once with expat, under
limits and without entities, and reduced to the links, the joints and what places them; only
this reaches the URDF parser. Meshes, inertias, materials and extensions are never looked at.
"""

import math
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np

from kinopt_ros.kinetostatics.planar_subchain import ChainJoint, planar_subchain, rotation

# A large humanoid's description has some 0.3 million characters and a few hundred joints.
MAX_CHARACTERS = 4_000_000
MAX_DEPTH = 100
MAX_LINKS_AND_JOINTS = 10_000
MAX_VALUE_CHARACTERS = 1_000

# What is read of a joint, and of which attributes; the rest is left out.
_ATTRIBUTES = {
    'origin': ('xyz', 'rpy'),
    'axis': ('xyz',),
    'parent': ('link',),
    'child': ('link',),
    'limit': ('lower', 'upper', 'effort', 'velocity'),
    'mimic': ('joint', 'multiplier', 'offset'),
}
_REQUIRED_ATTRIBUTE = {'axis': 'xyz', 'parent': 'link', 'child': 'link', 'mimic': 'joint'}

INSTALL_HINT = ('reading a robot description needs the package urdf_parser_py: '
                'apt install ros-jazzy-urdfdom-py, or pip install urdf-parser-py')


def planar_subchain_of(description, base_link, tip_link, joint_names=None, tool_offset=None,
                       held_positions=None):
    """
    Planar arm between two links of a robot description.

    Parameters
    ----------
    description : str
        URDF document.
    base_link, tip_link : str
        Links before and behind all joints considered.
    joint_names : sequence of str, optional
        Exactly the joints of the planar arm; by default the longest run of parallel axes.
    tool_offset : array-like, shape (3,), optional
        Operation point in the tip link's frame, m; by default that frame's origin.
    held_positions : dict of str to float, optional
        Positions (rad or m) of joints that are to count as rigid.

    Returns
    -------
    subchain : PlanarSubchain

    Raises
    ------
    ValueError
        If the description cannot be read, the links are not in it or not on one branch, or the
        chain between them holds no planar arm (see `planar_subchain`).
    ImportError
        If the URDF parser is not installed.
    """
    chain = chain_of(description, base_link, tip_link)
    return planar_subchain(chain, joint_names, tool_offset, held_positions)


def chain_of(description, base_link, tip_link):
    """
    Joints from one link of a robot description down to another.

    Parameters
    ----------
    description : str
        URDF document.
    base_link, tip_link : str

    Returns
    -------
    chain : list of ChainJoint

    Raises
    ------
    ValueError
        If the description cannot be read, or the links are not in it or not on one branch.
    ImportError
        If the URDF parser is not installed.
    """
    links, joints = _parsed(description)
    joint_to = _joints_by_child(links, joints)
    for argument, link in (('base_link', base_link), ('tip_link', tip_link)):
        if link not in links:
            raise ValueError(f'{argument} = {link!r}: the robot description has no such link')
    return [_chain_joint(joint) for joint in _path(joint_to, base_link, tip_link)]


def _parsed(description):
    """Links (a set of names) and joints (urdf_parser_py objects) of a description."""
    try:
        from urdf_parser_py.urdf import Robot
    except ImportError as error:
        raise ImportError(f'{INSTALL_HINT} ({error})') from error
    reduced = ElementTree.tostring(_reduced_tree(description), encoding='unicode')
    try:
        robot = Robot.from_xml_string(reduced)
    # The parser raises bare Exceptions and AssertionErrors, among others.
    except Exception as error:
        raise ValueError(f'robot description: {_shortened(error)}') from error
    return {link.name for link in robot.links}, robot.joints


class _Reducer:
    """
    Handlers for expat that keep what places links and joints, and refuse what is hostile.

    Attributes
    ----------
    root : xml.etree.ElementTree.Element or None
    """

    def __init__(self):
        self.root = None
        self._depth = 0
        self._joint = None
        self._names = {'link': set(), 'joint': set()}

    def start(self, tag, attributes):
        """Take an element in."""
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise ValueError(f'robot description: elements nested more than {MAX_DEPTH} deep')
        if tag.startswith('xacro:'):
            raise ValueError(f'robot description: holds <{tag}>; run it through xacro first')
        if self._depth == 1:
            self._start_root(tag, attributes)
        elif self._depth == 2:
            self._joint = None
            if tag in self._names:
                self._start_part(tag, attributes)
        elif self._depth == 3 and self._joint is not None and tag in _ATTRIBUTES:
            self._start_joint_child(tag, attributes)

    def end(self, tag):
        """Leave an element."""
        self._depth -= 1

    def refuse_doctype(self, *_):
        """Refuse a document type, without which there are no entities to expand."""
        raise ValueError('robot description: document types and entities are not accepted')

    def _start_root(self, tag, attributes):
        if tag != 'robot':
            raise ValueError(f'robot description: the root element is <{_shortened(tag)}>, must '
                             'be <robot>')
        # Its name is of no importance here, but the parser insists.
        self.root = ElementTree.Element('robot', {'name': '', **_only(attributes, ('version',))})

    def _start_part(self, tag, attributes):
        if len(self.root) >= MAX_LINKS_AND_JOINTS:
            raise ValueError(f'robot description: more than {MAX_LINKS_AND_JOINTS} links and '
                             'joints')
        if not attributes.get('name'):
            raise ValueError(f'robot description: a <{tag}> has no name')
        kept = _only(attributes, ('name', 'type') if tag == 'joint' else ('name',))
        if kept['name'] in self._names[tag]:
            raise ValueError(f"robot description: two {tag}s are named '{kept['name']}'")
        self._names[tag].add(kept['name'])
        element = ElementTree.SubElement(self.root, tag, kept)
        if tag == 'joint':
            self._joint = element

    def _start_joint_child(self, tag, attributes):
        name = self._joint.get('name')
        if self._joint.find(tag) is not None:
            raise ValueError(f"robot description: joint '{name}' has more than one <{tag}>")
        unknown = set(attributes).difference(_ATTRIBUTES[tag])
        # A rotation written in another way than rpy must not pass for no rotation.
        if tag == 'origin' and unknown:
            raise ValueError(f"robot description: the <origin> of joint '{name}' has the "
                             f'attribute {_shortened(min(unknown))}, must have only xyz and rpy')
        if _REQUIRED_ATTRIBUTE.get(tag, tag) not in (tag, *attributes):
            raise ValueError(f"robot description: the <{tag}> of joint '{name}' has no "
                             f'attribute {_REQUIRED_ATTRIBUTE[tag]}')
        ElementTree.SubElement(self._joint, tag, _only(attributes, _ATTRIBUTES[tag]))


def _reduced_tree(description):
    """Tree of the links and joints of a description."""
    if not isinstance(description, str) or not description.strip():
        raise ValueError('robot description: must be a URDF document, got no text')
    if len(description) > MAX_CHARACTERS:
        raise ValueError(f'robot description: {len(description)} characters, must be at most '
                         f'{MAX_CHARACTERS}')
    reducer = _Reducer()
    parser = expat.ParserCreate()
    parser.StartElementHandler = reducer.start
    parser.EndElementHandler = reducer.end
    parser.StartDoctypeDeclHandler = reducer.refuse_doctype
    try:
        parser.Parse(description, True)
    except (expat.ExpatError, UnicodeEncodeError) as error:
        raise ValueError(f'robot description: not well-formed XML: {_shortened(error)}') from error
    return reducer.root


def _joints_by_child(links, joints):
    """Map each link to the joint that carries it, having checked that the joints form trees."""
    joint_to = {}
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in links:
                raise ValueError(f"robot description: joint '{joint.name}' refers to the link "
                                 f"'{link}', which is not defined")
        if joint.child in joint_to:
            raise ValueError(
                f"robot description: link '{joint.child}' has two parents, by the joints "
                f"'{joint_to[joint.child].name}' and '{joint.name}'")
        joint_to[joint.child] = joint
    return joint_to


def _path(joint_to, base_link, tip_link):
    """Joints from the base link to the tip link, found upwards from the tip."""
    path = []
    link = tip_link
    while link != base_link:
        if link not in joint_to:
            raise ValueError(f"tip_link = '{tip_link}' is not below base_link = '{base_link}': "
                             f"the way up ends at the link '{link}'")
        if len(path) == len(joint_to):
            raise ValueError(f"robot description: the joints above link '{tip_link}' form a loop")
        path.append(joint_to[link])
        link = joint_to[link].parent
    return path[::-1]


def _chain_joint(joint):
    """Translate a joint of urdf_parser_py; the chain's own checks look at the numbers."""
    origin = np.eye(4)
    if joint.origin is not None:
        origin[:3, :3] = _rotation_of_rpy(joint.name, joint.origin.rpy)
        origin[:3, 3] = joint.origin.xyz
    lower, upper = _limits(joint)
    return ChainJoint(
        name=joint.name, joint_type=joint.type, origin=origin,
        axis=np.array((1.0, 0.0, 0.0) if joint.axis is None else joint.axis),
        lower=lower, upper=upper, mimics=joint.mimic.joint if joint.mimic else None,
        parent_link=joint.parent)


def _limits(joint):
    if joint.type not in ('revolute', 'prismatic'):
        return -math.inf, math.inf
    if joint.limit is None:
        raise ValueError(f"robot description: {joint.type} joint '{joint.name}' has no "
                         '<limit>, which URDF asks for')
    return joint.limit.lower, joint.limit.upper


def _rotation_of_rpy(name, rpy):
    """Rotation matrix of fixed-axis roll, pitch and yaw in rad."""
    if not np.isfinite(rpy).all():
        raise ValueError(f"origin of joint '{name}': rpy = {rpy}: must be finite")
    roll, pitch, yaw = (rotation(axis, angle) for axis, angle in zip(np.eye(3), rpy))
    return yaw @ pitch @ roll


def _only(attributes, names):
    """Attributes of these names, none of which may be too long for a message."""
    kept = {name: attributes[name] for name in names if name in attributes}
    for name, value in kept.items():
        if len(value) > MAX_VALUE_CHARACTERS:
            raise ValueError(f"robot description: an attribute '{name}' has {len(value)} "
                             f'characters, must have at most {MAX_VALUE_CHARACTERS}')
    return kept


def _shortened(thing, length=200):
    """Text of something for a message, however long it is."""
    text = str(thing)
    return text if len(text) <= length else f'{text[:length]} ...'
