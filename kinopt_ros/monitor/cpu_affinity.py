"""
The cores that a process runs on.

Each message is handed from a thread of the middleware to the node's. On two cores every such step
wakes the other core, whose caches are cold by then: it takes more time than the index.
"""

import contextlib
import os
from pathlib import Path

# The threads of Fast DDS that keep its timers are called so, with a number.
_TIMER_THREADS = 'dds.ev.'

# What the system, or whoever started the process, gives it: for its children too.
_GIVEN = os.sched_getaffinity(0) if hasattr(os, 'sched_getaffinity') else None


def keep_to_one_core():
    """
    Keep all threads of this process on one core: the one that is running this.

    It is one of those that the process was given. Threads and processes that start later are
    bound too, until they `run_on` others.

    Returns
    -------
    core : int

    Raises
    ------
    OSError
        If the system does not permit it, or knows no such binding.
    """
    if _GIVEN is None:
        raise OSError('this system binds no process to a core')
    core = _present_core()
    bound = set()
    # A thread that is not bound yet may start another one meanwhile.
    while unbound := _threads() - bound:
        for thread in unbound:
            # It may also have ended.
            with contextlib.suppress(ProcessLookupError):
                os.sched_setaffinity(thread, {core})
        bound |= unbound
    return core


def let_timers_wait():
    """
    Let the middleware's timers wait until the thread that runs on their core pauses.

    Each publication sets one; its thread would interrupt the one that publishes, for each topic
    anew. What somebody has put before others, in real time for instance, is left there.
    """
    for thread in _threads():
        # It may have ended, or the system may forbid it: then all is as it was.
        with contextlib.suppress(OSError):
            name = Path(f'/proc/self/task/{thread}/comm').read_text()
            if name.startswith(_TIMER_THREADS) and (
                    os.sched_getscheduler(thread) == os.SCHED_OTHER):
                os.sched_setscheduler(thread, os.SCHED_BATCH, os.sched_param(0))


def given_cores():
    """Cores that this process was started on; None where the system knows no such binding."""
    return _GIVEN


def run_on(cores):
    """Let the calling process run on any of the cores where permitted; None changes nothing."""
    if cores is not None:
        with contextlib.suppress(OSError):
            os.sched_setaffinity(0, cores)


def _threads():
    return {int(task.name) for task in Path('/proc/self/task').iterdir()}


def _present_core():
    # Its field 39; the name of the thread, in brackets, may hold anything.
    fields = Path('/proc/thread-self/stat').read_text().rpartition(')')[2].split()
    return int(fields[36])
