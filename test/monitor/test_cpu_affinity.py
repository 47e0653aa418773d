"""The cores that the monitor and its solver run on, asked of the system."""

import contextlib
import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys

from processes import answer_of, ARM, assert_clean, children_of
import pytest
from std_srvs.srv import Trigger
from support import DEADLINE

from kinopt_ros.monitor import cpu_affinity

CORES = os.sched_getaffinity(0) if hasattr(os, 'sched_getaffinity') else set()

pytestmark = pytest.mark.skipif(len(CORES) < 2, reason='needs a choice of cores')


def cores_of_threads(pid):
    cores = []
    for task in Path(f'/proc/{pid}/task').iterdir():
        with contextlib.suppress(ProcessLookupError):
            cores.append(os.sched_getaffinity(int(task.name)))
    return cores


def test_all_threads_keep_to_one_core_by_default(start, feed):
    process = start(*ARM)
    feed.until(lambda: answer_of(feed))
    cores, *others = cores_of_threads(process.popen.pid)
    assert len(cores) == 1 and cores <= CORES
    # The middleware has threads of its own.
    assert len(others) >= 3 and all(other == cores for other in others)
    process.popen.terminate()
    assert_clean(process)


def policies_of_threads(pid):
    """Give (name, scheduling policy) of each thread."""
    return [((task / 'comm').read_text().strip(), os.sched_getscheduler(int(task.name)))
            for task in Path(f'/proc/{pid}/task').iterdir()]


@pytest.mark.parametrize('choice', ['one', 'all'])
def test_only_timers_wait_for_the_others_on_their_core(start, feed, choice):
    process = start(*ARM, '-p', f'cpu_affinity:={choice}')
    feed.until(lambda: answer_of(feed))
    policies = policies_of_threads(process.popen.pid)
    timers = [policy for name, policy in policies if name.startswith('dds.ev')]
    if not timers:
        pytest.skip('another middleware than Fast DDS')
    assert set(timers) == {os.SCHED_BATCH if choice == 'one' else os.SCHED_OTHER}
    assert {policy for name, policy in policies if not name.startswith('dds.ev')} == {
        os.SCHED_OTHER}


@pytest.mark.skipif(shutil.which('chrt') is None, reason='needs chrt')
def test_real_time_priority_is_left_alone(start, feed):
    """Of a process that somebody has started with it."""
    allowed = subprocess.run(['chrt', '-r', '5', 'true'], capture_output=True, check=False)
    if allowed.returncode:
        pytest.skip('real-time priority is not permitted here')
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(5))
    try:
        process = start(*ARM)
    finally:
        os.sched_setscheduler(0, *before)
    feed.until(lambda: answer_of(feed))
    assert {policy for _, policy in policies_of_threads(process.popen.pid)} == {os.SCHED_RR}


def test_solver_may_use_all_cores(start, feed):
    process = start(*ARM)
    feed.until(lambda: answer_of(feed))
    feed.until(lambda: children_of(process.popen.pid))
    first, = children_of(process.popen.pid)
    # The first one starts before the node is bound; whatever comes later has to free itself.
    os.kill(first, signal.SIGKILL)
    client = feed.node.create_client(Trigger, 'singularity_monitor/get_optimal_posture')
    feed.until(client.service_is_ready)
    asked = client.call_async(Trigger.Request())
    feed.until(asked.done)
    assert asked.result().success
    solver, = set(children_of(process.popen.pid)) - {first}
    assert set(map(frozenset, cores_of_threads(solver))) == {frozenset(CORES)}
    assert os.getpriority(os.PRIO_PROCESS, solver) == 10


def test_all_leaves_the_choice_to_the_system(start, feed):
    process = start(*ARM, '-p', 'cpu_affinity:=all')
    feed.until(lambda: answer_of(feed))
    assert all(cores == CORES
               for cores in cores_of_threads(process.popen.pid))


@pytest.mark.parametrize('value', ['', 'two', 'One', "'0'"])
def test_anything_else_is_one_line_and_status_1(start, value):
    status, _, error = start(*ARM, '-p', f'cpu_affinity:="{value}"').end()
    line, = (line for line in error.splitlines() if not line.startswith('[INFO]'))
    assert status == 1
    assert all(word in line for word in ('cpu_affinity', value, "'one' or 'all'"))


def test_is_read_only(bench):
    assert bench.get('cpu_affinity') == 'one'
    descriptor, = bench.describe('cpu_affinity')
    assert descriptor.read_only
    assert not bench.set(cpu_affinity='all')[0].successful


IN_A_PROCESS = """
import os, threading
from kinopt_ros.monitor.cpu_affinity import given_cores, keep_to_one_core, run_on
def cores_of_new_thread():
    cores = []
    thread = threading.Thread(target=lambda: cores.append(os.sched_getaffinity(0)))
    thread.start()
    thread.join()
    return cores[0]
keep_to_one_core()
print(sorted(os.sched_getaffinity(0)), sorted(cores_of_new_thread()), sorted(given_cores()))
run_on(given_cores())
print(sorted(os.sched_getaffinity(0)))
"""


@pytest.mark.skipif(shutil.which('taskset') is None, reason='needs taskset')
@pytest.mark.parametrize('core', sorted(CORES)[:2])
def test_choice_is_among_the_cores_given(core):
    """Whoever starts it on one core, with taskset for instance, has chosen already."""
    done = subprocess.run(['taskset', '-c', str(core), sys.executable, '-c', IN_A_PROCESS],
                          capture_output=True, text=True, check=True, timeout=DEADLINE)
    assert done.stdout == f'[{core}] [{core}] [{core}]\n[{core}]\n'


def test_later_threads_stay_and_a_process_can_be_freed():
    done = subprocess.run([sys.executable, '-c', IN_A_PROCESS],
                          capture_output=True, text=True, check=True, timeout=DEADLINE)
    first, second = done.stdout.splitlines()
    given = str(sorted(CORES))
    one = first[:first.index(']') + 1]
    assert first == f'{one} {one} {given}' and ',' not in one
    assert second == given


def test_core_is_the_one_that_runs_this():
    """Asked on a certain core."""
    before = os.sched_getaffinity(0)
    try:
        for core in sorted(before)[:2]:
            os.sched_setaffinity(0, {core})
            assert cpu_affinity._present_core() == core
    finally:
        os.sched_setaffinity(0, before)


def test_nothing_happens_where_the_system_knows_no_binding(monkeypatch):
    monkeypatch.setattr(cpu_affinity, '_GIVEN', None)
    before = os.sched_getaffinity(0)
    with pytest.raises(OSError, match='core'):
        cpu_affinity.keep_to_one_core()
    cpu_affinity.run_on(cpu_affinity.given_cores())
    assert os.sched_getaffinity(0) == before


FORBIDDEN = """
import os, sys
def forbid(*_):
    raise PermissionError(1, 'Operation not permitted')
os.sched_setaffinity = forbid
from kinopt_ros.executables import singularity_monitor
sys.exit(singularity_monitor())
"""


def test_where_it_is_forbidden_the_node_works_and_says_so(feed):
    node = subprocess.Popen([sys.executable, '-c', FORBIDDEN, '--ros-args', *ARM],
                            stderr=subprocess.PIPE, text=True)
    try:
        feed.until(lambda: answer_of(feed))
    finally:
        node.terminate()
        _, error = node.communicate(timeout=DEADLINE)
    assert node.returncode == 0, error
    line, = (line for line in error.splitlines() if '[WARN]' in line)
    assert 'core' in line and 'not permitted' in line and 'Traceback' not in error


def test_threads_that_end_meanwhile_are_no_error():
    """In a process of its own; threads come and go while all of them are bound."""
    code = """
import threading, time
from kinopt_ros.monitor.cpu_affinity import keep_to_one_core
over = threading.Event()
def breed():
    while not over.is_set():
        threading.Thread(target=lambda: None).start()
breeder = threading.Thread(target=breed)
breeder.start()
end = time.monotonic() + 0.3
while time.monotonic() < end:
    keep_to_one_core()
over.set()
breeder.join()
"""
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True,
                          timeout=DEADLINE)
    assert (done.returncode, done.stderr) == (0, '')
