"""What SIGINT and SIGTERM mean to a process of this project: end, with status 0."""

import os
import signal

NUMBERS = (signal.SIGINT, signal.SIGTERM)


def end_at_once():
    """Before there is anything to tear down, let a signal end the process on the spot."""
    _handle(lambda *_: os._exit(0))


def take_note():
    """
    Let a signal raise nothing, and note it in the list returned.

    Whoever spins looks at the list between two callbacks; a second signal then finds nothing
    left to interrupt.
    """
    received = []
    _handle(lambda number, _: received.append(number))
    return received


def ignore():
    """Ignore signals for good: the interpreter's own end would let a signal kill it again."""
    _handle(signal.SIG_IGN)


def _handle(handler):
    for number in NUMBERS:
        signal.signal(number, handler)
