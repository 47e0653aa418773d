"""What the node tests share: a bench with a monitor on it, and an oracle for its numbers."""

import math
import time
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64

from kinopt_ros.monitor.parameters import MONITOR_TABLE
from kinopt_ros.monitor.singularity_monitor import SingularityMonitor

DEADLINE = 10.0
NAMES = ['shoulder', 'elbow', 'wrist']
LENGTHS = [1.0, 1.0, math.sqrt(3.0) / 3.0]
# Isotropic posture of the arm above by the paper, a regular one, and singular ones.
ISOTROPIC = [0.0, 2.0 * math.pi / 3.0, 5.0 * math.pi / 6.0]
REGULAR = [0.3, 1.5, 2.0]
STRETCHED = [0.2, 0.0, 1.0]
# Over a slow machine's scheduling, under a test's patience.
NEVER_STALE = 30.0


class Numbers(NamedTuple):
    """What the numeric topics of one cycle hold."""

    z: float
    conditioning_length: float
    margin: float


def expected_numbers(link_lengths, joint_angles):
    """
    Compute the three numbers of a posture by the singular values of explicit matrices.

    The closest isotropic matrix is found as the orthogonal factor of the centred Jacobian and
    inserted into the paper's definition of z, at the length that its least squares give.
    """
    n = len(link_lengths)
    absolute = np.cumsum(joint_angles)
    links = np.array(link_lengths) * np.array([np.cos(absolute), np.sin(absolute)])
    vectors = np.array([links[:, i:].sum(axis=1) for i in range(n)]).T
    block = np.array([-vectors[1], vectors[0]])
    # Model matrices are orthogonal to the row of ones, also where the block has rank one.
    basis = np.linalg.qr(np.vstack([np.ones(n), np.eye(n)[1:]]).T)[0][:, 1:]
    left, _, right = np.linalg.svd(block @ basis, full_matrices=False)
    model = math.sqrt(n) * left @ right @ basis.T
    length = np.sum(block ** 2) / np.sum(model * block)
    jacobian = np.vstack([np.ones(n), block / length])
    difference = jacobian - np.vstack([np.ones(n), model])
    distances = np.linalg.svd(jacobian[1:] @ basis, compute_uv=False)
    return Numbers(np.trace(difference @ difference.T) / (2 * n), length,
                   distances[1] / math.sqrt(n))


def assert_numbers(numbers, expected, tolerance=1e-9):
    np.testing.assert_allclose(numbers, expected, rtol=tolerance, atol=tolerance)


def assert_unknown(cycle):
    """Assert NaN, NaN, NaN and a raised flag."""
    numbers, flag = cycle
    assert all(math.isnan(value) for value in numbers)
    assert flag is True


def linger(executor, seconds):
    """Spin for a time, whatever happens."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        executor.spin_once(timeout_sec=0.01)


def parameter_values(**changes):
    """Give a value for every parameter of the table, by name: a three-joint arm's."""
    values = {row.name: row.default(3, 'arm') if callable(row.default) else row.default
              for row in MONITOR_TABLE}
    return {**values, 'joint_names': ['a', 'b', 'c'], 'link_lengths': [1.0, 1.0, 1.0], **changes}


class Bench:
    """
    A monitor, and beside it a node that feeds it and listens, spun in the test's own thread.

    Parameters
    ----------
    context : rclpy.Context
    executor : rclpy.executors.Executor
    parameters : dict of str to value
        On top of a three-joint arm's that does not become stale within a test.
    namespace : str
        The monitor's.
    cli_args : sequence of str
        The monitor's, for instance remappings.
    name : str
        Fully qualified name that the monitor is to have.
    joint_states, diagnostics : str
        Topics that it is to use.

    Attributes
    ----------
    cycles : list of (Numbers, bool)
        What was heard on the four topics, in order.
    diagnostics : list of DiagnosticArray
    """

    def __init__(self, context, executor, parameters=None, *, namespace=None, cli_args=(),
                 name='/singularity_monitor', joint_states='/joint_states',
                 diagnostics='/diagnostics'):
        self.executor = executor
        values = {'joint_names': NAMES, 'link_lengths': LENGTHS, 'stale_timeout': NEVER_STALE}
        values.update(parameters or {})
        self.name = name
        self._heard = {topic: [] for topic in (*Numbers._fields, 'near_singularity')}
        self.diagnostics = []
        self._clients = {}
        self.peer = Node('peer', context=context)
        for topic, heard in self._heard.items():
            kind = Bool if topic == 'near_singularity' else Float64
            self.peer.create_subscription(
                kind, f'{name}/{topic}', lambda message, heard=heard: heard.append(message.data),
                100)
        self.peer.create_subscription(
            DiagnosticArray, diagnostics, self.diagnostics.append, 100)
        self.publisher = self.peer.create_publisher(JointState, joint_states, 10)
        executor.add_node(self.peer)
        self.monitor = SingularityMonitor(
            context=context, namespace=namespace, cli_args=list(cli_args),
            parameter_overrides=[Parameter(key, value=value) for key, value in values.items()
                                 if value is not None])
        executor.add_node(self.monitor)
        self.wait(self._is_connected, 'discovery')

    def close(self):
        for node in (self.monitor, self.peer):
            self.executor.remove_node(node)
            node.destroy_node()

    def wait(self, condition, what):
        """Spin until the condition holds; fail when it does not before the deadline."""
        deadline = time.monotonic() + DEADLINE
        while not condition():
            assert time.monotonic() < deadline, f'nothing of this within {DEADLINE} s: {what}'
            self.executor.spin_once(timeout_sec=0.01)

    def linger(self, seconds):
        """Spin for a time in which something must not happen."""
        linger(self.executor, seconds)

    def _is_connected(self):
        return (all(s.get_publisher_count() > 0 for s in self.peer.subscriptions)
                and self.publisher.get_subscription_count() > 0
                and all(s.get_publisher_count() > 0 for s in self.monitor.subscriptions
                        if s.msg_type is JointState)
                and all(p.get_subscription_count() > 0 for p in self.monitor.publishers
                        if p.msg_type in (Float64, Bool, DiagnosticArray)))

    @property
    def cycles(self):
        *numbers, flags = self._heard.values()
        return [(Numbers(*values), flag) for *values, flag in zip(*numbers, flags)]

    @property
    def counts(self):
        """Count what each topic has carried."""
        return {topic: len(heard) for topic, heard in self._heard.items()}

    def send(self, positions, names=NAMES, stamp=None, publisher=None):
        """Publish a JointState."""
        message = JointState(name=list(names), position=[float(p) for p in positions])
        if stamp is not None:
            message.header.stamp.sec, message.header.stamp.nanosec = stamp
        (publisher or self.publisher).publish(message)

    def cycle(self, positions, names=NAMES, **options):
        """Publish a JointState and give the cycle that answers it."""
        count = len(self.cycles)
        self.send(positions, names, **options)
        return self.next_cycle(count)

    def next_cycle(self, count):
        """Wait for the cycle after so many."""
        self.wait(lambda: len(self.cycles) > count, f'cycle {count + 1}')
        return self.cycles[count]

    @property
    def status(self):
        """The status of the latest diagnostics."""
        return self.diagnostics[-1].status[0]

    @property
    def level(self):
        """Level of the latest diagnostics, an integer."""
        return int.from_bytes(self.status.level, 'little')

    @property
    def values(self):
        """Key-values of the latest diagnostics."""
        return {pair.key: pair.value for pair in self.status.values}

    def wait_for_level(self, level, since=0):
        """Wait for diagnostics of a level after so many arrays."""
        self.wait(lambda: len(self.diagnostics) > since and self.level == level,
                  f'diagnostics of level {level}')
        return self.status

    def call(self, kind, service, **request):
        """
        Call one of the monitor's parameter services.

        A client sees a service before the service sees the client, and an answer in between is
        lost: ask again then. All these requests may be repeated.
        """
        if service not in self._clients:
            self._clients[service] = self.peer.create_client(kind, f'{self.name}/{service}')
        client = self._clients[service]
        self.wait(client.service_is_ready, service)
        futures = []
        for _ in range(5):
            futures.append(client.call_async(kind.Request(**request)))
            deadline = time.monotonic() + DEADLINE / 5.0
            while time.monotonic() < deadline:
                self.executor.spin_once(timeout_sec=0.01)
                for future in futures:
                    if future.done():
                        return future.result()
        raise AssertionError(f'no answer of {service} within {DEADLINE} s')

    def set(self, **values):
        """Set parameters one after the other; give the results in order."""
        return self.call(SetParameters, 'set_parameters', parameters=_messages(values)).results

    def set_atomically(self, **values):
        """Set parameters together; give the one result."""
        return self.call(SetParametersAtomically, 'set_parameters_atomically',
                         parameters=_messages(values)).result

    def get(self, name):
        """Give a parameter's value as the service tells it."""
        response = self.call(GetParameters, 'get_parameters', names=[name])
        message = ParameterMessage(name=name, value=response.values[0])
        value = Parameter.from_parameter_msg(message).value
        return value if value is None or isinstance(value, (str, float, bool)) else list(value)

    def describe(self, *names):
        """Give the descriptors of parameters."""
        return self.call(DescribeParameters, 'describe_parameters', names=names).descriptors

    def list_parameters(self):
        """Give the names of all parameters."""
        return self.call(ListParameters, 'list_parameters').result.names


def _messages(values):
    return [value if isinstance(value, ParameterMessage)
            else Parameter(name, value=value).to_parameter_msg()
            for name, value in values.items()]
