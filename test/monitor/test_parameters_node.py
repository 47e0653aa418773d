"""The node's parameters: defaults, descriptors, refusals at start and at run time, atomicity."""

import math

import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage, ParameterType, ParameterValue
from rclpy.parameter import Parameter
from support import assert_numbers, expected_numbers, ISOTROPIC, LENGTHS, NAMES, REGULAR

TYPES = {
    'joint_names': ParameterType.PARAMETER_STRING_ARRAY,
    'link_lengths': ParameterType.PARAMETER_DOUBLE_ARRAY,
    'joint_offsets': ParameterType.PARAMETER_DOUBLE_ARRAY,
    'joint_directions': ParameterType.PARAMETER_INTEGER_ARRAY,
    'z_max': ParameterType.PARAMETER_DOUBLE,
    'margin_min': ParameterType.PARAMETER_DOUBLE,
    'hysteresis': ParameterType.PARAMETER_DOUBLE,
    'stale_timeout': ParameterType.PARAMETER_DOUBLE,
    'diagnostics_period': ParameterType.PARAMETER_DOUBLE,
    'hardware_id': ParameterType.PARAMETER_STRING,
}
DEFAULTS = {
    'joint_offsets': [0.0, 0.0, 0.0],
    'joint_directions': [1, 1, 1],
    'z_max': 0.9,
    'margin_min': 0.05,
    'hysteresis': 0.1,
    'stale_timeout': 0.5,
    'diagnostics_period': 1.0,
    'hardware_id': 'singularity_monitor',
}
# What is changed, and words that the reason must hold: the name, and the value or the rule.
BAD_NUMBERS = [
    ({'link_lengths': [1.0, 1.0]}, ['link_lengths', '3']),
    ({'link_lengths': [1.0, 1.0, 1.0, 1.0]}, ['link_lengths', '3']),
    ({'link_lengths': [1.0, 0.0, 1.0]}, ['link_lengths', '0.0', 'positive']),
    ({'link_lengths': [1.0, -2.5, 1.0]}, ['link_lengths', '-2.5', 'positive']),
    ({'link_lengths': [1.0, math.nan, 1.0]}, ['link_lengths', 'nan', 'finite']),
    ({'link_lengths': [1.0, math.inf, 1.0]}, ['link_lengths', 'inf', 'finite']),
    ({'link_lengths': [1.0, -math.inf, 1.0]}, ['link_lengths', '-inf', 'finite']),
    ({'joint_offsets': [0.0, 0.0]}, ['joint_offsets', '3']),
    ({'joint_offsets': [0.0, math.nan, 0.0]}, ['joint_offsets', 'nan']),
    ({'joint_offsets': [0.0, math.inf, 0.0]}, ['joint_offsets', 'inf']),
    ({'joint_directions': [1, 1]}, ['joint_directions', '3']),
    ({'joint_directions': [1, 0, 1]}, ['joint_directions', '0', '-1']),
    ({'joint_directions': [1, 2, 1]}, ['joint_directions', '2', '-1']),
    ({'z_max': 1.5}, ['z_max', '1.5']),
    ({'z_max': -0.1}, ['z_max', '-0.1']),
    ({'z_max': math.nan}, ['z_max', 'nan']),
    ({'z_max': math.inf}, ['z_max', 'inf']),
    ({'margin_min': 1.5}, ['margin_min', '1.5']),
    ({'margin_min': -0.1}, ['margin_min', '-0.1']),
    ({'margin_min': math.nan}, ['margin_min', 'nan']),
    ({'hysteresis': -0.1}, ['hysteresis', '-0.1']),
    ({'hysteresis': math.nan}, ['hysteresis', 'nan']),
    ({'hysteresis': math.inf}, ['hysteresis', 'inf']),
    ({'stale_timeout': 0.0}, ['stale_timeout', '0']),
    ({'stale_timeout': -1.0}, ['stale_timeout', '-1']),
    ({'stale_timeout': math.nan}, ['stale_timeout', 'nan']),
    ({'stale_timeout': math.inf}, ['stale_timeout', 'inf']),
    ({'diagnostics_period': -1.0}, ['diagnostics_period', '-1']),
    ({'diagnostics_period': math.nan}, ['diagnostics_period', 'nan']),
    ({'diagnostics_period': math.inf}, ['diagnostics_period', 'inf']),
    # A flag that could never clear again.
    ({'margin_min': 0.95}, ['margin_min', '0.95', 'hysteresis']),
    ({'z_max': 0.05}, ['z_max', '0.05', 'hysteresis']),
]
WRONG_TYPES = [
    ({'link_lengths': [1, 1, 1]}, ['link_lengths', '1']),
    ({'link_lengths': 'long'}, ['link_lengths', 'long']),
    ({'joint_offsets': ['a', 'b', 'c']}, ['joint_offsets']),
    ({'joint_directions': [1.0, 1.0, 1.0]}, ['joint_directions', '1.0']),
    ({'z_max': 'high'}, ['z_max', 'high']),
    ({'z_max': 1}, ['z_max', '1']),
    ({'margin_min': True}, ['margin_min', 'True']),
    ({'hysteresis': [0.1]}, ['hysteresis', '0.1']),
    ({'stale_timeout': '1 s'}, ['stale_timeout', '1 s']),
    ({'diagnostics_period': False}, ['diagnostics_period', 'False']),
    ({'hardware_id': 7}, ['hardware_id', '7']),
]
BAD_NAMES = [
    ({'joint_names': ['a', 'b', 'a']}, ['joint_names', "'a'"]),
    ({'joint_names': ['a', 'b'], 'link_lengths': [1.0, 1.0]}, ['joint_names', '3']),
    ({'joint_names': ['a', '', 'c']}, ['joint_names', 'empty']),
    ({'joint_names': []}, ['joint_names', '3']),
    ({'joint_names': None}, ['joint_names', 'required']),
    ({'joint_names': [1, 2, 3]}, ['joint_names', '1']),
    ({'link_lengths': None}, ['link_lengths', 'required']),
    ({'link_lengths': []}, ['link_lengths']),
]


def case_id(value):
    return ','.join(f'{k}={v}' for k, v in value.items()) if isinstance(value, dict) else ''


def assert_says(text, words):
    for word in words:
        assert word in text


def assert_configuration(bench, numbers):
    """Assert that the configuration in force, seen from outside, gives these numbers."""
    assert_numbers(bench.cycle(REGULAR)[0], numbers)


def test_defaults(make_bench):
    bench = make_bench({'stale_timeout': None})
    assert {name: bench.get(name) for name in DEFAULTS} == DEFAULTS
    assert bench.get('joint_names') == NAMES
    assert bench.get('link_lengths') == LENGTHS


def test_every_parameter_is_described(bench):
    own = [name for name in bench.list_parameters()
           if name not in ('use_sim_time', 'start_type_description_service')
           and not name.startswith('qos_overrides.')]
    assert set(TYPES) <= set(own)
    for descriptor in bench.describe(*own):
        assert len(descriptor.description) > 15, descriptor.name
        if descriptor.type != ParameterType.PARAMETER_BOOL:
            assert descriptor.additional_constraints, descriptor.name
        assert not descriptor.dynamic_typing


def test_types_units_and_ranges_of_the_descriptors(bench):
    descriptors = dict(zip(TYPES, bench.describe(*TYPES)))
    assert {name: d.type for name, d in descriptors.items()} == TYPES
    for name, unit in [('link_lengths', ' m'), ('joint_offsets', ' rad'),
                       ('stale_timeout', ' s'), ('diagnostics_period', ' s')]:
        assert unit in descriptors[name].description
    for name in ('z_max', 'margin_min'):
        span, = descriptors[name].floating_point_range
        assert span.from_value <= 0.0 and span.to_value == 1.0
    for name in ('hysteresis', 'stale_timeout', 'diagnostics_period'):
        span, = descriptors[name].floating_point_range
        assert 0.0 <= span.from_value <= DEFAULTS[name] < span.to_value < math.inf
    assert descriptors['joint_names'].read_only
    for name in ('link_lengths', 'joint_offsets', 'joint_directions', 'z_max', 'margin_min',
                 'hysteresis', 'stale_timeout', 'diagnostics_period'):
        assert not descriptors[name].read_only


@pytest.mark.parametrize('change, words', BAD_NUMBERS + WRONG_TYPES + BAD_NAMES, ids=case_id)
def test_bad_value_at_start_is_refused(make_bench, change, words):
    with pytest.raises(ValueError) as error:
        make_bench(change)
    message = str(error.value)
    assert_says(message, words)
    assert '\n' not in message
    assert 'Traceback' not in message


@pytest.mark.parametrize('service', ['set', 'set_atomically'])
def test_bad_values_at_run_time_are_refused(bench, service):
    before = {name: bench.get(name) for name in TYPES}
    for change, words in BAD_NUMBERS + WRONG_TYPES:
        answer = getattr(bench, service)(**change)
        result = answer[0] if service == 'set' else answer
        assert not result.successful, change
        name, *_ = words
        assert name in result.reason or 'type' in result.reason.lower(), (change, result.reason)
    assert {name: bench.get(name) for name in TYPES} == before
    assert_configuration(bench, expected_numbers(LENGTHS, REGULAR))


@pytest.mark.parametrize('change, words', BAD_NUMBERS, ids=case_id)
def test_reason_of_a_refusal_names_parameter_value_and_rule(bench, change, words):
    result = bench.set_atomically(**change)
    assert not result.successful
    assert_says(result.reason, words)


@pytest.mark.parametrize('name', TYPES)
def test_parameter_cannot_be_removed(bench, name):
    nothing = ParameterMessage(name=name, value=ParameterValue())
    before = bench.get(name)
    assert not bench.set(nothing=nothing)[0].successful
    assert not bench.set_atomically(nothing=nothing).successful
    assert bench.get(name) == before
    assert_configuration(bench, expected_numbers(LENGTHS, REGULAR))


def test_joint_names_are_read_only(bench):
    result, = bench.set(joint_names=['x', 'y', 'z'])
    assert not result.successful
    assert 'read' in result.reason.lower()
    assert bench.get('joint_names') == NAMES


def test_changes_take_effect(bench):
    lengths, offsets, directions = [2.0, 0.5, 0.7], [0.1, -0.2, 0.3], [1, -1, -1]
    assert bench.set(link_lengths=lengths)[0].successful
    assert_configuration(bench, expected_numbers(lengths, REGULAR))
    assert bench.set(joint_offsets=offsets)[0].successful
    angles = [p + o for p, o in zip(REGULAR, offsets)]
    assert_configuration(bench, expected_numbers(lengths, angles))
    assert bench.set(joint_directions=directions)[0].successful
    angles = [d * p + o for d, p, o in zip(directions, REGULAR, offsets)]
    assert_configuration(bench, expected_numbers(lengths, angles))


def test_offsets_and_directions_at_start(make_bench):
    bench = make_bench({'joint_offsets': [1.0, -2.0, 0.5], 'joint_directions': [-1, 1, -1]})
    angles = [1.0 - REGULAR[0], REGULAR[1] - 2.0, 0.5 - REGULAR[2]]
    assert_configuration(bench, expected_numbers(LENGTHS, angles))


def test_thresholds_change_at_run_time(bench):
    z, _, margin = expected_numbers(LENGTHS, REGULAR)
    assert bench.cycle(REGULAR)[1] is False
    assert bench.set(z_max=z - 1e-6)[0].successful
    assert bench.cycle(REGULAR)[1] is True
    assert bench.set(z_max=0.95, hysteresis=0.0)[1].successful
    assert bench.cycle(REGULAR)[1] is False
    assert bench.set(margin_min=margin + 1e-6)[0].successful
    assert bench.cycle(REGULAR)[1] is True


def test_atomic_set_is_all_or_nothing(bench):
    before = {name: bench.get(name) for name in TYPES}
    result = bench.set_atomically(link_lengths=[2.0, 1.0, 1.0], margin_min=7.0)
    assert not result.successful
    assert 'margin_min' in result.reason
    result = bench.set_atomically(joint_offsets=[1.0, 1.0, 1.0], joint_names=['x', 'y', 'z'])
    assert not result.successful
    result = bench.set_atomically(link_lengths=[2.0, 1.0, 1.0], use_sim_time='no')
    assert not result.successful
    assert {name: bench.get(name) for name in TYPES} == before
    assert_configuration(bench, expected_numbers(LENGTHS, REGULAR))


def test_parameters_set_atomically_are_judged_together(bench):
    # Each alone would make a flag that cannot clear; the order must not matter either.
    assert bench.set_atomically(margin_min=0.8).successful
    assert not bench.set(hysteresis=0.5)[0].successful
    assert bench.set_atomically(hysteresis=0.5, margin_min=0.1).successful
    assert not bench.set(margin_min=0.8)[0].successful
    assert bench.set_atomically(margin_min=0.8, hysteresis=0.1).successful


def test_non_atomic_set_judges_one_by_one(bench):
    results = bench.set(margin_min=2.0, link_lengths=[2.0, 1.0, 1.0], z_max=1.5)
    assert [r.successful for r in results] == [False, True, False]
    assert_configuration(bench, expected_numbers([2.0, 1.0, 1.0], REGULAR))


def test_last_of_a_repeated_parameter_wins(bench):
    good = Parameter('link_lengths', value=[2.0, 1.0, 1.0]).to_parameter_msg()
    bad = Parameter('link_lengths', value=[-2.0, 1.0, 1.0]).to_parameter_msg()
    result = bench.set_atomically(first=good, second=bad)
    assert not result.successful
    assert_configuration(bench, expected_numbers(LENGTHS, REGULAR))


def test_undeclared_parameter_is_refused(bench):
    result, = bench.set(link_length=[1.0, 1.0, 1.0])
    assert not result.successful


def test_hardware_id(make_bench):
    bench = make_bench({'hardware_id': 'arm 7'})
    bench.cycle(ISOTROPIC)
    bench.wait(lambda: bench.diagnostics, 'diagnostics')
    assert bench.status.hardware_id == 'arm 7'


def test_parameters_of_a_command_line(make_bench):
    bench = make_bench(
        {'joint_names': None, 'link_lengths': None},
        cli_args=['--ros-args', '-p', 'joint_names:=[shoulder, elbow, wrist]',
                  '-p', 'link_lengths:=[0.5, 0.4, 0.3]', '-p', 'z_max:=0.8'])
    assert_configuration(bench, expected_numbers([0.5, 0.4, 0.3], REGULAR))
    assert bench.get('z_max') == 0.8
