"""The process is stopped for longer than the time-out, as when the machine is suspended."""

import math
import signal

from processes import ARM
import pytest
from sensor_msgs.msg import JointState
from support import NAMES, REGULAR, STRETCHED

TIMEOUT = 0.1
# Shorter and longer than a second.
PAUSES = [0.3, 1.2]
# Positions published while the process stands: fewer than its subscription keeps.
QUEUED = 6


@pytest.fixture
def watched(start, feed):
    """Give a process that is fed, and the flags heard of it."""
    flags = feed.hear_flags()
    process = start(*ARM, '-p', f'stale_timeout:={TIMEOUT}')
    feed.until(lambda: False in flags)
    yield process, flags
    process.popen.send_signal(signal.SIGCONT)


def pause(feed, watched, positions, seconds):
    """
    Stop the process for longer than the time-out, with messages coming at first; then go on.

    Gives the flags that are heard from then on.
    """
    process, flags = watched
    # A verdict that is just being published when the process stops is of fresh data, and comes
    # out when it goes on: let there be none.
    feed.linger(0.03)
    process.popen.send_signal(signal.SIGSTOP)
    feed.linger(0.02)
    for _ in range(QUEUED):
        feed.publisher.publish(JointState(name=NAMES, position=positions))
    feed.linger(seconds)
    flags.clear()
    feed.heard.clear()
    process.popen.send_signal(signal.SIGCONT)
    return flags


@pytest.mark.parametrize('seconds', PAUSES)
def test_nothing_is_said_of_data_older_than_the_pause(watched, feed, seconds):
    """The publisher stopped meanwhile: what waited in the queue is no reading any more."""
    flags = pause(feed, watched, REGULAR, seconds)
    feed.linger(0.5)
    assert False not in flags, 'OK from data older than the pause'
    assert flags and all(map(math.isnan, feed.heard[-1:]))


@pytest.mark.parametrize('seconds', PAUSES)
def test_the_first_word_after_the_pause_is_of_fresh_data(watched, feed, seconds):
    """The arm moved to a singularity meanwhile: not one OK of where it was before."""
    flags = pause(feed, watched, REGULAR, seconds)
    feed.until(lambda: len(flags) > 20, positions=STRETCHED)
    assert all(flags)


@pytest.mark.parametrize('seconds', PAUSES)
def test_it_goes_on_after_the_pause(watched, feed, seconds):
    flags = pause(feed, watched, STRETCHED, seconds)
    feed.until(lambda: False in flags)
