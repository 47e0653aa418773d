"""Three rooms: kinetostatics <- monitor <- tools, and no ROS where the mathematics is."""

import ast
from pathlib import Path
import subprocess
import sys

import pytest

import kinopt_ros

PACKAGE = Path(kinopt_ros.__file__).parent
ROOMS = ('kinetostatics', 'monitor', 'tools')
MODULES = sorted(PACKAGE.rglob('*.py'))
# Modules of the monitor that reason; the node around them does the talking.
PLAIN_MONITOR_MODULES = ('configuration', 'described_arm', 'input_rate', 'motion', 'posture',
                         'posture_monitor', 'signals', 'solver_process', 'verdict')


def module_name(path):
    parts = path.relative_to(PACKAGE.parent).with_suffix('').parts
    return '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)


def imports_of(path):
    """Give the full names of everything that a module imports, wherever it does so."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{path}: imports are absolute'
            yield node.module
            # The name imported may be a module itself.
            yield from (f'{node.module}.{alias.name}' for alias in node.names)


def room_of(name):
    first, _, rest = name.partition('.')
    room = rest.partition('.')[0]
    return room if first == 'kinopt_ros' and room in ROOMS else None


def packages_of(path):
    return {name.partition('.')[0] for name in imports_of(path)}


def modules_in(room):
    return [path for path in MODULES if room_of(module_name(path)) == room]


@pytest.mark.parametrize('room', ROOMS)
def test_rooms_exist(room):
    assert modules_in(room)


@pytest.mark.parametrize('path', modules_in('kinetostatics'), ids=module_name)
def test_kinetostatics_needs_numpy_and_the_standard_library_alone(path):
    allowed = {'numpy', 'kinopt_ros', *sys.stdlib_module_names}
    assert packages_of(path) <= allowed


@pytest.mark.parametrize('path', MODULES, ids=module_name)
def test_imports_point_one_way(path):
    own = room_of(module_name(path))
    if own is None:
        return
    allowed = ROOMS[:ROOMS.index(own) + 1]
    for name in imports_of(path):
        assert room_of(name) in (None, *allowed), f'{path} imports {name}'


@pytest.mark.parametrize('name', PLAIN_MONITOR_MODULES)
def test_reasoning_of_the_monitor_does_not_know_ros(name):
    allowed = {'numpy', 'kinopt_ros', *sys.stdlib_module_names}
    assert packages_of(PACKAGE / 'monitor' / f'{name}.py') <= allowed


@pytest.mark.parametrize('path', MODULES, ids=module_name)
def test_mathematics_and_ros_do_not_meet(path):
    """A module that talks ROS computes nothing: it imports no NumPy."""
    packages = packages_of(path)
    if 'rclpy' in packages:
        assert 'numpy' not in packages


def test_node_needs_no_plotting_nor_science_stack():
    for path in modules_in('monitor') + modules_in('kinetostatics'):
        assert not packages_of(path) & {'scipy', 'matplotlib', 'pandas', 'hypothesis', 'pytest'}


BLOCKED_IMPORT = '''
import sys

class Block:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in {blocked!r}:
            raise ImportError('blocked: ' + name)

sys.meta_path.insert(0, Block())
import importlib
for name in {modules!r}:
    importlib.import_module(name)
from kinopt_ros.kinetostatics import PlanarArm, kinetostatic_index
print(kinetostatic_index(PlanarArm((1.0, 1.0, 1.0)), (0.0, 0.0, 3.141592653589793)).z)
assert not set({blocked!r}) & set(sys.modules)
'''


def test_core_runs_without_ros():
    blocked = ('rclpy', 'rcl_interfaces', 'std_msgs', 'sensor_msgs', 'scipy', 'matplotlib')
    modules = [module_name(path) for path in modules_in('kinetostatics')]
    modules += [f'kinopt_ros.monitor.{name}' for name in PLAIN_MONITOR_MODULES]
    done = subprocess.run(
        [sys.executable, '-c', BLOCKED_IMPORT.format(blocked=blocked, modules=modules)],
        cwd=PACKAGE.parent, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) == pytest.approx(0.5)
