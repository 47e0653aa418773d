"""A service that is answered later, without an awaited callback, on every executor."""

from rclpy.exceptions import InvalidHandle
from rclpy.impl.implementation_singleton import rclpy_implementation


def create_deferred_service(node, service_type, name, callback):
    """
    Create a service whose callback returns a future of the response.

    rclpy offers awaited callbacks for this, but the EventsExecutor of Jazzy never runs them,
    and a future completed in another thread does not wake the SingleThreadedExecutor. Both
    executors hand what the callback returns to `Service.send_response`, with the request's
    header: here that waits for the future.

    Parameters
    ----------
    node : rclpy.node.Node
    service_type : type
    name : str
    callback : callable
        Takes the request, returns a concurrent.futures.Future of the response; must not raise,
        nor may the future.

    Returns
    -------
    service : rclpy.service.Service
    """
    service = node.create_service(service_type, name, lambda request, _: callback(request))
    send = service.send_response

    def send_when_done(future, header):
        future.add_done_callback(lambda done: _send(send, done, header))

    service.send_response = send_when_done
    return service


def _send(send, future, header):
    if future.cancelled():
        return
    try:
        send(future.result(), header)
    except (InvalidHandle, rclpy_implementation.RCLError):
        # The service or its context is gone, and the client gets no answer from a dead node.
        pass
