"""Messages only for somebody: what nobody listens to is neither made nor sent."""


def publish_on_demand(publisher, make_message, *arguments):
    """
    Publish what make_message(*arguments) gives, if somebody listens.

    A message for nobody would wake threads of the middleware all the same. On a volatile topic
    nobody misses it either.
    """
    # Of the handle: the publisher's own method guards a question that needs no guard, and all
    # topics are asked in each cycle.
    if publisher.handle.get_subscription_count() > 0:
        publisher.publish(make_message(*arguments))
