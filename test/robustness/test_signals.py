"""SIGINT and SIGTERM at random moments: status 0, nothing on stderr but the log, no orphan."""

import random
import signal
import subprocess
import sys
import time

from processes import ARM, group_ends
import pytest

SIGNALS = 20
LATEST = 1.2

# The executable, which tells when its main has begun.
EXECUTABLE = """
import sys
from kinopt_ros import executables
from kinopt_ros.monitor import signals

def begin(end_at_once=signals.end_at_once):
    end_at_once()
    print('begun', flush=True)

signals.end_at_once = begin
sys.exit(executables.singularity_monitor())
"""


@pytest.mark.parametrize('executor', ['events', 'single'])
def test_at_random_moments(soak, executor):
    rng = random.Random(8)
    for _ in range(soak(SIGNALS) // 2):
        number = rng.choice([signal.SIGINT, signal.SIGTERM])
        node = subprocess.Popen(
            [sys.executable, '-c', EXECUTABLE, '--ros-args', '-p', f'executor:={executor}', *ARM],
            text=True, start_new_session=True, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE)
        try:
            assert node.stdout.readline() == 'begun\n'
            delay = rng.uniform(0.0, LATEST)
            time.sleep(delay)
            node.send_signal(number)
            _, error = node.communicate(timeout=10.0)
        finally:
            node.kill()
        assert node.returncode == 0, (number, delay, error)
        assert all(line.startswith('[INFO]') for line in error.splitlines()), (delay, error)
        assert group_ends(node.pid, within=5.0), delay
