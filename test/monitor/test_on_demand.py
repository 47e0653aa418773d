"""A message for nobody is not made."""

import time

import pytest
from rclpy.node import Node
from std_msgs.msg import Float64
from support import DEADLINE

from kinopt_ros.monitor.on_demand import publish_on_demand


@pytest.fixture
def node(context, executor):
    node = Node('talker', context=context)
    executor.add_node(node)
    yield node
    executor.remove_node(node)
    node.destroy_node()


def test_only_while_somebody_listens(node, executor):
    publisher = node.create_publisher(Float64, 'numbers', 10)
    made, heard = [], []

    def make(value, factor):
        made.append(value)
        return Float64(data=value * factor)

    def until(condition):
        deadline = time.monotonic() + DEADLINE
        while not condition():
            assert time.monotonic() < deadline
            executor.spin_once(timeout_sec=0.01)

    publish_on_demand(publisher, make, 1.0, 10.0)
    assert made == []
    subscription = node.create_subscription(
        Float64, 'numbers', lambda message: heard.append(message.data), 10)
    until(lambda: publisher.get_subscription_count() == 1)
    publish_on_demand(publisher, make, 2.0, 10.0)
    until(lambda: heard)
    assert (made, heard) == ([2.0], [20.0])
    node.destroy_subscription(subscription)
    until(lambda: publisher.get_subscription_count() == 0)
    publish_on_demand(publisher, make, 3.0, 10.0)
    assert made == [2.0]
