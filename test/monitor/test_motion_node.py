"""Gradient, trend and a flag without chatter, on the node's topics."""

import math

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from support import expected_numbers, ISOTROPIC, LENGTHS, NAMES, REGULAR, STRETCHED

from kinopt_ros.monitor import configuration

LENGTHS_5 = [0.6, 0.5, 0.3, 0.4, 0.2]
NAMES_5 = ['a', 'b', 'c', 'd', 'e']
QUIET = {'diagnostics_period': 3600.0}
EACH_CYCLE = {'diagnostics_period': 0.0}


def listen(bench, kind=Float64MultiArray, topic='gradient'):
    """Subscribe to a topic of the monitor; give the list of what is heard."""
    heard = []
    bench.peer.create_subscription(kind, f'{bench.name}/{topic}', heard.append, 100)
    publisher, = (p for p in bench.monitor.publishers
                  if p.topic_name == f'{bench.name}/{topic}')
    bench.wait(lambda: publisher.get_subscription_count() > 0, f'discovery of {topic}')
    return heard


def cycle(bench, positions, names=NAMES, velocity=(), stamp=(0, 0)):
    """Publish a posture with its velocities and give the cycle that answers it."""
    count = len(bench.cycles)
    message = JointState(name=list(names), position=[float(p) for p in positions],
                         velocity=list(velocity))
    message.header.stamp.sec, message.header.stamp.nanosec = stamp
    bench.publisher.publish(message)
    return bench.next_cycle(count)


def answer(bench, heard, positions, names=NAMES, **options):
    """Publish a posture; give what is heard of it."""
    count = len(heard)
    cycle(bench, positions, names, **options)
    bench.wait(lambda: len(heard) > count, 'the topic')
    return heard[count]


def differences(number, link_lengths, positions, directions, offsets, h=1e-5):
    """Central differences of the independent number by measured positions."""
    def value(measured):
        angles = np.array(directions) * measured + offsets
        return getattr(expected_numbers(link_lengths, angles), number)
    steps = h * np.eye(len(positions))
    return [(value(positions + step) - value(positions - step)) / (2.0 * h) for step in steps]


def test_gradient_is_by_measured_coordinates(make_bench):
    rng = np.random.default_rng(7)
    directions, offsets = [1, -1, -1, 1, -1], [0.1, 0.7, -0.4, 2.0, -1.0]
    bench = make_bench({'joint_names': NAMES_5, 'link_lengths': LENGTHS_5,
                        'joint_directions': directions, 'joint_offsets': offsets, **QUIET})
    heard = listen(bench)
    for _ in range(10):
        positions = rng.uniform(-3.0, 3.0, 5)
        message = answer(bench, heard, positions, NAMES_5)
        expected = differences('z', LENGTHS_5, positions, directions, offsets)
        scale = np.abs(expected).max()
        np.testing.assert_allclose(message.data, expected, rtol=1e-7, atol=1e-7 * scale)
        assert message.data[0] == 0.0


def test_gradient_is_in_the_order_of_the_parameter_not_of_the_message(make_bench):
    bench = make_bench(QUIET)
    heard = listen(bench)
    first = answer(bench, heard, REGULAR)
    second = answer(bench, heard, REGULAR[::-1], NAMES[::-1])
    assert first.data == second.data
    assert first.data[1] != first.data[2]


def test_gradient_has_a_labelled_dimension(make_bench):
    bench = make_bench(QUIET)
    message = answer(bench, listen(bench), REGULAR)
    dimension, = message.layout.dim
    assert '1/rad' in dimension.label and 'dz/dtheta' in dimension.label
    assert (dimension.size, dimension.stride) == (3, 3)
    assert message.layout.data_offset == 0


def test_step_against_the_gradient_lowers_z(make_bench):
    bench = make_bench({'joint_directions': [1, -1, 1], **QUIET})
    heard = listen(bench)
    gradient = np.array(answer(bench, heard, REGULAR).data)
    z = bench.cycles[-1][0].z
    numbers, _ = bench.cycle(np.array(REGULAR) - 0.01 * gradient)
    assert z - numbers.z == pytest.approx(0.01 * gradient @ gradient, rel=0.05)


@pytest.mark.parametrize('positions', [
    STRETCHED, [0.0, 0.0, 0.0], [0.0, math.pi, 0.0], [0.0, math.pi, math.pi],
    [1.0, 2.0 * math.pi, -2.0]])
def test_gradient_on_the_singular_set_leads_away_from_it(make_bench, positions):
    bench = make_bench(QUIET)
    gradient = np.array(answer(bench, listen(bench), positions).data)
    assert np.all(np.isfinite(gradient)) and len(gradient) == 3
    numbers, _ = bench.cycle(positions)
    after, _ = bench.cycle(np.array(positions) - 1e-4 * gradient / np.linalg.norm(gradient))
    assert after.z < numbers.z
    assert after.margin > numbers.margin == pytest.approx(0.0, abs=1e-12)


def test_gradient_of_a_given_model_set(make_bench):
    """Against one set z is another function, and so is its gradient."""
    bench = make_bench({'model_set': 'polygon', **QUIET})
    heard = listen(bench)
    positions = [0.3, -1.0, 1.4]
    gradient = answer(bench, heard, positions).data
    z = []
    for joint, step in [(1, 1e-4), (1, -1e-4), (2, 1e-4), (2, -1e-4)]:
        posture = list(positions)
        posture[joint] += step
        z.append(bench.cycle(posture)[0].z)
    assert gradient[0] == 0.0
    assert gradient[1] == pytest.approx((z[0] - z[1]) / 2e-4, abs=1e-7)
    assert gradient[2] == pytest.approx((z[2] - z[3]) / 2e-4, abs=1e-7)
    closest = differences('z', LENGTHS, np.array(positions), [1] * 3, [0.0] * 3)
    assert not np.allclose(gradient, closest, atol=1e-3)


@pytest.fixture
def calls(monkeypatch):
    """Count the computations of a gradient."""
    counted = []
    computed = configuration.index_gradient

    def count(*arguments):
        counted.append(arguments)
        return computed(*arguments)

    monkeypatch.setattr(configuration, 'index_gradient', count)
    return counted


def test_nothing_is_computed_without_subscribers(make_bench, calls):
    bench = make_bench(QUIET)
    for i in range(20):
        bench.cycle([0.1 * i, *REGULAR[1:]])
    assert calls == []
    heard = listen(bench)
    for i in range(5):
        answer(bench, heard, [0.1 * i, *REGULAR[1:]])
    assert len(calls) == 5


def test_computed_once_for_gradient_and_diagnostics(make_bench, calls):
    bench = make_bench(EACH_CYCLE)
    heard = listen(bench)
    for _ in range(5):
        count = len(bench.diagnostics)
        answer(bench, heard, REGULAR, velocity=[0.0, -1.0, 0.0])
        bench.wait(lambda count=count: len(bench.diagnostics) > count, 'diagnostics')
    assert len(calls) == 5
    assert bench.values['trend'] == 'approaching'


def test_gradient_is_empty_while_the_posture_is_unknown(make_bench):
    bench = make_bench({'stale_timeout': 0.3, **QUIET})
    heard = listen(bench)
    message = answer(bench, heard, [0.0, math.nan, 0.0])
    assert len(message.data) == 0
    assert message.layout.dim[0].size == 0
    assert len(answer(bench, heard, REGULAR).data) == 3
    count = len(heard)
    # Silence does it, too.
    bench.wait(lambda: len(heard) > count, 'the time-out')
    assert len(heard[count].data) == 0


# The elbow stretches; on this path the margin falls to 0 at t = 1.5 s.
def path(t):
    return [0.3, 1.5 - t, 1.0]


RATES = [0.0, -1.0, 0.0]


def rates_of(t, h=1e-5):
    after, before = (expected_numbers(LENGTHS, path(t + s)) for s in (h, -h))
    return (after.z - before.z) / (2 * h), (after.margin - before.margin) / (2 * h)


def diagnosed(bench, positions, **options):
    count = len(bench.diagnostics)
    cycle(bench, positions, **options)
    bench.wait(lambda: len(bench.diagnostics) > count, 'diagnostics')
    return bench.values


def test_trend_and_time_in_the_diagnostics(make_bench):
    bench = make_bench({'z_max': 1.0, **EACH_CYCLE})
    values = diagnosed(bench, path(0.5), velocity=RATES)
    z_rate, margin_rate = rates_of(0.5)
    assert values['trend'] == 'approaching'
    assert float(values['dz/dt (1/s)']) == pytest.approx(z_rate, rel=1e-6)
    assert float(values['d(margin)/dt (1/s)']) == pytest.approx(margin_rate, rel=1e-6)
    numbers = expected_numbers(LENGTHS, path(0.5))
    # To z_max = 1 or to margin_min = 0.05, whichever is first at these rates.
    time = min((1.0 - numbers.z) / z_rate, (numbers.margin - 0.05) / -margin_rate)
    assert float(values['time_to_threshold (s)']) == pytest.approx(time, rel=1e-6)

    values = diagnosed(bench, path(0.5), velocity=[0.0, 1.0, 0.0])
    assert values['trend'] == 'leaving'
    assert values['time_to_threshold (s)'] == 'nan'
    values = diagnosed(bench, path(0.5), velocity=[2.0, 0.0, 0.0])
    assert values['trend'] == 'steady'
    assert float(values['dz/dt (1/s)']) == 0.0
    values = diagnosed(bench, [math.nan] * 3)
    assert values['trend'] == 'unknown'
    assert values['dz/dt (1/s)'] == values['time_to_threshold (s)'] == 'nan'


def test_time_to_threshold_is_0_beyond_it_and_capped_far_from_it(make_bench):
    bench = make_bench({'z_max': 1.0, **EACH_CYCLE})
    values = diagnosed(bench, path(1.49), velocity=RATES)
    assert (values['trend'], values['time_to_threshold (s)']) == ('approaching', '0')
    assert bench.set(margin_min=0.0)[0].successful
    values = diagnosed(bench, path(0.0), velocity=[0.0, -0.008, 0.0])
    assert (values['trend'], values['time_to_threshold (s)']) == ('approaching', '60')


def test_trend_from_stamped_positions_alone(make_bench):
    bench = make_bench({'z_max': 1.0, **EACH_CYCLE})
    for i in range(12):
        t = 0.01 * i
        values = diagnosed(bench, path(t), stamp=(1000, round(1e9 * t)))
    assert values['trend'] == 'approaching'
    # The rates of the joints are exact on this path, hence so are these.
    z_rate, margin_rate = rates_of(0.11)
    assert float(values['dz/dt (1/s)']) == pytest.approx(z_rate, rel=1e-4)
    assert float(values['d(margin)/dt (1/s)']) == pytest.approx(margin_rate, rel=1e-4)


def test_trend_is_unknown_without_velocities_and_stamps(make_bench):
    bench = make_bench(EACH_CYCLE)
    for i in range(12):
        values = diagnosed(bench, path(0.01 * i))
    assert values['trend'] == 'unknown'


def margin_posture(margin):
    """Give the elbow's angle for a margin, by bisection."""
    low, high = 0.0, 1.5
    for _ in range(80):
        middle = 0.5 * (low + high)
        if expected_numbers(LENGTHS, [0.3, middle, 1.0]).margin < margin:
            low = middle
        else:
            high = middle
    return np.array([0.3, high, 1.0])


@pytest.mark.parametrize('parameters', [
    {'hysteresis': 0.1}, {'hysteresis': 0.0, 'min_dwell': 30.0},
    {'hysteresis': 0.1, 'min_dwell': 30.0}], ids=str)
def test_flag_does_not_chatter_at_rest_on_the_threshold(make_bench, parameters):
    """With encoder noise of 1e-4 rad, around the very posture where the flag would rise."""
    rng = np.random.default_rng(1)
    bench = make_bench({'z_max': 1.0, 'margin_min': 0.05, **parameters, **QUIET})
    resting = margin_posture(0.05)
    noisy = rng.normal(resting, 1e-4, (300, 3))
    sides = [expected_numbers(LENGTHS, posture).margin < 0.05 for posture in noisy]
    # The noise alone crosses the threshold again and again.
    assert np.count_nonzero(np.diff(sides)) > 100
    flags = [bench.cycle(posture)[1] for posture in noisy]
    assert np.count_nonzero(np.diff(flags)) <= 1
    assert flags[-1] is True


def test_without_hysteresis_and_dwell_it_would_chatter(make_bench):
    rng = np.random.default_rng(1)
    bench = make_bench({'z_max': 1.0, 'margin_min': 0.05, 'hysteresis': 0.0, **QUIET})
    flags = [bench.cycle(posture)[1]
             for posture in rng.normal(margin_posture(0.05), 1e-4, (100, 3))]
    assert np.count_nonzero(np.diff(flags)) > 20


@pytest.mark.parametrize('parameters', [{}, {'hysteresis': 0.0, 'min_dwell': 30.0}], ids=str)
def test_true_crossing_is_flagged_in_the_same_cycle(make_bench, parameters):
    """At 1 rad/s and 100 Hz, with the noise: the first reading beyond raises the flag."""
    rng = np.random.default_rng(2)
    bench = make_bench({'z_max': 1.0, 'margin_min': 0.05, **parameters, **QUIET})
    for t in np.arange(0.0, 1.5, 0.01):
        posture = rng.normal(path(t), 1e-4)
        beyond = expected_numbers(LENGTHS, posture).margin < 0.05
        numbers, flag = bench.cycle(posture)
        assert flag == beyond, numbers
        if beyond:
            return
    raise AssertionError('the path does not cross')


def test_raised_flag_stays_up_for_min_dwell(make_bench):
    bench = make_bench({'min_dwell': 0.5, 'diagnostics_period': 0.0})
    assert bench.cycle(ISOTROPIC)[1] is False
    assert bench.cycle(STRETCHED)[1] is True
    start = bench.monitor.get_clock().now()
    held = 0
    while bench.cycle(ISOTROPIC)[1]:
        held += 1
        assert 'min_dwell' in bench.status.message or held == 1
    lasted = (bench.monitor.get_clock().now() - start).nanoseconds * 1e-9
    assert held > 1
    # The flag was raised a little before the clock was read.
    assert 0.4 < lasted < 2.0


@pytest.mark.parametrize('value', [-0.1, math.nan, math.inf, 3601.0])
def test_bad_min_dwell_is_refused(bench, value):
    result, = bench.set(min_dwell=value)
    assert not result.successful
    assert 'min_dwell' in result.reason
    assert bench.get('min_dwell') == 0.0


def test_state_carries_gradient_and_motion(make_bench):
    try:
        from kinopt_interfaces.msg import KinetostaticState as kind  # noqa: N813
    except ImportError as error:
        pytest.skip(f'without kinopt_interfaces there is no ~/state ({error})')
    directions = [1, -1, 1]
    bench = make_bench({'z_max': 1.0, 'joint_directions': directions, **QUIET})
    heard = listen(bench, kind, 'state')
    positions = [0.3, -1.0, 1.0]
    state = answer(bench, heard, positions, velocity=[0.0, 1.0, 0.0])
    by_z = differences('z', LENGTHS, np.array(positions), directions, [0.0] * 3)
    by_margin = differences('margin', LENGTHS, np.array(positions), directions, [0.0] * 3)
    np.testing.assert_allclose(state.gradient, by_z, atol=1e-8)
    assert state.z_rate == pytest.approx(by_z[1], abs=1e-8)
    assert state.margin_rate == pytest.approx(by_margin[1], abs=1e-8)
    assert state.trend == kind.TREND_APPROACHING
    assert state.time_to_threshold == pytest.approx(
        min((1.0 - state.z) / by_z[1], (state.margin - 0.05) / -by_margin[1]), rel=1e-6)
    state = answer(bench, heard, positions, velocity=[0.0, -1.0, 0.0])
    assert state.trend == kind.TREND_LEAVING
    assert math.isnan(state.time_to_threshold)
    state = answer(bench, heard, [0.0, math.nan, 0.0])
    assert len(state.gradient) == 0
    assert state.trend == kind.TREND_UNKNOWN
    assert math.isnan(state.z_rate) and math.isnan(state.margin_rate)
