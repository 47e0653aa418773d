"""
The node over DDS, in a process of its own, against a bare relay of rclpy in the same run.

Latency is the time from the stamp of a JointState to the source time that the middleware gives
the z published for it; which z answers which message is told by its value. CPU time is that of
all threads of the process, user and system, by the kernel's scheduler statistics.
"""

from contextlib import ExitStack
import math
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64
from std_srvs.srv import Trigger
from timing import interval, median, p99

from kinopt_ros.kinetostatics.index import kinetostatic_index
from kinopt_ros.kinetostatics.planar_arm import PlanarArm

RATES = (100, 500, 1000)
NAMES = ['shoulder', 'elbow', 'wrist']
LENGTHS = (1.0, 1.0, math.sqrt(3.0) / 3.0)
# So many postures pass before one comes again: longer than any latency.
POSTURES = 5000
START_DEADLINE = 20.0
WARM_UP = 0.3
# A message that has no answer after this time (s) is lost.
LONGEST_LATENCY = 0.3

MONITOR = ('import sys; from kinopt_ros import executables; '
           'sys.exit(executables.singularity_monitor())')
PARAMETERS = ['-p', f'joint_names:=[{", ".join(NAMES)}]',
              '-p', f'link_lengths:=[{", ".join(map(repr, LENGTHS))}]']


def monitor(executor, cores='one'):
    """Command that starts the monitor."""
    return [sys.executable, '-c', MONITOR, '--ros-args', '-p', f'executor:={executor}',
            '-p', f'cpu_affinity:={cores}', *PARAMETERS]


def relay(executor):
    """Command that starts the relay."""
    return [sys.executable, Path(__file__).with_name('relay.py'), executor,
            '--ros-args', '-r', '__node:=singularity_monitor']


SYSTEMS = {
    'relay, single': relay('single'),
    'relay, events': relay('events'),
    'monitor, single': monitor('single'),
    'monitor, events': monitor('events'),
    'monitor, all cores': monitor('events', 'all'),
}
# What all are compared with.
PLAIN = 'relay, single'
# Beside z, which the probe hears in any case.
OTHER_TOPICS = {'conditioning_length': Float64, 'margin': Float64, 'near_singularity': Bool}


class Probe:
    """
    A node that sends joint states at a rate and hears z, with the process that it measures.

    Parameters
    ----------
    command : list of str
        Of the process that is measured; it ends with the probe.
    namespace : str
        Of the node and of that process.
    hear_all : bool
        Whether the other topics have a subscriber too.

    Attributes
    ----------
    startup : float
        Time in s from its start to the first z.
    """

    def __init__(self, command, namespace='probed', hear_all=False):
        self._node = Node('probe', namespace=namespace)
        # No executor calls it: that a message gets here is enough.
        self._listener = Node('listener', namespace=namespace)
        for name, message_type in OTHER_TOPICS.items() if hear_all else ():
            self._listener.create_subscription(
                message_type, f'singularity_monitor/{name}', lambda _: None, 1)
        # The EventsExecutor of rclpy 7.1 cannot call a callback that asks for the source time.
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._publisher = self._node.create_publisher(JointState, 'joint_states', 10)
        self._node.create_subscription(Float64, 'singularity_monitor/z', self._hear, 1000)
        self._client = self._node.create_client(
            Trigger, 'singularity_monitor/get_optimal_posture')
        elbows = [0.2 + 1.0 * i / POSTURES for i in range(POSTURES)]
        self._positions = [[0.0, elbow, 1.0] for elbow in elbows]
        arm = PlanarArm(LENGTHS)
        self._number = {kinetostatic_index(arm, p).z: i for i, p in enumerate(self._positions)}
        self._number.update({elbow: i for i, elbow in enumerate(elbows)})
        self._sent, self._heard = {}, {}
        started = time.monotonic()
        self._process = subprocess.Popen(
            [*command, '-r', f'__ns:=/{namespace}'], stdin=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        try:
            self.startup = self._first_answer(started)
        except BaseException:
            self.close()
            raise

    def _first_answer(self, started):
        while not self._heard:
            if time.monotonic() - started > START_DEADLINE or self._process.poll() is not None:
                raise RuntimeError(f'no answer of {self._process.args}')
            self._send(0)
            self._spin_until(time.monotonic() + 0.002)
        return time.monotonic() - started

    def _send(self, count):
        message = JointState(name=NAMES, position=self._positions[count % POSTURES])
        now = time.time_ns()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(now, 10**9)
        self._sent[count] = now
        self._publisher.publish(message)

    def _hear(self, message, info):
        number = self._number.get(message.data)
        if number is not None:
            self._heard.setdefault(number, []).append(info['source_timestamp'])

    def run(self, rate, seconds, ask=False):
        """
        Send for a while and give the figures.

        Parameters
        ----------
        rate : float
            In Hz.
        seconds : float
        ask : bool
            Whether to ask for the optimal posture in a tight loop meanwhile.
        """
        self._paced(rate, WARM_UP)
        self._sent, self._heard = {}, {}
        cpu, memory = self._cpu(), self._resident()
        self._asked, self._asking = 0, ask
        if ask:
            self._ask()
        self._paced(rate, seconds)
        self._asking = False
        cpu = self._cpu() - cpu
        self._spin_until(time.monotonic() + LONGEST_LATENCY)
        latencies = self._latencies()
        return {'rate_hz': rate, 'seconds': seconds, 'sent': len(self._sent),
                'lost': len(self._sent) - len(latencies),
                'cpu_us_per_message': cpu / len(self._sent) * 1e6,
                'latencies_us': np.array(latencies),
                'memory_growth_mb': self._resident() - memory, 'memory_mb': self._resident(),
                'answers': self._asked}

    def _paced(self, rate, seconds):
        """Send at a rate; what could not be sent in time is left out, as a timer does."""
        begun = time.monotonic()
        due = count = 0
        while due < rate * seconds:
            self._spin_until(begun + due / rate)
            self._send(count)
            count += 1
            due = max(due + 1, math.ceil((time.monotonic() - begun) * rate))
        self._spin_until(begun + seconds)

    def _spin_until(self, end):
        while (remaining := end - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=remaining)

    def _latencies(self):
        """Latencies in us of the messages that were answered."""
        times = {number: iter(stamps) for number, stamps in self._heard.items()}
        latencies = []
        for count, sent in self._sent.items():
            # An answer may still be one from before.
            answer = next((time for time in times.get(count % POSTURES, ()) if time >= sent), None)
            if answer is not None:
                latencies.append((answer - sent) / 1e3)
        return latencies

    def _ask(self):
        if self._client.service_is_ready() and self._asking:
            self._client.call_async(Trigger.Request()).add_done_callback(self._answered)

    def _answered(self, _):
        self._asked += 1
        self._ask()

    def _cpu(self):
        """CPU time in s of all threads of the process."""
        total = 0
        for path in Path(f'/proc/{self._process.pid}/task').iterdir():
            total += int((path / 'schedstat').read_text().split()[0])
        return total * 1e-9

    def _resident(self):
        pages = int(Path(f'/proc/{self._process.pid}/statm').read_text().split()[1])
        return pages * os.sysconf('SC_PAGE_SIZE') / 1e6

    def take_real_time_priority(self):
        """Put the process that is measured and this one before all others, not its solver."""
        for process in (self._process.pid, os.getpid()):
            for task in Path(f'/proc/{process}/task').iterdir():
                os.sched_setscheduler(int(task.name), os.SCHED_RR, os.sched_param(5))

    def close(self):
        """End the process and the node."""
        self._process.send_signal(signal.SIGINT)
        self._process.wait(10.0)
        self._executor.shutdown()
        self._node.destroy_node()
        self._listener.destroy_node()


def measure(seconds, rounds, turns, rates=RATES):
    """
    Give a row for each system and rate, compared with the plain relay.

    Each system runs beside a plain relay, and the two are fed in turn: the machine is another
    one from minute to minute. In the first rows somebody listens to z alone; monitor and relay
    come once more with all their topics heard.

    Parameters
    ----------
    seconds : float
        Length of a turn.
    rounds, turns : int
        Pairs of processes for each system, and turns of each pair at each rate.
    rates : sequence of float
        In Hz.
    """
    systems = [(name, '') for name in SYSTEMS if name != PLAIN]
    systems.append(('monitor, events', ', all heard'))
    results = {}
    for _ in range(rounds):
        for name, heard in systems:
            for rate, pairs in _alternating(name, bool(heard), seconds, turns, rates):
                results.setdefault((name, heard, rate), []).append(pairs)
    rows = [_row(PLAIN + heard, [[(plain, plain) for _, plain in pairs]
                                 for (_, h, r), rounds_of_it in results.items()
                                 if (h, r) == (heard, rate) for pairs in rounds_of_it])
            for heard in ('', ', all heard') for rate in rates]
    return rows + [_row(name + heard, pairs) for (name, heard, _), pairs in results.items()]


def _alternating(name, hear_all, seconds, turns, rates):
    """Yield each rate with the figures of the system and of the plain relay, turn by turn."""
    with ExitStack() as stack:
        probes = []
        for system, namespace in ((name, 'other'), (PLAIN, 'plain')):
            probes.append(Probe(SYSTEMS[system], namespace, hear_all))
            stack.callback(probes[-1].close)
        for rate in rates:
            pairs = []
            for turn in range(turns):
                order = probes if turn % 2 else probes[::-1]
                figures = {probe: probe.run(rate, seconds) for probe in order}
                pairs.append([figures[probe] for probe in probes])
            yield rate, pairs


# What the turns of one system say together.
FIGURES = {
    'cpu_us_per_message': lambda turns: np.mean([turn['cpu_us_per_message'] for turn in turns]),
    'latency_median_us': lambda turns: median(_all_latencies(turns)),
    'latency_p99_us': lambda turns: p99(_all_latencies(turns)),
}


def _all_latencies(turns):
    return np.concatenate([turn['latencies_us'] for turn in turns])


def _row(name, rounds):
    """
    Figures of a system over all rounds, and their ratios to those of the plain relay.

    The 95 % intervals of the ratios are those of resampled rounds: turns of one pair of processes
    have much in common.

    Parameters
    ----------
    rounds : list of list of (dict, dict)
        Figures of the system and of the relay, by round and turn.
    """
    own, _ = _by_system(rounds)
    row = {'system': name, 'rate_hz': own[0]['rate_hz'], 'turns': len(own),
           'lost': sum(turn['lost'] for turn in own), 'sent': sum(turn['sent'] for turn in own)}
    for key, figure in FIGURES.items():
        def ratio(rounds, figure=figure):
            own, plain = _by_system(rounds)
            return figure(own) / figure(plain)
        row[key], row[f'{key}_ratio'] = float(figure(own)), float(ratio(rounds))
        row[f'{key}_ratio_interval'] = interval(rounds, ratio)
    return row


def _by_system(rounds):
    return zip(*(pair for pairs in rounds for pair in pairs))


def endurance(seconds):
    """Messages lost, the longest latency, and memory, at 1000 Hz: the monitor, and the relay."""
    return {name: _alone(name, 1000, seconds) for name in ('monitor, events', PLAIN)}


def _alone(name, rate, seconds):
    probe = Probe(SYSTEMS[name])
    try:
        figures = probe.run(rate, seconds)
    finally:
        probe.close()
    latencies = figures.pop('latencies_us')
    return {**figures, 'wanted': round(rate * seconds),
            'latency_longest_us': float(max(latencies))}


def under_load(seconds):
    """
    Figures at 500 Hz without and with requests for the optimum in a tight loop.

    Once with the priority of any process, and once, where that is permitted, with a real-time
    priority of the monitor and of the probe, as controllers have it: what remains then is the
    monitor's own waiting, without the system's choice of who runs on which core.
    """
    probe = Probe(SYSTEMS['monitor, events'])
    try:
        rows = {'any priority': _idle_and_loaded(probe, seconds)}
        try:
            probe.take_real_time_priority()
        except PermissionError as error:
            rows['real time'] = {'skipped': str(error)}
        else:
            rows['real time'] = _idle_and_loaded(probe, seconds)
        return rows
    finally:
        probe.close()
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def _idle_and_loaded(probe, seconds):
    rows = {}
    for name, ask in (('idle', False), ('loaded', True)):
        figures = probe.run(500, seconds, ask)
        latencies = figures.pop('latencies_us')
        rows[name] = {**figures, 'latency_median_us': median(latencies),
                      'latency_p99_us': p99(latencies)}
    return {**rows, 'latency_p99_ratio':
            rows['loaded']['latency_p99_us'] / rows['idle']['latency_p99_us']}


def startup(times):
    """Seconds from the start of the process to its first z."""
    samples = {name: [] for name in SYSTEMS}
    for _ in range(times):
        for name, command in SYSTEMS.items():
            probe = Probe(command)
            samples[name].append(probe.startup)
            probe.close()
    return {name: {'median_s': median(values), 'worst_s': max(values)}
            for name, values in samples.items()}


def begin():
    """Start rclpy; after the domain is chosen."""
    rclpy.init()


def end():
    """Shut rclpy down."""
    rclpy.try_shutdown()
