"""Check that what colcon installed lies where `ros2 run` and `ros2 launch` look for it."""

from configparser import ConfigParser
import os
from pathlib import Path
import subprocess
import sys

ROOT = Path(__file__).resolve().parent.parent


def expected_files(install):
    """Give the files that the two packages have to install."""
    package = install / 'kinopt_ros'
    share = package / 'share'
    yield share / 'ament_index/resource_index/packages/kinopt_ros'
    yield share / 'kinopt_ros/package.xml'
    for folder in ('config', 'launch'):
        for path in sorted((ROOT / folder).iterdir()):
            yield share / 'kinopt_ros' / folder / path.name
    for name in console_scripts(package):
        yield package / 'lib/kinopt_ros' / name
    share = install / 'kinopt_interfaces/share'
    yield share / 'ament_index/resource_index/packages/kinopt_interfaces'
    yield share / 'ament_index/resource_index/rosidl_interfaces/kinopt_interfaces'
    for folder in ('msg', 'srv'):
        for path in sorted((ROOT / 'kinopt_interfaces' / folder).iterdir()):
            yield share / 'kinopt_interfaces' / folder / path.name


def console_scripts(package):
    """Give the names of the executables from the installed metadata."""
    metadata, = package.glob('lib/python*/site-packages/*.egg-info/entry_points.txt')
    parser = ConfigParser()
    parser.read(metadata)
    names = list(parser['console_scripts'])
    assert 'singularity_monitor' in names
    return names


def run_with_bad_parameters(install):
    """Run the node as `ros2 run` does, without parameters: it has to say what it misses."""
    path = ':'.join(map(str, [*install.glob('*/lib/python*/site-packages'),
                              *filter(None, [os.environ.get('PYTHONPATH')])]))
    return subprocess.run(
        [sys.executable, install / 'kinopt_ros/lib/kinopt_ros/singularity_monitor'],
        env={**os.environ, 'PYTHONPATH': path}, capture_output=True, text=True, timeout=30)


def main():
    """Check the install folder given; the exit status is returned."""
    install = Path(sys.argv[1]).resolve()
    files = list(expected_files(install))
    missing = [str(path) for path in files if not path.is_file()]
    if missing:
        print('not installed:', *missing, sep='\n  ', file=sys.stderr)
        return 1
    result = run_with_bad_parameters(install)
    if result.returncode != 1 or 'joint_names is required' not in result.stderr:
        print(f'the installed node does not run: {result.stderr}', file=sys.stderr)
        return 1
    print(f'colcon: {len(files)} files are in place, and the node runs')
    return 0


if __name__ == '__main__':
    sys.exit(main())
