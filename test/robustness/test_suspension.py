"""The process is stopped for longer than the time-out, as when the machine is suspended."""

import math
import signal
import time

import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool
from support import NAMES, REGULAR, STRETCHED

TIMEOUT = 0.1
# Shorter and longer than a second.
PAUSES = [0.3, 1.2]
# Positions published while the process stands: fewer than its subscription keeps.
QUEUED = 6


@pytest.fixture
def watched(start, feed):
    """Give a process that is fed, and the flags heard of it."""
    from processes import ARM
    flags = []
    feed.node.create_subscription(
        Bool, '/singularity_monitor/near_singularity',
        lambda message: flags.append(message.data), 100)
    process = start(*ARM, '-p', f'stale_timeout:={TIMEOUT}')
    feed.until(lambda: False in flags)
    yield process, flags
    process.popen.send_signal(signal.SIGCONT)


def linger(feed, seconds):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        feed.executor.spin_once(timeout_sec=0.01)


def pause(feed, process, positions, seconds):
    """Stop the process for longer than the time-out, with messages coming at first."""
    # A verdict that is just being published when the process stops is of fresh data, and comes
    # out when it goes on: let there be none.
    linger(feed, 0.03)
    process.popen.send_signal(signal.SIGSTOP)
    linger(feed, 0.02)
    for _ in range(QUEUED):
        feed.publisher.publish(JointState(name=NAMES, position=positions))
    linger(feed, seconds)


@pytest.mark.parametrize('seconds', PAUSES)
def test_nothing_is_said_of_data_older_than_the_pause(watched, feed, seconds):
    """The publisher stopped meanwhile: what waited in the queue is no reading any more."""
    process, flags = watched
    pause(feed, process, REGULAR, seconds)
    flags.clear()
    feed.heard.clear()
    process.popen.send_signal(signal.SIGCONT)
    linger(feed, 0.5)
    assert False not in flags, 'OK from data older than the pause'
    assert flags and all(map(math.isnan, feed.heard[-1:]))


@pytest.mark.parametrize('seconds', PAUSES)
def test_the_first_word_after_the_pause_is_of_fresh_data(watched, feed, seconds):
    """The arm moved to a singularity meanwhile: not one OK of where it was before."""
    process, flags = watched
    pause(feed, process, REGULAR, seconds)
    flags.clear()
    process.popen.send_signal(signal.SIGCONT)
    feed.until(lambda: len(flags) > 20, positions=STRETCHED)
    assert all(flags)


@pytest.mark.parametrize('seconds', PAUSES)
def test_it_goes_on_after_the_pause(watched, feed, seconds):
    process, flags = watched
    pause(feed, process, STRETCHED, seconds)
    flags.clear()
    process.popen.send_signal(signal.SIGCONT)
    feed.until(lambda: False in flags)
