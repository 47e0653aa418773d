"""A node as a process: start, executor, and an end with status 0 whatever the moment."""

import sys

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from kinopt_ros.monitor import signals

# An upper bound for the executor's sleep; work and signals wake it at once.
_LONGEST_SLEEP = 0.5


class StartError(Exception):
    """What the user gave a node to start with is bad; the message is one line for people."""


def make_executor():
    """Give the executor that this project's executables spin."""
    return SingleThreadedExecutor()


def run(make_node, args=None):
    """
    Run a node until SIGINT, SIGTERM or the shutdown of its context.

    Parameters
    ----------
    make_node : callable
        Makes the node in the default context; raises ValueError where the user's input at
        start is bad.
    args : list of str or None
        Command line; None for the process's own.

    Returns
    -------
    status : int
        0 after a shutdown, 1 after bad input, which is named on stderr in one line.
    """
    interruptions = signals.take_note()
    node = executor = None
    try:
        _initialize(args)
        node = _make(make_node)
        executor = make_executor()
        executor.add_node(node)
        _spin(executor)
    except ExternalShutdownException:
        pass
    except StartError as error:
        if not interruptions:
            print(f'error: {error}', file=sys.stderr)
            return 1
    except Exception:
        # On the way out rclpy raises all sorts of errors about a context that is gone.
        if rclpy.ok():
            raise
    finally:
        _tear_down(node, executor)
    return 0


def _initialize(args):
    try:
        rclpy.init(args=args)
    except Exception as error:
        # Of a bad command line or parameter file: only the first line is meant for people.
        raise StartError(str(error).split(', at ')[0]) from error


def _make(make_node):
    try:
        return make_node()
    except (ValueError, ParameterException) as error:
        if rclpy.ok():
            raise StartError(str(error)) from error
        raise


def _spin(executor):
    while rclpy.ok():
        executor.spin_once(timeout_sec=_LONGEST_SLEEP)


def _tear_down(node, executor):
    if executor is not None:
        executor.shutdown()
    if node is not None:
        node.destroy_node()
    rclpy.try_shutdown()
    signals.ignore()
