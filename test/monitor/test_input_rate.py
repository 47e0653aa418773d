"""The rate that the diagnostics show, in plain time."""

import pytest
from support import parameter_values

from kinopt_ros.monitor.configuration import Configuration
from kinopt_ros.monitor.input_rate import InputRate
from kinopt_ros.monitor.posture_monitor import PostureMonitor


@pytest.fixture
def rate():
    return InputRate()


def tick(rate, *times):
    for time in times:
        rate.tick(time)


def test_nothing_and_one_message_are_no_rate(rate):
    assert rate.per_second(100.0) == 0.0
    tick(rate, 100.0)
    assert rate.per_second(100.1) == 0.0


def test_even_messages(rate):
    tick(rate, *(100.0 + 0.1 * i for i in range(21)))
    assert rate.per_second(102.0) == pytest.approx(10.0)


def test_falls_towards_0_when_messages_stop(rate):
    tick(rate, *(100.0 + 0.1 * i for i in range(21)))
    assert rate.per_second(104.0) == pytest.approx(5.0)
    assert rate.per_second(1100.0) == pytest.approx(0.02)


def test_is_of_the_last_five_seconds(rate):
    tick(rate, 100.0, 101.0, *(110.0 + 0.5 * i for i in range(21)))
    assert rate.per_second(120.0) == pytest.approx(2.0)


def test_is_of_a_hundred_messages_at_most(rate):
    tick(rate, *(100.0 + i for i in range(3)), *(103.0 + 1e-3 * i for i in range(100)))
    assert rate.per_second(103.099) == pytest.approx(1000.0)


def test_begins_anew_after_a_gap():
    monitor = PostureMonitor(Configuration.from_parameters(parameter_values()), 100.0)
    for i in range(3):
        monitor.on_joint_state(['a', 'b', 'c'], [0.0, 1.0, 2.0], 100.0 + 0.1 * i)
    assert monitor.input_rate.per_second(100.2) == pytest.approx(10.0)
    assert monitor.on_time(101.0) is not None
    assert monitor.input_rate.per_second(101.0) == 0.0
