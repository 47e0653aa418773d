"""
The solver in a process of its own, so that the monitor's cycle never waits for it.

In the monitor's process a solve would hold the interpreter's lock for milliseconds at a time.
"""

from concurrent.futures import ThreadPoolExecutor
import os
import pickle
import subprocess
import sys
import threading
import time

from kinopt_ros.kinetostatics.optimal_posture import optimal_posture
from kinopt_ros.monitor import signals
from kinopt_ros.monitor.cpu_affinity import given_cores, run_on

# Requests are taken up no closer together than this (s): whoever asks without pause would
# otherwise take from the monitor's cycle what each request and answer costs the node itself.
SPACING = 0.02


class SolverProcess:
    """
    Ask for optimal postures without waiting for them.

    Requests are answered one after the other, in their order, and at most fifty a second. The
    process starts with the first one; should it die, the request is put to another, once. It
    ends with its parent, whatever way that goes, because its input then ends.
    """

    def __init__(self):
        self._thread = ThreadPoolExecutor(1, thread_name_prefix='solver')
        self._process = None
        self._closed = threading.Event()
        self._free_at = 0.0
        self._waiting = 0
        self._count_lock = threading.Lock()

    @property
    def waiting(self):
        """Number of requests that have no answer yet."""
        return self._waiting

    def submit(self, link_lengths, lower=None, upper=None, reference=None):
        """
        Ask for the optimal posture; the arguments are those of `optimal_posture`.

        Returns
        -------
        future : concurrent.futures.Future
            Its result is the OptimalPosture; its exception a ValueError where the request is
            bad, or a ChildProcessError where the process died over it. Callbacks are run in
            the thread that waits for the process.
        """
        with self._count_lock:
            self._waiting += 1
        future = self._thread.submit(self._ask, (link_lengths, lower, upper, reference))
        future.add_done_callback(self._answered)
        return future

    def close(self):
        """End the process, and wait for the thread; requests without an answer fail."""
        self._closed.set()
        if self._process is not None:
            self._process.kill()
        self._thread.shutdown(cancel_futures=True)
        if self._process is not None:
            self._process.kill()
            self._process.communicate()

    def _answered(self, _):
        with self._count_lock:
            self._waiting -= 1

    def _ask(self, request):
        self._closed.wait(self._free_at - time.monotonic())
        self._free_at = time.monotonic() + SPACING
        answer = self._answer(request) or self._answer(request)
        if answer is None:
            raise ChildProcessError('the solver process ended over the request')
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _answer(self, request):
        """Put a request to the process; None if it ends over it."""
        if self._process is None or self._process.poll() is not None:
            self._process = _start()
        if self._closed.is_set():
            raise ChildProcessError('the solver is closed')
        try:
            pickle.dump(request, self._process.stdin)
            self._process.stdin.flush()
            return pickle.load(self._process.stdout)
        except (OSError, EOFError, ValueError, pickle.UnpicklingError):
            self._process.kill()
            self._process.wait()
            return None


def _start():
    # The path of this very process: the folder that it runs in must not come before it.
    # The imports too are made on any core and behind the controller, which comes first.
    code = (f'import os, sys; os.nice(10); sys.path[:] = {sys.path!r}; '
            f'from {run_on.__module__} import run_on; run_on({given_cores()}); '
            f'from {__name__} import main; main()')
    return subprocess.Popen(
        [sys.executable, '-c', code], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        # Small matrices gain nothing from threads, which would take other cores from the arm.
        env={**os.environ, 'OPENBLAS_NUM_THREADS': '1', 'OMP_NUM_THREADS': '1'},
        # A Ctrl-C at the terminal is for the node, which then ends this process.
        start_new_session=True)


def main():
    """Answer requests on the standard streams."""
    signals.ignore()
    try:
        serve(sys.stdin.buffer, sys.stdout.buffer)
    except BrokenPipeError:
        # The node was killed and nobody waits; what is in the buffer could not go out at exit.
        os._exit(0)


def serve(requests, answers):
    """Answer pickled requests from one stream on another until the first ends."""
    while True:
        try:
            request = pickle.load(requests)
        except EOFError:
            return
        try:
            answer = optimal_posture(*request)
        except Exception as error:
            answer = error
        pickle.dump(answer, answers)
        answers.flush()

