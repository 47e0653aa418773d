"""The node's parameters: their table, their declaration, and what happens when one is set."""

import math
from typing import NamedTuple

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException, ParameterException
from rclpy.parameter import Parameter

from kinopt_ros.monitor.configuration import Configuration


class ParameterRow(NamedTuple):
    """
    One parameter of the table.

    Attributes
    ----------
    name : str
    kind : rclpy.parameter.Parameter.Type
    default : value, or callable
        None where the user has to give one; a callable makes it from the number of joints and
        the node's name.
    description : str
    constraints : str
        The rule that values must keep, in words.
    span : (float, float) or None
        Closed range of a floating-point value.
    read_only : bool
    """

    name: str
    kind: Parameter.Type
    default: object
    description: str
    constraints: str
    span: tuple = None
    read_only: bool = False

    def descriptor(self):
        """Descriptor that `ros2 param describe` shows."""
        span = self.span and [FloatingPointRange(from_value=self.span[0], to_value=self.span[1])]
        return ParameterDescriptor(
            description=self.description, additional_constraints=self.constraints,
            read_only=self.read_only, floating_point_range=span or [])


_DOUBLE = Parameter.Type.DOUBLE
_DOUBLES = Parameter.Type.DOUBLE_ARRAY

ARM_TABLE = (
    ParameterRow(
        'joint_names', Parameter.Type.STRING_ARRAY, None,
        "Names of the arm's joints as in the JointState, base to tip.",
        'Required; at least 3, no duplicates; read-only.', read_only=True),
    ParameterRow(
        'link_lengths', _DOUBLES, None,
        'Link lengths in m, base to tip; the last ends at the operation point.',
        'Required; one per joint, finite and > 0 (1e-50 to 1e50).'),
    ParameterRow(
        'joint_offsets', _DOUBLES, lambda n, _: [0.0] * n,
        'Offsets in rad: theta_i = direction_i * position_i + offset_i.',
        'One per joint, within +-1e5.'),
    ParameterRow(
        'joint_directions', Parameter.Type.INTEGER_ARRAY, lambda n, _: [1] * n,
        'Directions: theta_i = direction_i * position_i + offset_i.',
        'One per joint, +1 or -1.'),
    ParameterRow(
        'joint_lower', _DOUBLES, lambda n, _: [-math.inf] * n,
        'Lower limits in rad of the measured positions.',
        'One per joint, not above joint_upper; -inf for a free joint.'),
    ParameterRow(
        'joint_upper', _DOUBLES, lambda n, _: [math.inf] * n,
        'Upper limits in rad of the measured positions.',
        'One per joint, not below joint_lower; inf for a free joint.'),
)

BEHAVIOUR_TABLE = (
    ParameterRow(
        'z_max', _DOUBLE, 0.9,
        'The flag rises when z exceeds this (the largest tolerable z). -1 stands for z_crit, the '
        'least z over the singular postures of the arm.',
        'Within 0..1, or -1 for at most 20 joints; (1 - z_max) (1 + hysteresis) below 1.',
        (-1.0, 1.0)),
    ParameterRow(
        'margin_min', _DOUBLE, 0.05,
        'The flag rises when the margin to singularity falls below this.',
        'Within 0..1; margin_min (1 + hysteresis) below 1.', (0.0, 1.0)),
    ParameterRow(
        'hysteresis', _DOUBLE, 0.1,
        'The flag clears at margin > margin_min (1 + hysteresis) together with '
        '1 - z > (1 - z_max) (1 + hysteresis).',
        'Within 0..100; see z_max and margin_min.', (0.0, 100.0)),
    ParameterRow(
        'min_dwell', _DOUBLE, 0.0,
        'Time in s since the last crossing before which a raised flag does not clear.',
        'Within 0..3600.', (0.0, 3600.0)),
    ParameterRow(
        'stale_timeout', _DOUBLE, 0.5,
        'Time in s without a complete, fresh posture after which it is stale; also the age in s '
        'beyond which the position of a joint no longer counts.',
        'Within 0.001..3600.', (0.001, 3600.0)),
    ParameterRow(
        'diagnostics_period', _DOUBLE, 1.0,
        'Period in s of the diagnostics while nothing changes; 0 for each cycle.',
        'Within 0..3600.', (0.0, 3600.0)),
    ParameterRow(
        'model_set', Parameter.Type.STRING, 'closest',
        "Isotropic set to compare with: the closest of all ('closest'), or a regular polygon "
        "('polygon').", 'closest or polygon.'),
    ParameterRow(
        'model_numbering', Parameter.Type.INTEGER_ARRAY, None,
        'Vertex of the polygon, counted counterclockwise from 0, for each joint.',
        'Each of 0 to n - 1 once; not set stands for 0, 1, ... n - 1.'),
    ParameterRow(
        'model_mirror', Parameter.Type.BOOL, False,
        'Whether the mirror image of the polygon may be used where it is closer.', 'A boolean.'),
    ParameterRow(
        'marker_rate', _DOUBLE, 10.0,
        'Most markers for RViz per second; none are made while nobody subscribes.',
        'Within 0.1..100.', (0.1, 100.0)),
    ParameterRow(
        'base_frame', Parameter.Type.STRING, '',
        'Frame of the markers, with the plane of the arm as its x-y plane. Empty stands for '
        'base_link, or the right place in the robot description where the arm comes from one.',
        'A frame id.'),
    ParameterRow(
        'hardware_id', Parameter.Type.STRING, lambda n, node_name: node_name,
        'Hardware id of the diagnostics.', 'Any text; read-only.', read_only=True),
)

MONITOR_TABLE = (*BEHAVIOUR_TABLE, *ARM_TABLE)

EXECUTOR = ParameterRow(
    'executor', Parameter.Type.STRING, 'events',
    "What calls the node back: rclpy's EventsExecutor ('events'), or its SingleThreadedExecutor "
    "('single'), which takes more of the processor.",
    'events or single; the other one where it cannot be had; read-only.', read_only=True)

CPU_AFFINITY = ParameterRow(
    'cpu_affinity', Parameter.Type.STRING, 'one',
    "Cores for the node's threads: 'one' keeps them together on the core where the system starts "
    "them, which takes less time and fewer wake-ups; 'all' leaves the choice to the system.",
    'one or all, of those that the process is given; read-only.', read_only=True)

# With base_link and tip_link the arm comes from a robot description; what is given explicitly
# in the parameters of the arm wins over what is derived.
DESCRIPTION_TABLE = (
    ParameterRow(
        'base_link', Parameter.Type.STRING, '',
        'First link of the chain in the robot description that holds the arm.',
        'A link; empty if the arm is given by joint_names and link_lengths; read-only.',
        read_only=True),
    ParameterRow(
        'tip_link', Parameter.Type.STRING, '',
        'Last link of that chain; its origin is the operation point.',
        'A link, given together with base_link; read-only.', read_only=True),
    ParameterRow(
        'robot_description', Parameter.Type.STRING, '',
        'Robot description (URDF). Empty: it is taken from the latched topic robot_description.',
        'URDF; read-only.', read_only=True),
    ParameterRow(
        'tool_offset', _DOUBLES, lambda *_: [0.0, 0.0, 0.0],
        'Operation point in the frame of tip_link, x, y, z in m.',
        'Three finite values; read-only.', read_only=True),
    ParameterRow(
        'held_joints', Parameter.Type.STRING_ARRAY, None,
        'Movable joints of the chain outside the planar arm that are held still.',
        'Joints of the description; read-only.', read_only=True),
    ParameterRow(
        'held_positions', _DOUBLES, None,
        'Positions at which they are held, rad or m.',
        'One per held joint; read-only.', read_only=True),
)


def declare(node, table, derived=None):
    """
    Declare the parameters of a table and return their values by name.

    Parameters
    ----------
    node : rclpy.node.Node
    table : sequence of ParameterRow
    derived : dict of str to value, optional
        Defaults that take the place of the table's.

    Raises
    ------
    ValueError
        If a value given at start has the wrong type or is out of its range: names the
        parameter, its value and the rule.
    """
    node_name = node.get_fully_qualified_name().lstrip('/')
    values = {}
    for row in table:
        n = len(values.get('joint_names') or ())
        default = (derived or {}).get(row.name, row.default)
        if callable(default):
            default = default(n, node_name)
        try:
            # An empty or missing default has no type of its own.
            parameter = node.declare_parameter(
                row.name, row.kind if default in (None, []) else default, row.descriptor())
        except ParameterException as error:
            raise ValueError(_rule_broken(error, row)) from error
        values[row.name] = parameter.value
    return values


def _rule_broken(error, row):
    what = str(error).removesuffix(f': {row.name}').replace('\n', ' ')
    hint = ''
    if isinstance(error, InvalidParameterTypeException) and row.kind in (_DOUBLE, _DOUBLES):
        hint = ' A double is written with a point: 1.0, not 1.'
    return f'parameter {row.name}: {what}. Rule: {row.constraints}{hint}'


def given_joint_names(node):
    """Joint names that the user has given, before the parameter is declared for good."""
    try:
        names = node.declare_parameter('joint_names', Parameter.Type.STRING_ARRAY).value
    except ParameterException as error:
        raise ValueError(_rule_broken(error, ARM_TABLE[0])) from error
    node.undeclare_parameter('joint_names')
    return names


class MonitorParameters:
    """
    Declare the parameters of the arm and keep the configuration that they all make.

    Parameters
    ----------
    node : rclpy.node.Node
        With the parameters of `BEHAVIOUR_TABLE` declared already.
    on_change : callable
        Called with the new configuration after parameters were set.
    derived : dict of str to value, optional
        Parameters of the arm that came from a robot description.

    Attributes
    ----------
    configuration : Configuration
        Replaced whole when parameters are set; a refused change leaves it as it is.

    Raises
    ------
    ValueError
        If the values at start break a rule: names the parameter, its value and the rule.
    """

    def __init__(self, node, on_change, derived=None):
        self._node = node
        self._on_change = on_change
        declare(node, ARM_TABLE, derived)
        self.configuration = Configuration.from_parameters(self._values())
        # Registered only now: while parameters are declared one by one the set is not complete.
        node.add_on_set_parameters_callback(self._judge)
        node.add_post_set_parameters_callback(self._swap)

    def _values(self):
        return {row.name: self._node.get_parameter_or(row.name).value
                for row in MONITOR_TABLE}

    def _judge(self, parameters):
        values = self._values()
        changed = {parameter.name: parameter.value for parameter in parameters
                   if parameter.name in values}
        if changed:
            try:
                Configuration.from_parameters({**values, **changed})
            except ValueError as error:
                return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _swap(self, parameters):
        values = self._values()
        if any(parameter.name in values for parameter in parameters):
            self.configuration = Configuration.from_parameters(values)
            self._on_change(self.configuration)

