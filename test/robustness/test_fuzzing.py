"""Joint states, parameters and sequences of parameters made up by hypothesis."""

import math

from hypothesis import example, given, HealthCheck, settings, strategies as st
import pytest
from rclpy.parameter import Parameter
from support import expected_numbers, LENGTHS, NAMES, parameter_values

from kinopt_ros.monitor.configuration import Configuration
from kinopt_ros.monitor.parameters import MONITOR_TABLE
from kinopt_ros.monitor.posture_monitor import PostureMonitor
from kinopt_ros.monitor.verdict import Level

PROPERTY = settings(max_examples=150, deadline=None, derandomize=True, database=None,
                    suppress_health_check=[HealthCheck.function_scoped_fixture,
                                           HealthCheck.too_slow])

names = st.sampled_from([*NAMES, *NAMES, 'gripper', ''])
positions = st.one_of(st.floats(), st.floats(-4.0, 4.0), st.floats(-4.0, 4.0))
finite = st.floats(allow_nan=False, allow_infinity=False)
messages = st.one_of(
    st.tuples(st.lists(names, max_size=6), st.lists(positions, max_size=6)),
    st.tuples(st.permutations(NAMES), st.lists(st.floats(-4.0, 4.0), min_size=3, max_size=3)),
    st.tuples(st.just(NAMES), st.lists(finite, min_size=3, max_size=3)))
# Messages, the time until each, and its stamp since the one before.
pauses = st.one_of(st.floats(0.0, 0.2), st.floats(0.0, 1.0))
steps = st.lists(st.tuples(messages, pauses, st.one_of(pauses, st.floats(-1e9, 1e9))), max_size=25)


def configuration(**changes):
    return Configuration.from_parameters(parameter_values(
        **{'joint_names': NAMES, 'link_lengths': LENGTHS, **changes}))


@PROPERTY
@given(steps)
# Found by the soak: the difference of two finite positions is not.
@example([((NAMES, [1.7e308] * 3), 0.0, 0.1), ((NAMES, [-1.7e308] * 3), 0.1, 0.1)])
# Found by hypothesis: a phase that underflows.
@example([((NAMES, [0.0, 5e-324, 0.0]), 0.0, 0.1)])
def test_any_messages_at_any_times(steps):
    """OK only for three finite positions of age below the time-out, and with their numbers."""
    now, stamp = 100.0, 0.0
    monitor = PostureMonitor(configuration(), now)
    received = {}
    for (message_names, message_positions), pause, since in steps:
        now, stamp = now + pause, stamp + since
        monitor.on_time(now)
        verdict = monitor.on_joint_state(
            list(message_names), message_positions, now, stamp=stamp)
        motion = monitor.motion()
        assert not math.isinf(motion.z_rate) and not math.isinf(motion.margin_rate)
        sound = len(message_names) == len(message_positions)
        for name in NAMES:
            if name in message_names:
                place = list(message_names).index(name)
                believable = (sound and list(message_names).count(name) == 1
                              and math.isfinite(message_positions[place]))
                received[name] = (message_positions[place], now) if believable else None
        if verdict is None or verdict.level not in (Level.OK, Level.WARN):
            assert monitor.verdict.level not in (Level.OK, Level.WARN) or verdict is None
            continue
        assert all(received.get(name) for name in NAMES)
        assert all(now - time <= 0.5 for _, time in received.values())
        posture = [position for position, _ in (received[name] for name in NAMES)]
        assert list(monitor.positions) == posture
        index = verdict.index
        assert all(map(math.isfinite, index)) and index.margin <= 1.0 - index.z + 1e-12
        if max(map(abs, posture)) < 100.0:
            assert index.z == pytest.approx(expected_numbers(LENGTHS, posture).z, abs=1e-7)
        crossed = index.z > 0.9 or index.margin < 0.05
        assert verdict.near_singularity or not crossed


anything = st.one_of(
    st.floats(), st.floats(0.0, 1.0), st.sampled_from([-1.0, 0.0, 1.0, math.nan, math.inf]))
triples = st.lists(st.one_of(anything, st.floats(0.1, 2.0)), max_size=4)
values = {
    'z_max': anything, 'margin_min': anything, 'hysteresis': anything, 'min_dwell': anything,
    'stale_timeout': anything, 'diagnostics_period': anything, 'marker_rate': anything,
    'link_lengths': st.one_of(triples, st.lists(st.floats(0.1, 2.0), min_size=3, max_size=3)),
    'joint_offsets': triples, 'joint_lower': triples, 'joint_upper': triples,
    'joint_directions': st.lists(st.sampled_from([1, -1, 1, -1, 0, 2]), max_size=4),
    'model_set': st.sampled_from(['closest', 'polygon', 'Polygon', '']),
    'model_numbering': st.lists(st.integers(-1, 3), max_size=4),
    'model_mirror': st.booleans(), 'base_frame': st.text(max_size=5),
}
changes = st.lists(st.sampled_from(sorted(values)), max_size=4, unique=True).flatmap(
    lambda chosen: st.fixed_dictionaries({name: values[name] for name in chosen}))


@PROPERTY
@given(changes)
def test_any_parameters_are_judged_or_refused_by_name(changed):
    """A ValueError that names a parameter, or a configuration that works; nothing else."""
    try:
        made = configuration(**changed)
    except ValueError as error:
        assert any(row.name in str(error) for row in MONITOR_TABLE)
        return
    monitor = PostureMonitor(made, 0.0)
    verdict = monitor.on_joint_state(NAMES, [0.3, 1.5, 2.0], 0.0)
    assert all(map(math.isfinite, verdict.index))
    assert 0.0 <= verdict.index.z <= 1.0 or changed.get('model_set') == 'polygon'


@pytest.fixture
def monitor(make_bench):
    return make_bench({'diagnostics_period': 0.0}).monitor


def parameter(name, value):
    return Parameter(name, value=value) if value not in ((), []) else Parameter(
        name, Parameter.Type.INTEGER_ARRAY if name in ('joint_directions', 'model_numbering')
        else Parameter.Type.DOUBLE_ARRAY, value)


@settings(PROPERTY, max_examples=40)
@given(sequence=st.lists(changes, max_size=8))
def test_any_sequence_of_parameters_leaves_the_node_at_work(monitor, sequence):
    """A refused change changes nothing; the configuration always is what the parameters say."""
    for changed in sequence:
        before = state(monitor)
        result = monitor.set_parameters_atomically(
            [parameter(name, value) for name, value in changed.items()])
        after = state(monitor)
        if result.successful:
            for name, value in changed.items():
                assert same(after[name], value), name
        else:
            assert result.reason
            assert all(same(after[name], before[name]) for name in before)
        arm = monitor._settings.configuration.arm
        assert list(arm.planar_arm.link_lengths) == list(after['link_lengths'])
        assert monitor._settings.configuration.thresholds.margin_min == after['margin_min']
        assert monitor._settings.configuration is monitor._monitor.configuration


def state(monitor):
    return {name: monitor.get_parameter_or(name).value for name in values}


def same(one, other):
    if isinstance(one, str | bool) or one is None or other is None:
        return one == other or (one in (None, []) and other in (None, []))
    if hasattr(one, '__len__') or hasattr(other, '__len__'):
        return len(one) == len(other) and all(map(same, one, other))
    return one == other or (math.isnan(one) and math.isnan(other))
