"""A message for nobody is not made."""

from std_msgs.msg import Float64

from kinopt_ros.monitor.on_demand import OnDemandPublisher, one_value


def test_only_while_somebody_listens(feed):
    publisher = feed.node.create_publisher(Float64, 'numbers', 10)
    made, heard = [], []

    def make(value, factor):
        made.append(value)
        return Float64(data=value * factor)

    on_demand = OnDemandPublisher(publisher, make)
    on_demand.publish(1.0, 10.0)
    assert made == []
    subscription = feed.node.create_subscription(
        Float64, 'numbers', lambda message: heard.append(message.data), 10)
    feed.until(lambda: publisher.get_subscription_count() == 1)
    on_demand.publish(2.0, 10.0)
    feed.until(lambda: heard)
    assert (made, heard) == ([2.0], [20.0])
    feed.node.destroy_subscription(subscription)
    feed.until(lambda: publisher.get_subscription_count() == 0)
    on_demand.publish(3.0, 10.0)
    assert made == [2.0]


def test_one_message_carries_one_value_after_the_other(feed):
    publisher = feed.node.create_publisher(Float64, 'numbers', 10)
    heard = []
    feed.node.create_subscription(
        Float64, 'numbers', lambda message: heard.append(message.data), 10)
    feed.until(lambda: publisher.get_subscription_count() == 1)
    on_demand = OnDemandPublisher(publisher, one_value(Float64()))
    for value in (1.0, 2.0, 3.0):
        on_demand.publish(value)
    feed.until(lambda: len(heard) == 3)
    assert heard == [1.0, 2.0, 3.0]
