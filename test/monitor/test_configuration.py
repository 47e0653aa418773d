"""All parameters judged together, as plain values."""

import math

import pytest
from support import parameter_values

from kinopt_ros.monitor.configuration import Configuration


def configuration(**changes):
    return Configuration.from_parameters(parameter_values(**changes))


@pytest.mark.parametrize('changes, words', [
    ({'joint_names': None}, ['joint_names', 'required']),
    ({'joint_names': []}, ['joint_names', '3']),
    ({'joint_names': ['a', 'b']}, ['joint_names', "'b'", '3']),
    ({'joint_names': ['a', 'b', 'b']}, ['joint_names', "'b'", 'more than once']),
    ({'joint_names': ['a', 'b', '']}, ['joint_names', 'empty']),
    ({'link_lengths': None}, ['link_lengths', 'required']),
    ({'link_lengths': []}, ['link_lengths']),
    ({'link_lengths': [1.0, 2.0]}, ['link_lengths', '2.0', '3']),
    ({'link_lengths': [1.0, 2.0, math.nan]}, ['link_lengths[2]', 'nan', 'finite']),
    ({'link_lengths': [1.0, 0.0, 1.0]}, ['link_lengths[1]', '0.0', 'positive']),
    ({'joint_offsets': [0.0, 0.0]}, ['joint_offsets', '3']),
    ({'joint_offsets': [0.0, 0.0, -math.inf]}, ['joint_offsets[2]', '-inf']),
    ({'joint_directions': [1, -1, 2]}, ['joint_directions[2]', '2', '-1']),
    ({'joint_directions': [1, -1]}, ['joint_directions', '3']),
    ({'z_max': 1.1}, ['z_max', '1.1', '0..1']),
    ({'margin_min': -0.1}, ['margin_min', '-0.1', '0..1']),
    ({'hysteresis': -1.0}, ['hysteresis', '-1.0', 'negative']),
    ({'stale_timeout': 0.0}, ['stale_timeout', '0.0', 'above 0']),
    ({'stale_timeout': math.inf}, ['stale_timeout', 'inf', 'finite']),
    ({'diagnostics_period': -0.5}, ['diagnostics_period', '-0.5', 'negative']),
    ({'diagnostics_period': math.nan}, ['diagnostics_period', 'nan', 'finite']),
])
def test_refusal_names_parameter_value_and_rule(changes, words):
    with pytest.raises(ValueError) as error:
        configuration(**changes)
    message = str(error.value)
    assert message.startswith(f'parameter {words[0]}')
    for word in words:
        assert word in message
    assert '\n' not in message


def test_extreme_values_that_are_allowed():
    assert configuration(diagnostics_period=0.0).diagnostics_period == 0.0
    assert configuration(z_max=1.0, margin_min=0.0, hysteresis=0.0).thresholds.z_max == 1.0
    assert configuration(link_lengths=[1e-9, 1e9, 1.0]).arm.planar_arm.n_joints == 3


def test_angles_of_positions_and_back():
    arm = configuration(joint_offsets=[0.1, -0.2, 3.0], joint_directions=[1, -1, -1]).arm
    angles = arm.joint_angles([1.0, 2.0, 0.5])
    assert angles == pytest.approx([1.1, -2.2, 2.5])
    assert arm.joint_positions(angles) == pytest.approx([1.0, 2.0, 0.5])


def test_configuration_cannot_be_changed_in_place():
    whole = configuration()
    with pytest.raises(AttributeError):
        whole.stale_timeout = 1.0
    with pytest.raises(AttributeError):
        whole.arm.joint_offsets = (1.0, 1.0, 1.0)
    lengths = [1.0, 2.0, 3.0]
    kept = configuration(link_lengths=lengths)
    lengths[0] = 9.0
    assert kept.arm.planar_arm.link_lengths == (1.0, 2.0, 3.0)
