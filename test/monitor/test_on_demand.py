"""A message for nobody is not made, and what is made is what the middleware makes."""

import math

from hypothesis import given, settings, strategies as st
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Bool, Float64

from kinopt_ros.monitor import on_demand
from kinopt_ros.monitor.on_demand import bool_writer, float64_writer, OnDemandTopics


@pytest.fixture
def publisher(feed):
    return feed.node.create_publisher(Float64, 'numbers', 10)


def listen(feed, publisher):
    heard = []
    feed.node.create_subscription(
        Float64, 'numbers', lambda message: heard.append(message.data), 10)
    feed.until(lambda: publisher.get_subscription_count() == 1)
    return heard


def test_only_while_somebody_listens(feed, publisher):
    made, heard = [], []

    def make(value, factor):
        made.append(value)
        return Float64(data=value * factor)

    topics = OnDemandTopics()
    topics.add(publisher, make)
    topics.publish(1.0, 10.0)
    assert made == []
    subscription = feed.node.create_subscription(
        Float64, 'numbers', lambda message: heard.append(message.data), 10)
    feed.until(lambda: publisher.get_subscription_count() == 1)
    topics.publish(2.0, 10.0)
    feed.until(lambda: heard)
    assert (made, heard) == ([2.0], [20.0])
    feed.node.destroy_subscription(subscription)
    feed.until(lambda: publisher.get_subscription_count() == 0)
    topics.publish(3.0, 10.0)
    assert made == [2.0]


def test_where_there_is_nothing_to_be_said_nothing_is(feed, publisher):
    heard = listen(feed, publisher)
    topics = OnDemandTopics()
    topics.add(publisher, lambda value: Float64(data=value) if value > 0.0 else None)
    for value in (1.0, -1.0, 2.0):
        topics.publish(value)
    feed.until(lambda: len(heard) == 2)
    assert heard == [1.0, 2.0]


def test_numbers_arrive(feed, publisher):
    heard = listen(feed, publisher)
    topics = OnDemandTopics()
    topics.add(publisher, float64_writer())
    for value in (1.0, math.inf, -0.3, math.nan):
        topics.publish(value)
    feed.until(lambda: len(heard) == 4)
    assert heard[:3] == [1.0, math.inf, -0.3] and math.isnan(heard[3])


@settings(deadline=None, derandomize=True)
@given(st.floats())
def test_numbers_are_written_as_the_middleware_does(value):
    assert float64_writer()(value) == serialize_message(Float64(data=value))


def test_numbers_that_the_middleware_writes_otherwise_are_left_to_it(monkeypatch):
    """Most significant byte first, for instance."""
    monkeypatch.setattr(on_demand, 'serialize_message',
                        lambda message: serialize_message(message)[::-1])
    assert float64_writer()(0.25) == Float64(data=0.25)


def test_what_is_no_flag_is_no_silence():
    with pytest.raises(KeyError):
        bool_writer()(None)


@pytest.mark.parametrize('value', [False, True])
def test_flags_are_written_as_the_middleware_does(value):
    assert deserialize_message(bool_writer()(value), Bool) == Bool(data=value)
