"""Launch files, configurations and manifests: what they name exists, without a ROS install."""

import ast
import importlib.util
from pathlib import Path
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import pytest
import yaml

ROOT = Path(__file__).parents[1]
LAUNCH_FILES = sorted((ROOT / 'launch').glob('*.launch.py'))
CONFIGS = sorted((ROOT / 'config').glob('*.yaml'))
FIXTURES = ROOT / 'test' / 'fixtures'
# Where a described arm's sample description is.
DESCRIPTION = FIXTURES / 'ur5.urdf'

# Enough of launch and launch_ros to run a launch file and to see what it asks for. Names that
# the real packages do not have are not here either.
STUBS = '''
import json, sys, types

def module(name, **members):
    made = types.ModuleType(name)
    made.__dict__.update(members)
    made.__path__ = []
    sys.modules[name] = made

def text(value):
    if isinstance(value, (list, tuple)):
        return ''.join(text(v) for v in value)
    return str(value)

class LaunchConfiguration:
    def __init__(self, name, *, default=None):
        self.name = name
        used.append(name)
    def __str__(self):
        return '$(' + self.name + ')'
    def perform(self, context):
        return context.get(self.name) or declared[self.name]['default']

class FindPackageShare:
    def __init__(self, package):
        self.package = package
    def __str__(self):
        return '<share ' + self.package + '>'

class PathJoinSubstitution:
    def __init__(self, parts):
        self.parts = parts
    def __str__(self):
        return '/'.join(text(p) for p in self.parts)

class DeclareLaunchArgument:
    def __init__(self, name, *, default_value=None, description=None, choices=None):
        declared[name] = dict(default=None if default_value is None else text(default_value),
                              description=description)

class Wrapped:
    def __init__(self, value, *, value_type=None, allow_substs=False):
        self.value = value
    def __str__(self):
        return text(self.value)

class Include:
    def __init__(self, source, *, launch_arguments=()):
        included.append([text(source), [[n, text(v)] for n, v in launch_arguments]])

class Node:
    def __init__(self, *, package, executable, name=None, namespace=None, parameters=None,
                 arguments=None, output=None, condition=None, remappings=None):
        nodes.append(dict(
            package=package, executable=executable, namespace=text(namespace),
            parameters=[{k: text(v) for k, v in p.items()} if isinstance(p, dict) else text(p)
                        for p in parameters or ()],
            arguments=[text(a) for a in arguments or ()], conditional=condition is not None))

class OpaqueFunction:
    def __init__(self, *, function):
        function(arguments)

class LaunchDescription:
    def __init__(self, entities):
        self.entities = entities

declared, used, nodes, included = {}, [], [], []
arguments = dict(argument.split(':=', 1) for argument in sys.argv[2:])
module('launch', LaunchDescription=LaunchDescription)
module('launch.actions', DeclareLaunchArgument=DeclareLaunchArgument,
       IncludeLaunchDescription=Include, OpaqueFunction=OpaqueFunction)
module('launch.conditions', IfCondition=Wrapped, UnlessCondition=Wrapped)
module('launch.substitutions', LaunchConfiguration=LaunchConfiguration,
       PathJoinSubstitution=PathJoinSubstitution)
module('launch.launch_description_sources', PythonLaunchDescriptionSource=Wrapped)
module('launch_ros')
module('launch_ros.actions', Node=Node)
module('launch_ros.parameter_descriptions', ParameterFile=Wrapped, ParameterValue=Wrapped)
module('launch_ros.substitutions', FindPackageShare=FindPackageShare)
space = {'__name__': 'launch_file'}
exec(compile(open(sys.argv[1]).read(), sys.argv[1], 'exec'), space)
made = space['generate_launch_description']()
assert isinstance(made, LaunchDescription)
print(json.dumps(dict(declared=declared, used=used, nodes=nodes, included=included)))
'''


def asked_for(path, *arguments):
    """Give what a launch file declares, uses, starts and includes, with arguments name:=value."""
    done = subprocess.run([sys.executable, '-c', STUBS, str(path), *arguments],
                          capture_output=True, text=True, timeout=30)
    assert done.returncode == 0, done.stderr
    return yaml.safe_load(done.stdout)


def share_file(text):
    """Find what a path below this package's share folder refers to in the sources."""
    folder = '<share kinopt_ros>/'
    assert text.startswith(folder), text
    return ROOT / text.removeprefix(folder)


def setup_arguments():
    """Give the keyword arguments of setup(), without running it."""
    tree = ast.parse((ROOT / 'setup.py').read_text())
    call = next(node for node in ast.walk(tree) if isinstance(node, ast.Call)
                and getattr(node.func, 'id', '') == 'setup')
    return {keyword.arg: keyword.value for keyword in call.keywords}


def console_scripts():
    scripts = ast.literal_eval(setup_arguments()['entry_points'])['console_scripts']
    return dict(re.split(r'\s*=\s*', script) for script in scripts)


def manifest(path='package.xml'):
    return ElementTree.parse(ROOT / path).getroot()


# --- launch ---------------------------------------------------------------------------------


def test_both_launch_files_are_there():
    assert {path.name for path in LAUNCH_FILES} >= {'monitor.launch.py', 'demo.launch.py'}


@pytest.mark.parametrize('path', LAUNCH_FILES, ids=lambda path: path.name)
def test_names_of_a_launch_file(path):
    asked = asked_for(path)
    assert set(asked['used']) <= set(asked['declared'])
    for name, argument in asked['declared'].items():
        assert argument['description'], name
        if (argument['default'] or '').startswith('<share'):
            assert share_file(argument['default']).is_file()
    for node in asked['nodes']:
        assert node['package'] in ('kinopt_ros', 'rviz2')
        if node['package'] == 'kinopt_ros':
            assert node['executable'] in console_scripts()
        else:
            assert node['conditional']
        for argument in node['arguments']:
            if argument.startswith('<share'):
                assert share_file(argument).is_file()
    for source, arguments in asked['included']:
        included = share_file(source)
        assert included in LAUNCH_FILES
        assert {name for name, _ in arguments} <= set(asked_for(included)['declared'])


def test_arguments_of_the_monitor():
    asked = asked_for(ROOT / 'launch' / 'monitor.launch.py')
    assert set(asked['declared']) >= {'params_file', 'namespace', 'robot_description', 'rviz'}
    assert asked['declared']['rviz']['default'] == 'false'
    monitor, = (node for node in asked['nodes'] if node['executable'] == 'singularity_monitor')
    assert monitor['namespace'] == '$(namespace)'
    # Without the argument the parameter file has its say about the robot description.
    assert monitor['parameters'] == ['$(params_file)']
    asked = asked_for(ROOT / 'launch' / 'monitor.launch.py', 'robot_description:=<robot/>')
    monitor, = (node for node in asked['nodes'] if node['executable'] == 'singularity_monitor')
    assert monitor['parameters'] == [
        '$(params_file)', {'robot_description': '$(robot_description)'}]


def test_demo_starts_monitor_and_simulated_arm_with_one_configuration():
    asked = asked_for(ROOT / 'launch' / 'demo.launch.py')
    (source, arguments), = asked['included']
    assert source.endswith('monitor.launch.py')
    assert ['params_file', '$(params_file)'] in arguments
    arm, = asked['nodes']
    assert (arm['executable'], arm['parameters']) == ('simulated_arm', ['$(params_file)'])
    # The simulated arm needs joint names and lengths: the default file has to give them.
    values = yaml.safe_load(share_file(asked['declared']['params_file']['default']).read_text())
    assert {'joint_names', 'link_lengths'} <= set(values['/**']['ros__parameters'])


@pytest.mark.skipif(importlib.util.find_spec('launch_ros') is None,
                    reason='ros2 launch is not installed')
@pytest.mark.parametrize('path', LAUNCH_FILES, ids=lambda path: path.name)
def test_launch_file_with_the_real_launch(path):
    spec = importlib.util.spec_from_file_location('launch_file', path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    from launch import LaunchDescription
    assert isinstance(module.generate_launch_description(), LaunchDescription)


# --- configurations -------------------------------------------------------------------------


@pytest.mark.parametrize('path', CONFIGS, ids=lambda path: path.name)
def test_parameter_file_loads_into_the_node(context, path):
    """As ros2 run --params-file gives it; a value that the node does not know is a mistake."""
    from kinopt_ros.monitor.singularity_monitor import SingularityMonitor
    text = path.read_text()
    given = yaml.safe_load(text)['/**']['ros__parameters']
    arguments = ['--ros-args', '--params-file', str(path)]
    overrides = []
    if 'base_link' in given:
        from rclpy.parameter import Parameter
        overrides = [Parameter('robot_description', value=DESCRIPTION.read_text())]
    node = SingularityMonitor(context=context, cli_args=arguments,
                              parameter_overrides=overrides)
    try:
        for name, value in given.items():
            assert node.has_parameter(name), f'{path.name}: the node knows no {name}'
            used = node.get_parameter(name).value
            assert (used if isinstance(used, (str, float, bool)) else list(used)) == value
    finally:
        node.destroy_node()


@pytest.mark.parametrize('name', ['ur3e', 'ur5', 'ur5e', 'ur10e', 'scara', 'planar_4r'])
def test_parameter_file_is_the_arm_of_its_description(context, name):
    """Typed by hand and derived from the URDF: the same numbers."""
    from kinopt_ros.monitor.robot_description import planar_subchain_of
    given = yaml.safe_load(
        (ROOT / 'config' / f'{name}.yaml').read_text())['/**']['ros__parameters']
    tip = {'scara': 'tool', 'planar_4r': 'tip'}.get(name, 'wrist_2_link')
    pytest.importorskip('urdf_parser_py')
    found = planar_subchain_of((FIXTURES / f'{name}.urdf').read_text(), 'base_link', tip)
    assert list(found.joint_names) == given['joint_names']
    for key in ('link_lengths', 'joint_offsets', 'joint_directions', 'joint_lower',
                'joint_upper'):
        assert list(getattr(found, key)) == pytest.approx(given[key], abs=1e-9), key


@pytest.fixture
def offered(context):
    """Give the topics that a node offers in the global namespace."""
    from rclpy.parameter import Parameter

    from kinopt_ros.monitor.singularity_monitor import SingularityMonitor
    node = SingularityMonitor(context=context, parameter_overrides=[
        Parameter('joint_names', value=['a', 'b', 'c']),
        Parameter('link_lengths', value=[1.0, 1.0, 1.0])])
    yield {publisher.topic_name: publisher.msg_type.__name__ for publisher in node.publishers}
    node.destroy_node()


def test_rviz_shows_topics_that_the_node_offers(offered):
    shown = yaml.safe_load((ROOT / 'config' / 'monitor.rviz').read_text())
    displays = shown['Visualization Manager']['Displays']
    topics = {display['Class']: display['Topic']['Value'] for display in displays
              if 'Topic' in display}
    markers = topics.pop('rviz_default_plugins/MarkerArray')
    # Relative, so that the namespace of the launch file reaches both.
    assert not markers.startswith('/')
    assert offered[f'/{markers}'] == 'MarkerArray'
    assert topics == {}
    assert shown['Visualization Manager']['Global Options']['Fixed Frame'] == 'base_link'


def test_plotjuggler_layout_plots_topics_that_the_node_offers(offered):
    layout = ElementTree.parse(ROOT / 'config' / 'plotjuggler.xml')
    curves = [curve.get('name') for curve in layout.iter('curve')]
    selected = {topic.get('name') for topic in layout.iter('topic')}
    assert {'z', 'margin', 'conditioning_length', 'near_singularity'} <= {
        curve.split('/')[2] for curve in curves}
    assert selected <= set(offered)
    for curve in curves:
        topic, _, field = curve.rpartition('/')
        assert topic in selected
        assert (offered[topic], field) in (('Float64', 'data'), ('Bool', 'data'))


# --- manifests ------------------------------------------------------------------------------


def test_one_version():
    versions = {ast.literal_eval(setup_arguments()['version']),
                manifest().findtext('version'),
                manifest('kinopt_interfaces/package.xml').findtext('version')}
    assert len(versions) == 1, versions


def test_entry_points_exist():
    for name, target in console_scripts().items():
        module, _, function = target.partition(':')
        path = ROOT / (module.replace('.', '/') + '.py')
        names = {node.name for node in ast.parse(path.read_text()).body
                 if isinstance(node, ast.FunctionDef)}
        assert function in names, name


# What an import is called in rosdep, where that is another name.
ROSDEP = {'numpy': 'python3-numpy', 'urdf_parser_py': 'urdfdom_py', 'yaml': 'python3-yaml'}
# Used where they are there; where they are not, a message says how to get them.
OPTIONAL = {'kinopt_interfaces', 'matplotlib', 'rosbags', 'tqdm', 'urdf_parser_py'}


def imported_packages():
    for path in (ROOT / 'kinopt_ros').rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                yield from (alias.name.partition('.')[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                yield node.module.partition('.')[0]


def test_dependencies_cover_the_imports():
    root = manifest()
    declared = {element.text for kind in ('depend', 'exec_depend') for element in root.iter(kind)}
    needed = {ROSDEP.get(name, name) for name in set(imported_packages()) - OPTIONAL
              if name not in sys.stdlib_module_names and name != 'kinopt_ros'}
    assert needed <= declared, f'package.xml lacks {sorted(needed - declared)}'
    assert root.find('name').text == ast.literal_eval(
        next(node.value for node in ast.parse((ROOT / 'setup.py').read_text()).body
             if isinstance(node, ast.Assign) and node.targets[0].id == 'package_name'))


def test_launch_dependencies_are_declared():
    declared = {element.text for element in manifest().iter('exec_depend')}
    assert {'launch', 'launch_ros'} <= declared
