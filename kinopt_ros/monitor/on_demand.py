"""Messages only for somebody: what nobody listens to is neither made nor sent."""

from functools import partial
import struct

from rclpy.serialization import serialize_message
from std_msgs.msg import Bool, Float64


class OnDemandTopics:
    """
    One topic, or several that are published together, each only if somebody listens.

    A message for nobody would wake threads of the middleware all the same. On a volatile topic
    nobody misses it either.
    """

    def __init__(self):
        self._topics = []

    def add(self, publisher, make_message):
        """
        Add a topic.

        Parameters
        ----------
        publisher : rclpy.publisher.Publisher
        make_message : callable
            Gives a message or its bytes, or None where there is nothing to be said.
        """
        # Of the handle: the publisher's own method guards a question that needs no guard, and
        # all topics are asked in each cycle.
        self._topics.append((publisher.handle.get_subscription_count, publisher, make_message))

    def publish(self, *arguments):
        """Publish what make_message(*arguments) of each topic gives, if somebody listens."""
        for subscription_count, publisher, make_message in self._topics:
            if subscription_count() > 0:
                message = make_message(*arguments)
                if message is not None:
                    publisher.publish(message)


def float64_writer():
    """
    Give a function that makes a std_msgs/Float64 of a number.

    As bytes, where the middleware writes them as DDS does: to take a message of Python apart
    takes it longer than to send it.
    """
    head = serialize_message(Float64())[:-8]
    write = partial(struct.Struct(f'<{len(head)}sd').pack, head)
    if all(write(value) == serialize_message(Float64(data=value)) for value in (0.1, -1e-300)):
        return write
    return lambda value: Float64(data=value)


def bool_writer():
    """Give a function that makes the bytes of a std_msgs/Bool."""
    return {value: serialize_message(Bool(data=value)) for value in (False, True)}.__getitem__
