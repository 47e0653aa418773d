"""A node as a process: start, executor, and an end with status 0 whatever the moment."""

import sys

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from kinopt_ros.monitor import cpu_affinity, signals
from kinopt_ros.monitor.parameters import CPU_AFFINITY, EXECUTOR

# Within this time (s) a signal is looked at; work wakes the executor at once.
_LONGEST_SLEEP = 0.05


class StartError(Exception):
    """What the user gave a node to start with is bad; the message is one line for people."""


def make_executor(name, logger):
    """
    Give an executor by its name, or the other one where it cannot be had.

    Parameters
    ----------
    name : str
        'events' or 'single'.
    logger : rclpy.impl.rcutils_logger.RcutilsLogger
        Told of it if it is the other one.

    Returns
    -------
    executor : rclpy.executors.Executor

    Raises
    ------
    ValueError
        If there is no executor of that name.
    """
    if name not in _EXECUTORS:
        raise ValueError(f"parameter {EXECUTOR.name} = '{name}': must be "
                         f'{" or ".join(map(repr, _EXECUTORS))}')
    try:
        return _EXECUTORS[name]()
    except Exception as error:
        other, make_other = next(item for item in _EXECUTORS.items() if item[0] != name)
        logger.warning(f"no executor '{name}' here ({error}); using '{other}'")
        return make_other()


def _events_executor():
    # It is experimental in Jazzy: it may be missing, moved, or refuse the middleware.
    from rclpy.experimental.events_executor import EventsExecutor
    return EventsExecutor()


_EXECUTORS = {'events': _events_executor, 'single': SingleThreadedExecutor}


def run(make_node, args=None):
    """
    Run a node until SIGINT, SIGTERM or the shutdown of its context.

    Parameters
    ----------
    make_node : callable
        Makes the node in the default context; raises ValueError where the user's input at
        start is bad. Where that comes out only later, the node leaves it in its attribute
        `start_error`: no executor takes an exception from a callback quietly.
    args : list of str or None
        Command line; None for the process's own.

    Returns
    -------
    status : int
        0 after a shutdown, 1 after bad input, which is named on stderr in one line.
    """
    endings = signals.take_note()
    node = executor = None
    try:
        _initialize(args)
        # Noted as signals are: asking the context before each callback costs more than some do.
        rclpy.get_default_context().on_shutdown(lambda: endings.append('shutdown'))
        node = _make(make_node)
        executor = _make(lambda: _executor_of(node))
        executor.add_node(node)
        _make(lambda: _choose_cores(node))
        _spin(executor, node, endings)
    except ExternalShutdownException:
        pass
    except StartError as error:
        if not endings:
            print(f'error: {error}', file=sys.stderr)
            return 1
    except Exception:
        # On the way out rclpy raises all sorts of errors about a context that is gone.
        if rclpy.ok() and not endings:
            raise
    finally:
        _tear_down(node, executor)
    return 0


def _initialize(args):
    try:
        # The handlers of rclpy would shut the context down under a running callback.
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:
        # Of a bad command line or parameter file: only the first line is meant for people.
        raise StartError(str(error).split(', at ')[0]) from error


def _make(make):
    try:
        return make()
    except (ValueError, ParameterException) as error:
        if rclpy.ok():
            raise StartError(str(error)) from error
        raise
    except rclpy_implementation.RCLError as error:
        # The middleware does not let the node in, by its security settings for instance.
        raise StartError(' '.join(str(error).split())) from error


def _executor_of(node):
    return make_executor(_value(node, EXECUTOR.name, EXECUTOR.default), node.get_logger())


def _choose_cores(node):
    choice = _value(node, CPU_AFFINITY.name, 'all')
    if choice not in ('one', 'all'):
        raise ValueError(f"parameter {CPU_AFFINITY.name} = '{choice}': must be 'one' or 'all'")
    if choice == 'all':
        return
    try:
        core = cpu_affinity.keep_to_one_core()
        cpu_affinity.let_timers_wait()
    except OSError as error:
        # A sandbox may forbid it; the node does its work all the same.
        node.get_logger().warning(f'cannot keep to one core: {error}')
    else:
        node.get_logger().info(f'keeping to core {core} ({CPU_AFFINITY.name})')


def _value(node, name, default):
    return node.get_parameter_or(name, Parameter(name, value=default)).value


def _spin(executor, node, endings):
    # spin_once because the EventsExecutor's spin() of rclpy 7.1 takes a core and calls nothing.
    while not endings:
        executor.spin_once(timeout_sec=_LONGEST_SLEEP)
        start_error = getattr(node, 'start_error', None)
        if start_error is not None:
            raise StartError(str(start_error))


def _tear_down(node, executor):
    if executor is not None:
        executor.shutdown()
    if node is not None:
        node.destroy_node()
    rclpy.try_shutdown()
    signals.ignore()
