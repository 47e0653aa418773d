"""A ROS domain of one's own, so that two runs on one machine do not hear each other."""

import fcntl
import os
from pathlib import Path
import tempfile

# Identifiers whose ports are safe on every system; people count theirs from the low end.
DOMAINS = range(101, 0, -1)

_locks = []


def reserve_domain():
    """
    Reserve a ROS domain until this process ends.

    Returns
    -------
    domain : int
        Within 1..101; no other process of this machine that asks here gets it meanwhile.

    Raises
    ------
    RuntimeError
        If all of them are reserved.
    """
    for domain in DOMAINS:
        lock = _lock(Path(tempfile.gettempdir()) / f'kinopt_ros_domain_{domain}.lock')
        if lock is not None:
            # The lock goes with the file, and the file with the process, however it ends.
            _locks.append(lock)
            return domain
    raise RuntimeError(f'all {len(DOMAINS)} ROS domains of {tempfile.gettempdir()} are reserved')


def _lock(path):
    """Open and lock a file; None while somebody else holds it."""
    try:
        lock = _open(path)
    except PermissionError:
        return None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(lock)
        return None
    return lock


def _open(path):
    # In a shared temporary folder the system forbids O_CREAT on a file of another user.
    try:
        return os.open(path, os.O_RDONLY)
    except FileNotFoundError:
        return os.open(path, os.O_RDONLY | os.O_CREAT, 0o644)
