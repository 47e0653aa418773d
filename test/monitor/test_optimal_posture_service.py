"""The optimal posture for others: the Trigger service, the latched topic, the solver's process."""

import json
import math
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from scipy.optimize import minimize
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from support import assert_numbers, DEADLINE, expected_numbers, ISOTROPIC, LENGTHS, NAMES

from kinopt_ros.monitor.singularity_monitor import SingularityMonitor

KEYS = {'joint_names', 'joint_positions', 'link_lengths', 'z', 'characteristic_length', 'margin',
        'isotropic', 'alternatives'}
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                     durability=DurabilityPolicy.TRANSIENT_LOCAL)
MOST_WAITING = 8


def ask(bench):
    """Call the service; give its JSON object."""
    response = bench.call(Trigger, 'get_optimal_posture')
    assert response.success, response.message
    # NaN and Infinity are no JSON.
    return json.loads(response.message, parse_constant=lambda name: pytest.fail(name))


def listen(bench):
    """Give the list of what a late joiner hears on the latched topic."""
    heard = []
    bench.peer.create_subscription(
        JointState, f'{bench.name}/optimal_posture', heard.append, LATCHED)
    return heard


def angles_of(positions, directions=(1, 1, 1), offsets=(0.0, 0.0, 0.0)):
    return np.array(directions) * positions + np.array(offsets)


def least_z(lengths, lower, upper):
    """Find the least z of a three-joint arm in a box of theta_2, theta_3: grid, then polish."""
    def z_at(angles):
        return expected_numbers(lengths, [0.0, *angles]).z

    axes = [np.linspace(lo, hi, 30) for lo, hi in zip(lower, upper)]
    starts = sorted(((a, b) for a in axes[0] for b in axes[1]), key=z_at)[:3]
    bounds = list(zip(lower, upper))
    return min(minimize(z_at, start, bounds=bounds, method='Nelder-Mead',
                        options={'xatol': 1e-9, 'fatol': 1e-12, 'maxiter': 1000}).fun
               for start in starts)


def processes_below(parent):
    """Process ids of the children of a process that run a program of their own (proc(5))."""
    own = command_of(parent)
    pids = [int(entry.name) for entry in Path('/proc').iterdir() if entry.name.isdigit()]
    return [pid for pid in pids if state_and_parent(pid)[1] == parent
            and not has_ended(pid) and command_of(pid) not in (own, b'')]


def command_of(pid):
    try:
        return Path(f'/proc/{pid}/cmdline').read_bytes()
    except OSError:
        return b''


def state_and_parent(pid):
    try:
        fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    except OSError:
        return 'Z', None
    return fields[0], int(fields[1])


def has_ended(pid):
    return state_and_parent(pid)[0] in 'ZX'


def solver_of(bench):
    """Process id of the bench's solver, which has answered its first request."""
    heard = listen(bench)
    bench.wait(lambda: heard, 'the optimum at start')
    pid, = processes_below(os.getpid())
    return pid


needs_proc = pytest.mark.skipif(not Path('/proc/self/stat').exists(), reason='needs /proc')


# --- the answer -----------------------------------------------------------------------------


def test_exactly_the_keys_that_are_promised(bench):
    record = ask(bench)
    assert set(record) == KEYS
    assert record['joint_names'] == NAMES
    assert record['link_lengths'] == LENGTHS
    assert isinstance(record['isotropic'], bool)
    for number in ('z', 'characteristic_length', 'margin'):
        assert isinstance(record[number], float)
    assert len(record['joint_positions']) == 3
    for alternative in record['alternatives']:
        assert set(alternative) == {'joint_positions', 'z'}
        assert len(alternative['joint_positions']) == 3
    ordered = [alternative['z'] for alternative in record['alternatives']]
    assert ordered == sorted(ordered)
    assert all(z >= record['z'] - 1e-9 for z in ordered)


def test_isotropic_arm_of_the_paper(bench):
    record = ask(bench)
    assert record['isotropic'] is True
    assert record['z'] == pytest.approx(0.0, abs=1e-9)
    assert record['characteristic_length'] == pytest.approx(math.sqrt(6.0) / 6.0, abs=1e-7)
    assert record['margin'] == pytest.approx(1.0, abs=1e-6)
    degrees = np.degrees(record['joint_positions'])
    assert degrees[0] == 0.0
    assert np.abs(degrees[1:]) == pytest.approx([120.0, 150.0], abs=1e-3)
    assert degrees[1] * degrees[2] > 0.0
    # The mirror image is the other equally good one.
    mirror = np.degrees(record['alternatives'][0]['joint_positions'])
    assert mirror[1:] == pytest.approx(-degrees[1:], abs=1e-3)


def test_equilateral_arm_of_the_paper(make_bench):
    record = ask(make_bench({'link_lengths': [1.0, 1.0, 1.0]}))
    assert record['isotropic'] is False
    assert record['z'] == pytest.approx(0.178, abs=5e-4)
    assert record['characteristic_length'] == pytest.approx(0.563, abs=5e-4)
    degrees = np.degrees(record['joint_positions'])
    assert np.abs(degrees) == pytest.approx([0.0, 81.8, 155.2], abs=0.05)


@pytest.mark.parametrize('lengths', [
    [1.0, 1e-3, 1.0], [0.425, 0.39225, 0.09465], [0.3, 2.0, 0.7, 0.05, 1.1, 0.4],
    [0.1 + 0.01 * i for i in range(16)]],
    ids=['very uneven', 'UR5', 'six', 'sixteen'])
def test_any_arm_is_answered_with_its_own_numbers(make_bench, lengths):
    names = [f'joint_{i}' for i in range(len(lengths))]
    bench = make_bench({'joint_names': names, 'link_lengths': lengths})
    record = ask(bench)
    assert record['joint_names'] == names
    expected = expected_numbers(lengths, record['joint_positions'])
    assert record['z'] == pytest.approx(expected.z, abs=1e-9)
    numbers, _ = bench.cycle(record['joint_positions'], names)
    assert_numbers(
        numbers, (record['z'], record['characteristic_length'], record['margin']), 1e-7)


DIRECTED = {'link_lengths': [0.7, 0.5, 0.4], 'joint_directions': [-1, 1, -1],
            'joint_offsets': [0.4, -1.1, 2.3]}


def test_positions_are_those_that_a_controller_commands(make_bench):
    bench = make_bench(DIRECTED)
    record = ask(bench)
    best = least_z(DIRECTED['link_lengths'], [-math.pi] * 2, [math.pi] * 2)
    assert record['z'] == pytest.approx(best, abs=1e-7)
    # The arm reaches the promised numbers exactly where the answer sends it.
    numbers, _ = bench.cycle(record['joint_positions'])
    assert_numbers(
        numbers, (record['z'], record['characteristic_length'], record['margin']), 1e-7)
    for alternative in record['alternatives']:
        numbers, _ = bench.cycle(alternative['joint_positions'])
        assert numbers.z == pytest.approx(alternative['z'], abs=1e-7)


@pytest.mark.parametrize('side', [1.0, -1.0])
def test_nearest_to_the_present_posture(bench, side):
    bench.cycle([0.7, side * 1.9, side * 2.9])
    record = ask(bench)
    expected = [0.7, side * ISOTROPIC[1], side * ISOTROPIC[2]]
    assert record['joint_positions'] == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize('side', [1.0, -1.0])
def test_nearest_in_the_coordinates_that_are_measured(make_bench, side):
    bench = make_bench({**DIRECTED, 'link_lengths': LENGTHS})
    directions, offsets = DIRECTED['joint_directions'], np.array(DIRECTED['joint_offsets'])
    angles = np.array([0.7, side * ISOTROPIC[1], side * ISOTROPIC[2]])
    positions = directions * (angles - offsets)
    bench.cycle(positions + [0.0, 0.2, -0.1])
    assert ask(bench)['joint_positions'] == pytest.approx(positions, abs=1e-5)


# --- limits ---------------------------------------------------------------------------------


@pytest.mark.parametrize('lower, upper', [
    ([-3.0, -1.0, -1.0], [3.0, 1.0, 1.0]),
    ([-3.0, -0.5, 0.5], [3.0, 2.0, 1.5]),
    ([1.0, 0.3, -3.0], [1.2, 0.3, 3.0]),
    ([-9.0, -2.5, 2.0], [9.0, -0.5, 3.0]),
])
def test_optimum_within_the_limits_and_on_their_boundary(make_bench, lower, upper):
    bench = make_bench({'joint_lower': lower, 'joint_upper': upper})
    record = ask(bench)
    positions = np.array(record['joint_positions'])
    assert (positions >= np.array(lower) - 1e-9).all(), positions
    assert (positions <= np.array(upper) + 1e-9).all(), positions
    assert record['z'] == pytest.approx(expected_numbers(LENGTHS, positions).z, abs=1e-9)
    assert record['z'] == pytest.approx(least_z(LENGTHS, lower[1:], upper[1:]), abs=1e-6)
    assert np.isclose(positions[1:], lower[1:]).any() or np.isclose(positions[1:], upper[1:]).any()


def test_limits_are_those_of_the_measured_positions(make_bench):
    lower, upper = [-1.0, 0.2, -3.0], [1.0, 1.2, -1.5]
    bench = make_bench({**DIRECTED, 'joint_lower': lower, 'joint_upper': upper})
    record = ask(bench)
    positions = np.array(record['joint_positions'])
    assert (positions >= np.array(lower) - 1e-9).all(), positions
    assert (positions <= np.array(upper) + 1e-9).all(), positions
    directions, offsets = DIRECTED['joint_directions'], DIRECTED['joint_offsets']
    ends = np.sort([angles_of(lower, directions, offsets), angles_of(upper, directions, offsets)],
                   axis=0)
    assert record['z'] == pytest.approx(
        least_z(DIRECTED['link_lengths'], ends[0, 1:], ends[1, 1:]), abs=1e-6)


def test_posture_outside_the_limits_is_no_obstacle(make_bench):
    bench = make_bench({'joint_lower': [-1.0, 0.0, 0.0], 'joint_upper': [1.0, 1.0, 1.0]})
    bench.cycle([2.0, -2.0, 3.0])
    positions = np.array(ask(bench)['joint_positions'])
    assert (positions >= -1e-9).all() and (positions <= 1.0 + 1e-9).all()
    # The first joint stays as near as it may.
    assert positions[0] == pytest.approx(1.0)


# --- the latched topic ----------------------------------------------------------------------


def test_latched_topic_holds_the_optimum_for_late_joiners(bench):
    first = listen(bench)
    bench.wait(lambda: first, 'the optimum at start')
    late = listen(bench)
    bench.wait(lambda: late, 'the optimum for a late joiner')
    message = late[0]
    assert list(message.name) == NAMES
    assert message.position.tolist() == pytest.approx(ask(bench)['joint_positions'], abs=1e-9)
    assert (len(message.velocity), len(message.effort)) == (0, 0)
    assert message.header.stamp.sec > 0
    assert first == [message]


def test_quality_of_service_of_the_latched_topic(bench):
    info, = bench.peer.get_publishers_info_by_topic(f'{bench.name}/optimal_posture')
    assert info.topic_type == 'sensor_msgs/msg/JointState'
    assert info.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert info.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    own, = (p for p in bench.monitor.publishers if p.topic_name.endswith('/optimal_posture'))
    assert own.qos_profile.depth == 1


def test_service_and_topic_follow_the_parameters(bench):
    heard = listen(bench)
    bench.wait(lambda: heard, 'the optimum at start')
    state = {'link_lengths': LENGTHS, 'joint_directions': [1, 1, 1],
             'joint_offsets': [0.0, 0.0, 0.0], 'joint_lower': [-math.inf] * 3,
             'joint_upper': [math.inf] * 3}
    for change in ({'link_lengths': [1.0, 1.0, 1.0]},
                   {'joint_directions': [1, -1, -1]},
                   {'joint_offsets': [0.1, 0.6, -0.4]},
                   {'joint_upper': [3.0, 0.5, 0.5]},
                   {'joint_lower': [-3.0, -0.5, -0.5]}):
        state.update(change)
        count = len(heard)
        result, = bench.set(**change)
        assert result.successful, result.reason
        bench.wait(lambda count=count: len(heard) > count, f'an announcement after {change}')
        positions = heard[-1].position
        record = ask(bench)
        assert record['link_lengths'] == state['link_lengths']
        assert record['joint_positions'] == pytest.approx(positions.tolist(), abs=1e-7)
        assert (positions >= np.array(state['joint_lower']) - 1e-9).all()
        assert (positions <= np.array(state['joint_upper']) + 1e-9).all()
        angles = angles_of(positions, state['joint_directions'], state['joint_offsets'])
        assert record['z'] == pytest.approx(
            expected_numbers(state['link_lengths'], angles).z, abs=1e-9)
    box = np.sort([angles_of(state[end], state['joint_directions'], state['joint_offsets'])
                   for end in ('joint_lower', 'joint_upper')], axis=0)
    assert record['z'] == pytest.approx(least_z([1.0] * 3, box[0, 1:], box[1, 1:]), abs=1e-6)


def test_nothing_is_announced_when_nothing_of_the_arm_changes(bench):
    heard = listen(bench)
    bench.wait(lambda: heard, 'the optimum at start')
    bench.set(z_max=0.8, link_lengths=LENGTHS)
    assert not bench.set(link_lengths=[1.0, -1.0, 1.0])[0].successful
    # A request is answered after whatever was to be announced before it.
    ask(bench)
    bench.linger(0.1)
    assert len(heard) == 1


def test_no_answer_mixes_two_configurations(bench):
    """Requests race with changes of lengths, directions and offsets together."""
    states = [{'link_lengths': [1.0, 1.0, 1.0], 'joint_directions': [1, 1, 1],
               'joint_offsets': [0.0, 0.0, 0.0]},
              {'link_lengths': [0.2, 0.9, 0.5], 'joint_directions': [1, -1, 1],
               'joint_offsets': [0.5, 1.0, -2.0]}]
    heard = listen(bench)
    bench.set_atomically(**states[0])
    client = bench.peer.create_client(Trigger, f'{bench.name}/get_optimal_posture')
    bench.wait(client.service_is_ready, 'the service')
    asked = []

    def count_waiting():
        return sum(not future.done() for future in asked)

    for i in range(30):
        asked += [client.call_async(Trigger.Request()), client.call_async(Trigger.Request())]
        assert bench.set_atomically(**states[(i + 1) % 2]).successful
        bench.wait(lambda: count_waiting() < 3, 'answers')
    bench.wait(lambda: count_waiting() == 0, 'all answers')
    seen = []
    for answer in (a.result() for a in asked):
        assert answer.success, answer.message
        record = json.loads(answer.message)
        state, = (s for s in states if s['link_lengths'] == record['link_lengths'])
        seen.append(states.index(state))
        angles = angles_of(
            record['joint_positions'], state['joint_directions'], state['joint_offsets'])
        expected = expected_numbers(record['link_lengths'], angles)
        assert_numbers((record['z'], record['characteristic_length'], record['margin']),
                       expected, 1e-7)
    assert set(seen) == {0, 1}
    final = ask(bench)
    bench.wait(lambda: np.allclose(heard[-1].position, final['joint_positions'], atol=1e-7),
               'the announcement of the last change')
    # Every announcement belongs whole to one of the configurations, or to the one at start.
    optima = [ask(bench)['z']]
    bench.set_atomically(**states[1])
    optima = [*optima, ask(bench)['z']]
    for message in heard[1:]:
        assert any(
            expected_numbers(s['link_lengths'], angles_of(
                message.position, s['joint_directions'], s['joint_offsets'])).z
            == pytest.approx(z, abs=1e-7) for s, z in zip(states, optima))


# --- the solver's process -------------------------------------------------------------------


@needs_proc
def test_solver_killed_while_idle_is_replaced(bench):
    os.kill(solver_of(bench), signal.SIGKILL)
    answers = [bench.call(Trigger, 'get_optimal_posture') for _ in range(2)]
    for answer in answers:
        assert answer.success, answer.message


@needs_proc
def test_solver_killed_over_a_request(bench):
    pid = solver_of(bench)
    os.kill(pid, signal.SIGSTOP)
    client = bench.peer.create_client(Trigger, f'{bench.name}/get_optimal_posture')
    bench.wait(client.service_is_ready, 'the service')
    asked = client.call_async(Trigger.Request())
    bench.linger(0.1)
    assert not asked.done()
    os.kill(pid, signal.SIGKILL)
    bench.wait(asked.done, 'an answer in spite of the death of the solver')
    assert asked.result().success, asked.result().message
    assert set(ask(bench)) == KEYS
    assert has_ended(pid)


@needs_proc
def test_changed_parameters_are_announced_after_the_death_of_the_solver(bench):
    """The latched topic follows the lengths even when the solver dies over the change."""
    heard = listen(bench)
    pid = solver_of(bench)
    os.kill(pid, signal.SIGSTOP)
    bench.set(link_lengths=[1.0, 1.0, 1.0])
    os.kill(pid, signal.SIGKILL)
    record = ask(bench)
    bench.wait(lambda: np.allclose(heard[-1].position, record['joint_positions'], atol=1e-6),
               'the optimum of the new lengths on the latched topic')


@needs_proc
def test_requests_beyond_eight_are_refused_at_once(bench):
    pid = solver_of(bench)
    os.kill(pid, signal.SIGSTOP)
    try:
        client = bench.peer.create_client(Trigger, f'{bench.name}/get_optimal_posture')
        bench.wait(client.service_is_ready, 'the service')
        asked = []
        for _ in range(MOST_WAITING + 3):
            asked.append(client.call_async(Trigger.Request()))
            bench.linger(0.01)
        bench.wait(lambda: sum(a.done() for a in asked) >= 3, 'refusals while the solver hangs')
        for refused in asked[MOST_WAITING:]:
            assert refused.result().success is False
            assert 'busy' in refused.result().message
        assert not any(a.done() for a in asked[:MOST_WAITING])
        # The monitor goes on meanwhile, and so do its parameters.
        numbers, _ = bench.cycle(ISOTROPIC)
        assert_numbers(numbers, expected_numbers(LENGTHS, ISOTROPIC))
        assert bench.set(z_max=0.7)[0].successful
    finally:
        os.kill(pid, signal.SIGCONT)
    bench.wait(lambda: all(a.done() for a in asked), 'the answers of those that waited')
    assert all(a.result().success for a in asked[:MOST_WAITING])
    assert set(ask(bench)) == KEYS


@needs_proc
@pytest.mark.parametrize('stopped', [False, True], ids=['idle', 'working'])
def test_solver_ends_with_the_node(context, executor, stopped):
    before = set(processes_below(os.getpid()))
    node = SingularityMonitor(context=context, parameter_overrides=[
        Parameter('joint_names', value=NAMES), Parameter('link_lengths', value=LENGTHS)])
    executor.add_node(node)
    deadline = time.monotonic() + DEADLINE
    while not (started := set(processes_below(os.getpid())) - before):
        assert time.monotonic() < deadline, 'the solver has not started'
        executor.spin_once(timeout_sec=0.01)
    pid, = started
    if stopped:
        os.kill(pid, signal.SIGSTOP)
    executor.remove_node(node)
    node.destroy_node()
    assert not Path(f'/proc/{pid}').exists(), 'left running, or not waited for'


RUN = 'import sys; from kinopt_ros.executables import singularity_monitor as m; sys.exit(m())'
ARM = ['-p', f'joint_names:=[{", ".join(NAMES)}]',
       '-p', f'link_lengths:=[{", ".join(map(repr, LENGTHS))}]']


@pytest.fixture
def process():
    """Give the node as a process of its own, killed with the test."""
    process = subprocess.Popen([sys.executable, '-c', RUN, '--ros-args', *ARM])
    yield process
    process.kill()
    process.wait()


def until(condition, what):
    deadline = time.monotonic() + DEADLINE
    while not condition():
        assert time.monotonic() < deadline, f'nothing of this within {DEADLINE} s: {what}'
        time.sleep(0.01)


@needs_proc
@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_no_orphan_whatever_ends_the_node(process, number):
    until(lambda: processes_below(process.pid), 'the solver of the process')
    solver, = processes_below(process.pid)
    process.send_signal(number)
    assert process.wait(timeout=DEADLINE) == (-number if number == signal.SIGKILL else 0)
    until(lambda: has_ended(solver), 'the end of the solver')


def test_no_cycle_is_lost_while_the_service_is_called_in_a_loop(make_bench, request):
    """500 Hz for 2 s with many ms of solving back to back, none of it in the cycle's thread."""
    if request.config.getoption('--executor') == 'multi':
        pytest.skip('the MultiThreadedExecutor of rclpy does not reach 500 Hz on the bench')
    n = 12
    names = [f'joint_{i}' for i in range(n)]
    bench = make_bench({'joint_names': names, 'link_lengths': [1.0 + 0.1 * i for i in range(n)]})
    client = bench.peer.create_client(Trigger, f'{bench.name}/get_optimal_posture')
    bench.wait(client.service_is_ready, 'the service')
    answers, stalls, sent = [], 0, 0
    pending = client.call_async(Trigger.Request())
    start = time.monotonic()
    while sent < 1000:
        # A pause of the machine is made up for in bursts that the queue can hold.
        due = time.monotonic() - start >= 0.002 * sent
        if due and sent - min(bench.counts.values()) < 5:
            bench.send([0.001 * sent] * n, names)
            sent += 1
        before = time.thread_time()
        bench.executor.spin_once(timeout_sec=0.0005)
        stalls += time.thread_time() - before > 0.03
        assert time.monotonic() - start < 3.0 * DEADLINE, (
            f'a cycle was lost: {sent} sent, {bench.counts}')
        if pending.done():
            answers.append(pending.result())
            pending = client.call_async(Trigger.Request())
    bench.wait(lambda: min(bench.counts.values()) == sent, 'a cycle for each message')
    assert len(answers) >= 2
    assert all(a.success for a in answers)
    assert stalls < len(answers) / 2, (stalls, len(answers))
