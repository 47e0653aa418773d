"""
The wall clock jumps under the running process: nothing becomes stale or fresh by that.

The clock of one process is moved by a preloaded library, since only the owner of a machine may
set its own.
"""

import os
from pathlib import Path
import re
import shutil
import signal
import struct
import subprocess
import sys
import time

from processes import ARM, assert_clean
import pytest
from sensor_msgs.msg import JointState
from support import NAMES, REGULAR

SOURCE = Path(__file__).with_name('wall_clock.c')
TIMEOUT = 0.4
HOUR = 3600


class WallClock:
    """The wall clock of the processes that start from now on."""

    def __init__(self, folder, monkeypatch):
        library = folder / 'wall_clock.so'
        subprocess.run(['cc', '-shared', '-fPIC', '-O1', '-Wall', '-Werror', '-o', library,
                        SOURCE, '-ldl'], check=True)
        self._file = os.open(folder / 'offset', os.O_RDWR | os.O_CREAT)
        self.jump_to(0)
        monkeypatch.setenv('WALL_CLOCK_OFFSET', str(folder / 'offset'))
        monkeypatch.setenv('LD_PRELOAD', str(library))

    def jump_to(self, offset):
        """Let it differ from the machine's by so many s."""
        os.pwrite(self._file, struct.pack('=q', offset), 0)

    def close(self):
        os.close(self._file)


@pytest.fixture
def wall_clock(tmp_path, monkeypatch):
    if not sys.platform.startswith('linux') or shutil.which('cc') is None:
        pytest.skip('needs Linux and a C compiler')
    clock = WallClock(tmp_path, monkeypatch)
    yield clock
    clock.close()


@pytest.fixture(params=['events', 'single'])
def watched(request, start, feed, wall_clock):
    """Give a process that is fed, and the flags heard of it."""
    flags = feed.hear_flags()
    process = start(*ARM, '-p', f'stale_timeout:={TIMEOUT}', '-p', f'executor:={request.param}')
    feed.until(lambda: False in flags)
    return process, flags


def answers_from_now_on(feed, flags):
    """Hear what is still under way, and forget it."""
    feed.linger(0.1)
    flags.clear()


def times_in_log(process):
    """Give the differences of the times in its log to the machine's clock, in s."""
    process.popen.send_signal(signal.SIGINT)
    _, _, error = process.end()
    now = time.time()
    return [float(seconds) - now for seconds in re.findall(r'\[(\d+\.\d+)\]', error)]


def test_the_process_sees_the_jump(watched, feed, wall_clock):
    """Else the tests below say nothing: a warning after the jump carries the other time."""
    process, flags = watched
    answers_from_now_on(feed, flags)
    wall_clock.jump_to(HOUR)
    feed.publisher.publish(b'bytes that cannot be read')
    feed.until(lambda: flags)
    differences = times_in_log(process)
    assert abs(differences[0]) < HOUR / 2
    assert abs(differences[-1] - HOUR) < HOUR / 2


def test_no_reading_becomes_stale(watched, feed, wall_clock):
    process, flags = watched
    for offset in (HOUR, -HOUR, 0, -24 * HOUR, HOUR):
        answers_from_now_on(feed, flags)
        wall_clock.jump_to(offset)
        feed.until(lambda: len(flags) > 50)
        assert not any(flags), offset
    process.popen.send_signal(signal.SIGINT)
    assert_clean(process)


@pytest.mark.parametrize('offset', [HOUR, -HOUR])
def test_silence_is_told_in_time_and_nothing_becomes_fresh(watched, feed, wall_clock, offset):
    process, flags = watched
    feed.publisher.publish(JointState(name=NAMES, position=REGULAR))
    silent = time.monotonic()
    wall_clock.jump_to(offset)
    while not (flags and flags[-1]):
        feed.executor.spin_once(timeout_sec=0.01)
        assert time.monotonic() - silent < TIMEOUT + 0.5
    assert time.monotonic() - silent > TIMEOUT - 0.05
    flags.clear()
    wall_clock.jump_to(-offset)
    feed.linger(2.0 * TIMEOUT)
    assert False not in flags
    feed.until(lambda: False in flags)
    process.popen.send_signal(signal.SIGINT)
    assert_clean(process)
