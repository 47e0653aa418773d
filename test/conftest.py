"""Every run of the tests has a ROS domain and a log folder of its own, on this machine alone."""

import os
import tempfile

import pytest

from kinopt_ros.tools.private_domain import reserve_domain

# Read when rclpy starts, hence set before anything imports it. Values from the user's shell
# that would widen the range again have to go.
for name in ('ROS_LOCALHOST_ONLY', 'ROS_STATIC_PEERS', 'FASTRTPS_DEFAULT_PROFILES_FILE',
             'FASTDDS_DEFAULT_PROFILES_FILE', 'ROS_DISCOVERY_SERVER'):
    os.environ.pop(name, None)
os.environ.update(
    ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST',
    ROS_DOMAIN_ID=str(reserve_domain()),
    # Without it a wrongly typed value in a message field arrives as another value.
    ROS_PYTHON_CHECK_FIELDS='1')
_log_dir = tempfile.TemporaryDirectory(prefix='kinopt_ros_log_')
os.environ['ROS_LOG_DIR'] = _log_dir.name


def pytest_addoption(parser):
    parser.addoption(
        '--executor', choices=('single', 'multi', 'events'),
        default=os.environ.get('KINOPT_TEST_EXECUTOR', 'single'),
        help='executor that spins the nodes (default: %(default)s, or $KINOPT_TEST_EXECUTOR)')
    parser.addoption(
        '--soak', type=float, default=1.0, metavar='FACTOR',
        help='so many times as many messages, signals and examples in test/robustness (default: '
             '%(default)s; 500 makes a million messages)')


def pytest_unconfigure():
    _log_dir.cleanup()


@pytest.fixture
def context():
    """Give a context that no other test shares."""
    import rclpy
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    yield context
    context.try_shutdown()
    context.destroy()


@pytest.fixture
def executor(context, request):
    """Give the executor of the test's choice, without nodes."""
    executor = _make_executor(request.config.getoption('--executor'), context)
    yield executor
    executor.shutdown()


def _make_executor(name, context):
    from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
    if name == 'events':
        from rclpy.experimental.events_executor import EventsExecutor
        return EventsExecutor(context=context)
    if name == 'multi':
        return MultiThreadedExecutor(num_threads=2, context=context)
    return SingleThreadedExecutor(context=context)


@pytest.fixture
def soak(request):
    """Give a function that lengthens a number of repetitions by the factor asked for."""
    factor = request.config.getoption('--soak')
    return lambda count: max(1, round(count * factor))


@pytest.fixture
def make_bench(context, executor):
    """Give a factory of benches; arguments as of `support.Bench`."""
    from support import Bench
    benches = []

    def make(*args, **options):
        benches.append(Bench(context, executor, *args, **options))
        return benches[-1]

    yield make
    for bench in reversed(benches):
        bench.close()


@pytest.fixture
def bench(make_bench):
    """Give a bench with the default arm, which does not become stale."""
    return make_bench()


@pytest.fixture
def start():
    """Give a factory of processes of an executable that all end with the test."""
    from processes import EXECUTABLES, Process
    if not (EXECUTABLES / 'singularity_monitor').exists():
        pytest.skip(f'the package is not installed beside this interpreter, in {EXECUTABLES}')
    processes = []

    def make(*arguments, **options):
        processes.append(Process(*arguments, **options))
        return processes[-1]

    yield make
    for process in processes:
        process.kill_group()
        process.popen.communicate()


@pytest.fixture
def feed(context, executor):
    """Give a node that publishes joint states to the executable and hears z."""
    from processes import Feed
    feed = Feed(context, executor)
    yield feed
    feed.close()
