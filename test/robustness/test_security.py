"""
The security policy against what the nodes really use, and a start that security forbids.

The middleware of the wheels is built without its security plugins: that the policy is enforced
cannot be tested with it, only that the policy is complete, grants no more, and that the node
never runs open where security is demanded.
"""

from pathlib import Path
from xml.etree import ElementTree

from processes import ARM
import pytest
from rclpy.expand_topic_name import expand_topic_name
from rclpy.parameter import Parameter
from rclpy.validate_full_topic_name import validate_full_topic_name
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_node_name import validate_node_name
from support import LENGTHS, NAMES

from kinopt_ros.monitor import robot_description
from kinopt_ros.monitor.singularity_monitor import SingularityMonitor
from kinopt_ros.tools.simulated_arm import SimulatedArm

POLICY = Path(__file__).parents[2] / 'security' / 'policy.xml'
# Granted, and used only in some set-ups: with a description, with simulated time, with
# kinopt_interfaces built.
SOMETIMES = {
    ('subscribe', '/robot_description'), ('subscribe', '/clock'),
    ('publish', '/singularity_monitor/state'),
    ('reply', '/singularity_monitor/solve_optimal_posture')}
# What sros2 accepts as a policy, by its schema of version 0.2.0 (sros2/policy/schemas/policy.xsd):
# required attributes, optional attributes, children; a rule holds a name instead.
SCHEMA = {
    'policy': ({'version'}, set(), {'enclaves'}),
    'enclaves': (set(), set(), {'enclave'}),
    'enclave': ({'path'}, set(), {'profiles'}),
    'profiles': (set(), {'type'}, {'profile', 'metadata'}),
    'profile': ({'ns', 'node'}, set(), {'topics', 'services', 'actions'}),
    'topics': (set(), {'publish', 'subscribe'}, {'topic'}),
    'services': (set(), {'reply', 'request'}, {'service'}),
    'actions': (set(), {'call', 'execute'}, {'action'})}
RULES = {'topic', 'service', 'action'}
PARAMETER_WRITES = {'set_parameters', 'set_parameters_atomically'}


def assert_valid(element):
    """Assert that an element of a policy is what sros2's schema asks for, and all below it."""
    case = (element.tag, element.attrib, element.text)
    if element.tag in RULES:
        assert not element.attrib and not len(element), case
        # sros2 copies it as it stands: a blank would become part of the name.
        validate_full_topic_name(expand_topic_name(element.text, 'node', '/'))
        return
    required, optional, children = SCHEMA[element.tag]
    assert required <= set(element.attrib) <= required | optional, case
    assert not (element.text or '').strip(), case
    if element.tag != 'profile':
        assert len(element), case
    if children & RULES:
        assert element.attrib and set(element.attrib.values()) <= {'ALLOW', 'DENY'}, case
    for child in element:
        assert child.tag in children and not (child.tail or '').strip(), (case, child.tag)
        assert_valid(child)


def grants(enclave):
    """Give the (verb, absolute name) pairs that an enclave of the policy allows."""
    root = ElementTree.parse(POLICY).getroot()
    assert (root.tag, root.get('version')) == ('policy', '0.2.0')
    found, = (e for e in root.find('enclaves') if e.get('path') == f'/kinopt_ros/{enclave}')
    allowed = set()
    for profile in found.find('profiles'):
        for rules in profile:
            assert rules.tag in ('topics', 'services') and len(rules.attrib) == 1
            (verb, qualifier), = rules.attrib.items()
            assert qualifier == 'ALLOW'
            for rule in rules:
                assert rule.tag == rules.tag[:-1]
                allowed.add((verb, absolute(rule.text, profile.get('ns'), profile.get('node'))))
    return allowed


def absolute(name, namespace, node):
    prefix = namespace.rstrip('/')
    if name.startswith('~/'):
        return f'{prefix}/{node}/{name[2:]}'
    return name if name.startswith('/') else f'{prefix}/{name}'


def uses(node):
    """Give the (verb, absolute name) pairs of what a node has created."""
    name, namespace = node.get_name(), node.get_namespace()
    listed = {
        'publish': node.get_publisher_names_and_types_by_node(name, namespace),
        'subscribe': node.get_subscriber_names_and_types_by_node(name, namespace),
        'reply': node.get_service_names_and_types_by_node(name, namespace),
        'request': node.get_client_names_and_types_by_node(name, namespace)}
    return {(verb, topic) for verb, names in listed.items() for topic, _ in names}


def test_policy_is_one_by_the_schema_of_sros2():
    root = ElementTree.parse(POLICY).getroot()
    assert (root.tag, root.get('version')) == ('policy', '0.2.0')
    assert len(root) == 1
    assert_valid(root)
    paths = [enclave.get('path') for enclave in root.find('enclaves')]
    # The path becomes a folder of the keystore and the name in the certificate.
    assert len(set(paths)) == len(paths)
    for path in paths:
        validate_namespace(path)
    for profile in root.iter('profile'):
        validate_namespace(profile.get('ns'))
        validate_node_name(profile.get('node'))


def test_monitor_is_granted_what_it_uses_and_nothing_else(make_bench):
    monitor = make_bench().monitor
    granted = grants('monitor')
    assert uses(monitor) <= granted
    assert granted - uses(monitor) <= SOMETIMES


def test_what_it_uses_sometimes_is_granted(make_bench):
    bench = make_bench({'use_sim_time': True})
    assert ('subscribe', '/clock') in uses(bench.monitor) & grants('monitor')


def test_what_waits_for_a_robot_description_is_granted(context):
    pytest.importorskip('urdf_parser_py', reason=robot_description.INSTALL_HINT)
    monitor = SingularityMonitor(context=context, parameter_overrides=[
        Parameter('base_link', value='base_link'), Parameter('tip_link', value='tip')])
    assert ('subscribe', '/robot_description') in uses(monitor) & grants('monitor')
    assert uses(monitor) <= grants('monitor')
    monitor.destroy_node()


def test_simulated_arm_is_granted_what_it_uses(context):
    arm = SimulatedArm(context=context, parameter_overrides=[
        Parameter('joint_names', value=NAMES), Parameter('link_lengths', value=LENGTHS)])
    assert uses(arm) <= grants('arm')
    assert grants('arm') - uses(arm) <= {('subscribe', '/clock')}
    arm.destroy_node()


def test_monitor_can_command_nothing():
    topics = {name for verb, name in grants('monitor') if verb == 'publish'}
    assert all(name.startswith('/singularity_monitor/') for name in topics
               - {'/diagnostics', '/rosout', '/parameter_events'})
    assert not any(verb == 'request' for verb, _ in grants('monitor'))


def test_only_the_supervisor_sets_parameters_and_only_the_arm_sends_joint_states():
    for enclave in ('monitor', 'arm', 'supervisor', 'observer'):
        granted = grants(enclave)
        writes = {name for verb, name in granted if verb == 'request'
                  and name.rpartition('/')[2] in PARAMETER_WRITES}
        assert bool(writes) is (enclave == 'supervisor')
        assert (('publish', '/joint_states') in granted) is (enclave == 'arm')


@pytest.mark.parametrize('service', sorted(PARAMETER_WRITES))
def test_supervisor_reaches_the_services_that_exist(make_bench, service):
    name = f'/singularity_monitor/{service}'
    assert ('reply', name) in uses(make_bench().monitor)
    assert ('request', name) in grants('supervisor')


@pytest.mark.parametrize('strategy', ['Enforce', 'Permissive'])
def test_never_open_where_security_is_demanded(start, tmp_path, monkeypatch, strategy):
    """Without keys, or without a middleware that can: it refuses to start, in one line."""
    if strategy == 'Permissive':
        pytest.importorskip('ros_wheels_bootstrapper', reason='a ROS install may start open')
    (tmp_path / 'enclaves').mkdir()
    monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
    monkeypatch.setenv('ROS_SECURITY_STRATEGY', strategy)
    monkeypatch.setenv('ROS_SECURITY_KEYSTORE', str(tmp_path))
    status, _, error = start(*ARM).end()
    assert status == 1, error
    assert 'Traceback' not in error
    # The middleware adds lines of its own.
    line, = (line for line in error.splitlines() if line.startswith('error: '))
    assert 'security' in line.lower()
