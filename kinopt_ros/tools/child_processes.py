"""The nodes of this package as child processes, which end with the command that started them."""

import os
import signal
import subprocess
import sys
import time

from kinopt_ros.monitor import signals
from kinopt_ros.tools.private_domain import reserve_domain

# How long (s) a child may take to end.
PATIENCE = 10.0

# The very package that this process runs, wherever its executables are installed.
_CODE = ('import sys; sys.path[:] = {path!r}; from kinopt_ros.executables import {name}; '
         'sys.exit({name}())')


def use_private_domain():
    """Let this process and its children hear nobody else, and nobody else hear them."""
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ['ROS_DOMAIN_ID'] = str(reserve_domain())


class ChildProcesses:
    """
    Start nodes as processes, and stop them all at the end of the context.

    Within the context SIGINT and SIGTERM are noted, and `check` raises KeyboardInterrupt for
    them: raised at any moment, it could get lost in a callback that swallows it.
    """

    def __init__(self):
        self._processes = []

    def start(self, name, *ros_arguments):
        """
        Start a node.

        Parameters
        ----------
        name : str
            A function of `kinopt_ros.executables`.
        ros_arguments : str
            What follows --ros-args.
        """
        self._processes.append((name, subprocess.Popen(
            [sys.executable, '-c', _CODE.format(path=sys.path, name=name),
             '--ros-args', *ros_arguments],
            # A Ctrl-C at the terminal is for this process, which then stops its children.
            start_new_session=True)))

    def check(self):
        """Raise KeyboardInterrupt after a signal, ChildProcessError if a child has ended."""
        if self._interruptions:
            raise KeyboardInterrupt
        for name, process in self._processes:
            if process.poll() is not None:
                raise ChildProcessError(f'{name} ended with status {process.returncode}')

    @property
    def failed(self):
        """Names of the children that have ended with another status than 0."""
        return [name for name, process in self._processes if process.poll()]

    def __enter__(self):
        self._handlers = {number: signal.getsignal(number) for number in signals.NUMBERS}
        self._interruptions = signals.take_note()
        return self

    def __exit__(self, *_):
        # From here on it ends in any case: a second signal would only leave children behind.
        signals.ignore()
        self._stop()
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def _stop(self):
        for _, process in self._processes:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        deadline = time.monotonic() + PATIENCE
        for _, process in self._processes:
            try:
                process.wait(timeout=max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def run_with_children(work, finish):
    """
    Do something with children, and something with the result once they have ended.

    Parameters
    ----------
    work : callable
        Takes the ChildProcesses, gives the result.
    finish : callable
        Takes the result, gives the exit status.

    Returns
    -------
    status : int
        That of `finish`; 0 after a signal, 1 if a child or a deadline failed, which is told in
        one line on stderr.
    """
    try:
        with ChildProcesses() as processes:
            result = work(processes)
    except KeyboardInterrupt:
        print('\ninterrupted')
        return 0
    except (ChildProcessError, TimeoutError) as error:
        print(f'error: {error}', file=sys.stderr)
        return 1
    if processes.failed:
        print(f'error: failed: {", ".join(processes.failed)}', file=sys.stderr)
        return 1
    return finish(result)
