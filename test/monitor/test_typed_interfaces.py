"""The interfaces of kinopt_interfaces on the node, and the node without them."""

import math
from pathlib import Path
import statistics
import subprocess
import sys
import time

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from sensor_msgs.msg import JointState
from support import assert_numbers, expected_numbers, ISOTROPIC, LENGTHS, NAMES, REGULAR, STRETCHED

try:
    from kinopt_interfaces.msg import KinetostaticState
    from kinopt_interfaces.srv import SolveOptimalPosture
except ImportError as error:
    KinetostaticState = SolveOptimalPosture = None
    REASON = f'kinopt_interfaces is not built: {error}'
else:
    REASON = ''

needs_interfaces = pytest.mark.skipif(KinetostaticState is None, reason=REASON)


def solve(bench, **request):
    return bench.call(SolveOptimalPosture, 'solve_optimal_posture', **request)


def listen(bench, depth=100):
    heard = []
    subscription = bench.peer.create_subscription(
        KinetostaticState, f'{bench.name}/state', heard.append, depth)
    bench.wait(lambda: subscription.get_publisher_count() == 1
               and bench.peer.count_subscribers(f'{bench.name}/state') == 1, 'discovery')
    own = state_publisher(bench)
    bench.wait(lambda: own.get_subscription_count() == 1, 'discovery by the monitor')
    return heard


def state_publisher(bench):
    own, = (p for p in bench.monitor.publishers if p.topic_name == f'{bench.name}/state')
    return own


def state_of(bench, heard, positions, **options):
    """Publish a JointState and give the state that answers it."""
    count = len(heard)
    bench.cycle(positions, **options)
    bench.wait(lambda: len(heard) > count, 'a state')
    return heard[count]


# --- the service ----------------------------------------------------------------------------


@needs_interfaces
def test_empty_request_is_about_the_monitored_arm(make_bench):
    bench = make_bench({'joint_directions': [1, -1, 1], 'joint_offsets': [0.0, 0.5, -1.0]})
    response = solve(bench)
    assert response.success, response.message
    assert response.isotropic is True
    assert response.z == pytest.approx(0.0, abs=1e-9)
    assert response.characteristic_length == pytest.approx(math.sqrt(6.0) / 6.0, abs=1e-7)
    assert response.margin == pytest.approx(1.0, abs=1e-6)
    numbers, _ = bench.cycle(response.joint_positions)
    assert_numbers(
        numbers, (response.z, response.characteristic_length, response.margin), 1e-7)
    for other in response.alternatives:
        numbers, _ = bench.cycle(other.joint_positions)
        assert (numbers.z, numbers.margin) == pytest.approx((other.z, other.margin), abs=1e-6)


@needs_interfaces
def test_empty_request_keeps_the_limits_and_the_posture_of_the_arm(make_bench):
    bench = make_bench({'joint_lower': [-1.0, -3.0, -3.0], 'joint_upper': [1.0, 0.0, 0.0]})
    bench.cycle([0.4, -0.1, -0.1])
    positions = solve(bench).joint_positions
    assert positions == pytest.approx([0.4, -ISOTROPIC[1], -ISOTROPIC[2]], abs=1e-5)
    # Limits of the request take the place of the arm's.
    response = solve(bench, joint_lower=[-3.0] * 3, joint_upper=[-0.5, -0.5, -0.5])
    assert response.success and max(response.joint_positions) <= -0.5 + 1e-9


@needs_interfaces
@pytest.mark.parametrize('lengths', [[1.0, 1.0, 1.0], [0.3, 0.9, 0.4, 0.2], [2.0] * 6])
def test_given_lengths_leave_the_monitored_arm_alone(bench, lengths):
    response = solve(bench, link_lengths=lengths)
    assert response.success, response.message
    assert_numbers((response.z, response.characteristic_length, response.margin),
                   expected_numbers(lengths, response.joint_positions), 1e-7)
    if lengths == [1.0] * 3:
        assert response.z == pytest.approx(0.178, abs=5e-4)
        assert np.abs(np.degrees(response.joint_positions)) == pytest.approx(
            [0.0, 81.8, 155.2], abs=0.05)
    for other in response.alternatives:
        expected = expected_numbers(lengths, other.joint_positions)
        assert (other.z, other.margin) == pytest.approx(
            (expected.z, expected.margin), abs=1e-7)
    assert bench.get('link_lengths') == LENGTHS
    assert_numbers(bench.cycle(REGULAR)[0], expected_numbers(LENGTHS, REGULAR))


@needs_interfaces
@pytest.mark.parametrize('lower, upper', [
    ([-1.0, 0.0, 0.0], [1.0, 1.0, 1.0]), ([0.2, -math.inf, -3.0], [0.3, 0.0, math.inf]),
    ([], [0.0, 0.0, 0.0]), ([0.5, 0.5, 0.5], [])])
def test_limits_of_the_request(bench, lower, upper):
    response = solve(bench, link_lengths=LENGTHS, joint_lower=lower, joint_upper=upper)
    assert response.success, response.message
    positions = np.array(response.joint_positions)
    assert (positions >= np.array(lower or [-math.inf] * 3) - 1e-9).all()
    assert (positions <= np.array(upper or [math.inf] * 3) + 1e-9).all()
    assert response.z == pytest.approx(expected_numbers(LENGTHS, positions).z, abs=1e-9)


@needs_interfaces
@pytest.mark.parametrize('side', [1.0, -1.0])
def test_reference_of_the_request_and_of_the_arm(bench, side):
    near = [0.7, side * ISOTROPIC[1], side * ISOTROPIC[2]]
    response = solve(bench, link_lengths=LENGTHS, reference=[0.7, side * 1.8, side * 2.9])
    assert response.joint_positions == pytest.approx(near, abs=1e-5)
    # Without one the arm's present posture is taken, where it has as many joints.
    bench.cycle([0.7, side * 1.8, side * 2.9])
    for lengths in ([], LENGTHS):
        response = solve(bench, link_lengths=lengths)
        assert response.joint_positions == pytest.approx(near, abs=1e-5)
    response = solve(bench, link_lengths=[1.0] * 4)
    assert response.success and len(response.joint_positions) == 4


@needs_interfaces
def test_present_posture_of_a_turned_arm_in_the_coordinates_of_the_model(make_bench):
    bench = make_bench({'joint_directions': [-1, -1, -1]})
    bench.cycle([0.7, 1.8, 2.9])
    response = solve(bench, link_lengths=LENGTHS)
    assert response.joint_positions == pytest.approx(
        [-0.7, -ISOTROPIC[1], -ISOTROPIC[2]], abs=1e-5)


BAD = {
    'one link': (dict(link_lengths=[1.0]), 'link_lengths', '1'),
    'two links': (dict(link_lengths=[1.0, 1.0]), 'link_lengths', '2'),
    'too many': (dict(link_lengths=[1.0] * 100000), 'link_lengths', '100000'),
    'nan': (dict(link_lengths=[1.0, math.nan, 1.0]), 'link_lengths[1]', 'nan'),
    'inf': (dict(link_lengths=[1.0, 1.0, math.inf]), 'link_lengths[2]', 'inf'),
    'negative': (dict(link_lengths=[1.0, -2.5, 1.0]), 'link_lengths[1]', '-2.5'),
    'zero': (dict(link_lengths=[0.0, 1.0, 1.0]), 'link_lengths[0]', '0.0'),
    'size of lower': (dict(link_lengths=LENGTHS, joint_lower=[0.0]), 'joint_lower', '1'),
    'size of upper': (dict(link_lengths=LENGTHS, joint_upper=[0.0] * 4), 'joint_upper', '4'),
    'size of reference': (dict(link_lengths=LENGTHS, reference=[0.0] * 2), 'reference', '2'),
    'size for the arm': (dict(joint_lower=[0.0] * 5), 'joint_lower', '5'),
    'crossed': (dict(link_lengths=LENGTHS, joint_lower=[0.0, 1.5, 0.0],
                     joint_upper=[1.0, 0.5, 1.0]), 'joint_lower[1]', '1.5'),
    'crossed with the arm': (dict(joint_lower=[0.0, 7.5, 0.0]), 'joint_lower[1]', '7.5'),
    'nan limit': (dict(link_lengths=LENGTHS, joint_upper=[1.0, 1.0, math.nan]),
                  'joint_upper[2]', 'nan'),
    'infinite lower': (dict(link_lengths=LENGTHS, joint_lower=[math.inf, 0.0, 0.0]),
                       'joint_lower[0]', 'inf'),
    'infinite upper': (dict(link_lengths=LENGTHS, joint_upper=[1.0, -math.inf, 0.0]),
                       'joint_upper[1]', '-inf'),
    'nan reference': (dict(link_lengths=LENGTHS, reference=[math.nan, 0.0, 0.0]),
                      'reference[0]', 'nan'),
    'infinite reference': (dict(reference=[0.0, 0.0, -math.inf]), 'reference[2]', '-inf'),
}


@needs_interfaces
@pytest.mark.parametrize('case', BAD)
def test_bad_request_names_field_value_and_rule(make_bench, case):
    request, field, value = BAD[case]
    bench = make_bench({'joint_lower': [-7.0] * 3, 'joint_upper': [7.0] * 3})
    response = solve(bench, **request)
    assert response.success is False
    assert field in response.message and value in response.message, response.message
    assert any(word in response.message for word in ('must', 'at least', 'at most'))
    assert list(response.joint_positions) == [] and list(response.alternatives) == []
    for number in (response.z, response.characteristic_length, response.margin):
        assert math.isnan(number)
    assert response.isotropic is False
    assert solve(bench).success


@needs_interfaces
@pytest.mark.parametrize('request_', [dict(link_lengths=[1.0, 1.0]),
                                      dict(link_lengths=[1.0] * 1000),
                                      dict(reference=[math.nan] * 3)],
                         ids=['short', 'long', 'nan'])
def test_bad_request_is_answered_within_10_ms(bench, request_):
    client = bench.peer.create_client(
        SolveOptimalPosture, f'{bench.name}/solve_optimal_posture')
    bench.wait(client.service_is_ready, 'the service')
    times = []
    for _ in range(20):
        start = time.monotonic()
        future = client.call_async(SolveOptimalPosture.Request(**request_))
        bench.wait(future.done, 'an answer')
        times.append(time.monotonic() - start)
        assert not future.result().success
    assert statistics.median(times) < 0.010


# --- the state ------------------------------------------------------------------------------


@needs_interfaces
def test_every_field_of_the_state(make_bench):
    directions, offsets = [1, -1, 1], [0.3, 0.0, -0.2]
    bench = make_bench({'joint_directions': directions, 'joint_offsets': offsets})
    heard = listen(bench)
    message = JointState(name=[*NAMES[::-1], 'gripper'], position=[2.0, -1.5, 0.3, 9.0],
                         velocity=[0.3, -0.2, 0.1, math.nan])
    message.header.stamp.sec, message.header.stamp.nanosec = 1234, 567
    message.header.frame_id = 'cell'
    bench.publisher.publish(message)
    bench.wait(lambda: heard, 'a state')
    state = heard[0]
    positions = np.array([0.3, -1.5, 2.0])

    def numbers_at(values):
        return expected_numbers(LENGTHS, np.array(directions) * values + offsets)

    assert state.header == message.header
    assert_numbers((state.z, state.conditioning_length, state.margin), numbers_at(positions))
    assert state.near_singularity is False
    assert (state.level, state.message) == (KinetostaticState.OK, 'clear of singularities')
    assert list(state.joint_names) == NAMES
    assert list(state.joint_positions) == positions.tolist()
    z_slope = approx_fprime(positions, lambda q: numbers_at(q).z, 1e-7)
    margin_slope = approx_fprime(positions, lambda q: numbers_at(q).margin, 1e-7)
    rates = [0.1, -0.2, 0.3]
    np.testing.assert_allclose(state.gradient, z_slope, atol=1e-5)
    assert state.z_rate == pytest.approx(z_slope @ rates, abs=1e-5)
    assert state.margin_rate == pytest.approx(margin_slope @ rates, abs=1e-5)
    approaching = state.z_rate > 0.0 or state.margin_rate < 0.0
    assert (state.trend == KinetostaticState.TREND_APPROACHING) == approaching
    assert math.isnan(state.time_to_threshold) != approaching


@needs_interfaces
def test_one_state_per_cycle_with_its_stamp(bench):
    heard = listen(bench)
    for i in range(20):
        state = state_of(bench, heard, [0.0, 0.1 * i, 1.0], stamp=(5, i))
        assert state.header.stamp.nanosec == i
        assert list(state.joint_positions) == [0.0, 0.1 * i, 1.0]
        assert state.near_singularity == bench.cycles[-1][1]
    bench.linger(0.05)
    assert len(heard) == len(bench.cycles) == 20


@needs_interfaces
def test_state_near_a_singularity(bench):
    heard = listen(bench)
    state = state_of(bench, heard, STRETCHED)
    assert state.level == KinetostaticState.WARN
    assert state.near_singularity is True
    assert 'margin' in state.message
    assert state.margin == pytest.approx(0.0, abs=1e-9)
    assert all(map(math.isfinite, state.gradient)) and len(state.gradient) == 3


def assert_unknown_state(state, level):
    assert state.level == level
    assert state.near_singularity is True
    for number in (state.z, state.conditioning_length, state.margin, state.z_rate,
                   state.margin_rate, state.time_to_threshold):
        assert math.isnan(number)
    assert list(state.joint_names) == NAMES
    assert list(state.joint_positions) == [] and list(state.gradient) == []
    assert state.trend == KinetostaticState.TREND_UNKNOWN


@needs_interfaces
def test_state_of_a_bad_message(bench):
    heard = listen(bench)
    state_of(bench, heard, REGULAR, stamp=(7, 1))
    state = state_of(bench, heard, [0.0, math.nan, 0.0], stamp=(7, 2))
    assert_unknown_state(state, KinetostaticState.ERROR)
    assert 'elbow' in state.message
    assert state.header.stamp.nanosec == 2


@needs_interfaces
def test_state_of_silence(make_bench):
    bench = make_bench({'stale_timeout': 0.1})
    heard = listen(bench)
    bench.send(REGULAR, stamp=(8, 3))
    bench.wait(lambda: any(s.level == KinetostaticState.OK for s in heard), 'a good state')
    bench.wait(lambda: heard[-1].level == KinetostaticState.STALE, 'a stale state')
    assert_unknown_state(heard[-1], KinetostaticState.STALE)
    assert heard[-1].header.stamp.nanosec == 3
    assert all(name in heard[-1].message for name in NAMES)


@needs_interfaces
def test_state_only_when_somebody_subscribes(bench, monkeypatch):
    published = []
    publisher = state_publisher(bench)
    publish = publisher.publish
    monkeypatch.setattr(publisher, 'publish', lambda m: (published.append(m), publish(m)))
    for _ in range(3):
        bench.cycle(REGULAR)
    assert published == []
    heard = listen(bench)
    state_of(bench, heard, REGULAR)
    assert len(published) == 1


# --- without the package --------------------------------------------------------------------

WITHOUT = '''
import sys

class Block:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] == 'kinopt_interfaces':
            raise ImportError('No module named kinopt_interfaces (blocked)')

sys.meta_path.insert(0, Block())
sys.path.insert(0, {folder!r})
import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger
from support import Bench, expected_numbers, LENGTHS, REGULAR
context = rclpy.Context()
rclpy.init(args=[], context=context)
bench = Bench(context, SingleThreadedExecutor(context=context))
numbers, flag = bench.cycle(REGULAR)
assert abs(numbers.z - expected_numbers(LENGTHS, REGULAR).z) < 1e-9 and flag is False
assert bench.call(Trigger, 'get_optimal_posture').success
bench.wait(lambda: bench.diagnostics, 'diagnostics')
assert bench.set(link_lengths=[1.0, 1.0, 1.0])[0].successful
bench.cycle(REGULAR)
bench.linger(0.2)
names = [name for name, _ in bench.peer.get_service_names_and_types()]
names += [name for name, _ in bench.peer.get_topic_names_and_types()]
assert '/singularity_monitor/get_optimal_posture' in names
assert '/singularity_monitor/state' not in names
assert '/singularity_monitor/solve_optimal_posture' not in names
bench.close()
context.try_shutdown()
'''


def test_node_without_the_package_says_so_once_and_works():
    folder = str(Path(__file__).parent.parent)
    done = subprocess.run([sys.executable, '-c', WITHOUT.format(folder=folder)],
                          capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    line, = (line for line in done.stderr.splitlines() if 'kinopt_interfaces' in line)
    assert line.startswith('[INFO]')
    for words in ('~/state', '~/solve_optimal_posture', 'colcon build'):
        assert words in line
