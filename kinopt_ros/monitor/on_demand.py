"""Messages only for somebody: what nobody listens to is neither made nor sent."""


class OnDemandPublisher:
    """
    Publish messages that are made only if somebody listens.

    A message for nobody would wake threads of the middleware all the same. On a volatile topic
    nobody misses it either.

    Parameters
    ----------
    publisher : rclpy.publisher.Publisher
    make_message : callable
        Gives a message.
    """

    def __init__(self, publisher, make_message):
        # Of the handle: the publisher's own method guards a question that needs no guard, and
        # all topics are asked in each cycle.
        self._subscription_count = publisher.handle.get_subscription_count
        self._publisher = publisher
        self._make_message = make_message

    def publish(self, *arguments):
        """Publish what make_message(*arguments) gives, if somebody listens."""
        if self._subscription_count() > 0:
            self._publisher.publish(self._make_message(*arguments))


def one_value(message):
    """
    Give a function that puts its argument into the field `data` of a message and gives that.

    It is always the same message: to publish copies it, to make another takes longer. One thread
    at a time may publish it, as the callbacks of one group do.
    """
    def make_message(value):
        message.data = value
        return message
    return make_message
