"""Joint states, parameters and sequences of parameters made up by hypothesis."""

import itertools
import math

from hypothesis import given, HealthCheck, settings, strategies as st
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from support import assert_numbers, expected_numbers, LENGTHS, NAMES, parameter_values, REGULAR

from kinopt_ros.monitor.configuration import Configuration
from kinopt_ros.monitor.parameters import MONITOR_TABLE
from kinopt_ros.monitor.posture_monitor import PAUSE_SLACK, PostureMonitor, SETTLING_TIME
from kinopt_ros.monitor.verdict import Level

TIMEOUT = 0.5

names = st.sampled_from([*NAMES, *NAMES, 'gripper', ''])
positions = st.one_of(st.floats(), st.floats(-4.0, 4.0), st.floats(-4.0, 4.0))
finite = st.floats(allow_nan=False, allow_infinity=False)
postures = st.lists(st.floats(-4.0, 4.0), min_size=3, max_size=3)
messages = st.one_of(
    st.tuples(st.lists(names, max_size=6), st.lists(positions, max_size=6)),
    # Bad in one place, and what may follow it: parts of the arm.
    st.tuples(st.just(NAMES), st.lists(st.sampled_from([0.5, 1.5, math.nan]), min_size=3,
                                       max_size=3)),
    st.tuples(st.sampled_from([NAMES[:1], NAMES[1:], NAMES[:2], NAMES[2:]]), postures).map(
        lambda part: (part[0], part[1][:len(part[0])])),
    st.tuples(st.permutations(NAMES), postures),
    st.tuples(st.just(NAMES), st.lists(finite, min_size=3, max_size=3)))
# A message or a look at the clock, the time until each, and the stamp's since the one before.
# The time-out is over within few steps, also where none of them is a pause of the process.
pauses = st.one_of(st.floats(0.0, 0.2), st.floats(0.2, TIMEOUT), st.floats(0.0, 1.0))
stamps = st.one_of(pauses, st.floats(-1e9, 1e9))
steps = st.lists(st.one_of(st.tuples(messages, pauses, stamps),
                           st.tuples(st.none(), pauses, st.just(0.0))), max_size=25)
EXAMPLES = [
    # A bad position, and then the others: what was known before must not stand in for it.
    [((NAMES, REGULAR), 0.1, 0.1), ((NAMES[:1], [math.nan]), 0.1, 0.1),
     ((NAMES[1:], REGULAR[1:]), 0.1, 0.1)],
    # A part goes on, the other is late; silence without a pause of the process.
    [((NAMES, REGULAR), 0.1, 0.1), *[((NAMES[:1], REGULAR[:1]), 0.3, 0.3)] * 2],
    [((NAMES, REGULAR), 0.1, 0.1), *[(None, 0.26, 0.0)] * 2],
    # Found by the soak: the difference of two finite positions is not.
    [((NAMES, [1.7e308] * 3), 0.0, 0.1), ((NAMES, [-1.7e308] * 3), 0.1, 0.1)],
    # Found by hypothesis: a phase that underflows.
    [((NAMES, [0.0, 5e-324, 0.0]), 0.0, 0.1)],
]


def search(soak, count, strategy, holds):
    """Look for what does not hold: the same examples each time, or other and more in a soak."""
    settings(max_examples=soak(count), derandomize=soak(count) <= count, deadline=None,
             database=None, suppress_health_check=[HealthCheck.too_slow])(given(strategy)(holds))()


def configuration(**changes):
    return Configuration.from_parameters(parameter_values(
        **{'joint_names': NAMES, 'link_lengths': LENGTHS, **changes}))


def within_a_turn(angles):
    # Before any sum of them: one with 1e300 would not know the other angles any more.
    return [math.atan2(math.sin(angle), math.cos(angle)) for angle in angles]


class Memory:
    """
    What is known of each joint and since when, told by the rules alone.

    Attributes
    ----------
    received : dict of str to (float, float)
        Position and time of reception of each joint that is known.
    judged_at : float
        When the last message came that was to be judged.
    """

    def __init__(self):
        self.received = {}
        self.judged_at = -math.inf
        self._last_look = math.inf
        self._settled_at = -math.inf
        self._leads = []

    def look(self, now):
        """Tell whether a pause of the process has just ended."""
        pause, self._last_look = now - self._last_look, now
        if pause > TIMEOUT + PAUSE_SLACK:
            self._settled_at = now + SETTLING_TIME
        return pause > TIMEOUT + PAUSE_SLACK

    def take(self, names, positions, now, stamp):
        """Give what is to follow a message: 'nothing', 'error' or a posture to be judged."""
        ours = [name for name in names if name in NAMES]
        if not ours or self._may_have_waited(now, stamp):
            return 'nothing'
        sound = len(set(ours)) == len(ours) and len(positions) == len(names)
        read = {name: (position, now) for name, position in zip(names, positions)
                if name in NAMES}
        if not sound or not all(math.isfinite(position) for position, _ in read.values()):
            for name in ours:
                self.received.pop(name, None)
            return 'error'
        self.received.update(read)
        if not self.is_fresh(now):
            return 'nothing'
        self.judged_at = now
        self._leads.append(stamp - now)
        return tuple(self.received[name][0] for name in NAMES)

    def is_fresh(self, now):
        """Tell whether each joint is known and none is too old."""
        return len(self.received) == len(NAMES) and all(
            time >= now - TIMEOUT for _, time in self.received.values())

    def _may_have_waited(self, now, stamp):
        lead = max(self._leads, default=math.inf)
        return now < self._settled_at and now + lead - stamp > TIMEOUT


def judges(monitor):
    return monitor.verdict.level in (Level.OK, Level.WARN)


def check_messages(steps):
    now, stamp = 100.0, 0.0
    monitor, memory = PostureMonitor(configuration(stale_timeout=TIMEOUT), now), Memory()
    for message, pause, since in steps:
        now, stamp = now + pause, stamp + since
        # The same order as in the node.
        paused = memory.look(now)
        verdict = monitor.look(now)
        assert verdict is None or (paused and verdict.level is Level.STALE)
        assert not (paused and judges(monitor))
        if message is None:
            check_silence(monitor, memory, verdict or monitor.on_time(now), now)
        elif verdict is None:
            check_message(monitor, memory, message, now, stamp)
        motion = monitor.motion()
        assert not math.isinf(motion.z_rate) and not math.isinf(motion.margin_rate)
        assert memory.is_fresh(memory.judged_at) or not judges(monitor)


def check_silence(monitor, memory, verdict, now):
    assert verdict is None or verdict.level is Level.STALE
    assert now < memory.judged_at + TIMEOUT or not judges(monitor)


def check_message(monitor, memory, message, now, stamp):
    names, positions = message
    expected = memory.take(names, positions, now, stamp)
    verdict = monitor.on_joint_state(list(names), positions, now, stamp=stamp)
    if expected == 'nothing':
        assert verdict is None
    elif expected == 'error':
        assert verdict.level is Level.ERROR
    else:
        assert monitor.positions == expected
        index = verdict.index
        assert_numbers(index, expected_numbers(LENGTHS, within_a_turn(expected)))
        assert verdict.near_singularity or not (index.z > 0.9 or index.margin < 0.05)
        assert verdict.level is (Level.WARN if verdict.near_singularity else Level.OK)


def test_any_messages_at_any_times(soak):
    """OK only for three finite positions of age below the time-out, and with their numbers."""
    for sequence in EXAMPLES:
        check_messages(sequence)
    search(soak, 150, steps, check_messages)


anything = st.one_of(
    st.floats(), st.floats(0.0, 1.0), st.sampled_from([-1.0, 0.0, 1.0, math.nan, math.inf]))
triples = st.lists(st.one_of(anything, st.floats(0.1, 2.0)), max_size=4)
values = {
    'z_max': anything, 'margin_min': anything, 'hysteresis': anything, 'min_dwell': anything,
    'stale_timeout': anything, 'diagnostics_period': anything, 'marker_rate': anything,
    'link_lengths': st.one_of(triples, st.lists(st.floats(0.1, 2.0), min_size=3, max_size=3)),
    'joint_offsets': triples, 'joint_lower': triples, 'joint_upper': triples,
    'joint_directions': st.lists(st.sampled_from([1, -1, 1, -1, 0, 2]), max_size=4),
    'model_set': st.sampled_from(['closest', 'polygon', 'Polygon', '']),
    'model_numbering': st.lists(st.integers(-1, 3), max_size=4),
    'model_mirror': st.booleans(), 'base_frame': st.text(max_size=5),
}
changes = st.lists(st.sampled_from(sorted(values)), max_size=4, unique=True).flatmap(
    lambda chosen: st.fixed_dictionaries({name: values[name] for name in chosen}))


# Few of the changes above are accepted, most of these are.
sound_changes = st.fixed_dictionaries({}, optional={
    'link_lengths': st.lists(st.floats(0.1, 2.0), min_size=3, max_size=3),
    'joint_offsets': postures, 'model_set': st.sampled_from(['closest', 'polygon']),
    'joint_directions': st.lists(st.sampled_from([1, -1]), min_size=3, max_size=3),
    'z_max': st.floats(0.5, 1.0), 'stale_timeout': st.floats(0.001, 60.0),
})
# A value of each type, for all parameters that are of another one.
A_VALUE = {
    Parameter.Type.NOT_SET: None, Parameter.Type.BOOL: True, Parameter.Type.INTEGER: 1,
    Parameter.Type.DOUBLE: 0.5, Parameter.Type.STRING: 'polygon',
    Parameter.Type.BYTE_ARRAY: [b'1'] * 3, Parameter.Type.BOOL_ARRAY: [True] * 3,
    Parameter.Type.INTEGER_ARRAY: [1] * 3, Parameter.Type.DOUBLE_ARRAY: [1.0] * 3,
    Parameter.Type.STRING_ARRAY: ['1.0'] * 3,
}
wrong_types = st.sampled_from([
    Parameter(row.name, kind, value) for row in MONITOR_TABLE if row.name in values
    for kind, value in A_VALUE.items() if kind is not row.kind])
# Parameters that are set together, one more of a wrong type among them or none, and a posture.
requests = st.one_of(
    st.tuples(sound_changes, st.none(), postures),
    st.tuples(st.one_of(changes, sound_changes), st.one_of(st.none(), wrong_types), postures))


def check_parameters(changed):
    try:
        made = configuration(**changed)
    except ValueError as error:
        assert any(row.name in str(error) for row in MONITOR_TABLE)
        return
    monitor = PostureMonitor(made, 0.0)
    verdict = monitor.on_joint_state(NAMES, REGULAR, 0.0)
    assert all(map(math.isfinite, verdict.index))
    assert 0.0 <= verdict.index.z <= 1.0 or changed.get('model_set') == 'polygon'


def test_any_parameters_are_judged_or_refused_by_name(soak):
    """A ValueError that names a parameter, or a configuration that works; nothing else."""
    search(soak, 150, changes, check_parameters)


def parameter(name, value):
    return Parameter(name, value=value) if value not in ((), []) else Parameter(
        name, Parameter.Type.INTEGER_ARRAY if name in ('joint_directions', 'model_numbering')
        else Parameter.Type.DOUBLE_ARRAY, value)


def test_any_sequence_of_parameters_leaves_the_node_at_work(make_bench, soak):
    """A refused change changes nothing; what is judged is judged by what the parameters say."""
    node = make_bench({'diagnostics_period': 0.0}).monitor
    stamps = itertools.count(1)
    judge(node, REGULAR, stamps)

    def stays_at_work(sequence):
        for changed, wrong, posture in sequence:
            change(node, changed, wrong)
            check_numbers(node)
            judge(node, posture, stamps)
            check_numbers(node)

    search(soak, 40, st.lists(requests, max_size=8), stays_at_work)


def change(node, changed, wrong):
    """Set parameters together; nothing changes if they are refused."""
    before, configuration_before = state(node), node._settings.configuration
    result = node.set_parameters_atomically(
        [parameter(name, value) for name, value in changed.items()] + ([wrong] if wrong else []))
    after = state(node)
    if result.successful:
        assert wrong is None
        for name, value in changed.items():
            assert same(after[name], value), name
    else:
        assert result.reason
        assert all(same(after[name], before[name]) for name in before)
        assert node._settings.configuration is configuration_before
    assert node._settings.configuration is node._monitor.configuration


def judge(node, posture, stamps):
    """
    Have the node judge a posture.

    Nothing spins it here: what it takes for a pause of its process it does not believe. Stamps
    that go on faster than the clock tell it soon that a message is new.
    """
    message = JointState(name=NAMES, position=posture)
    accepted = node._monitor.accepted
    for message.header.stamp.sec in itertools.islice(stamps, 100):
        node._on_joint_state(serialize_message(message))
        if node._monitor.accepted > accepted:
            assert list(node._monitor.positions) == posture
            return
    raise AssertionError('no message is believed')


def check_numbers(node):
    """Hold what is known against the parameters that are in force."""
    monitor, values = node._monitor, state(node)
    if not monitor.knows_posture:
        return
    made, index = configuration(**values), monitor.verdict.index
    assert index == made.index(monitor.positions)
    assert monitor.verdict.near_singularity or not made.thresholds.crossed(index)
    lengths = values['link_lengths']
    # Beyond that the oracle has too few digits.
    if values['model_set'] == 'closest' and max(lengths) < 1e3 * min(lengths):
        angles = [direction * position + offset for direction, position, offset in zip(
            values['joint_directions'], monitor.positions, values['joint_offsets'])]
        assert_numbers(index, expected_numbers(lengths, within_a_turn(angles)))


def state(node):
    return {name: node.get_parameter_or(name).value for name in values}


def same(one, other):
    if isinstance(one, str | bool) or one is None or other is None:
        return one == other or (one in (None, []) and other in (None, []))
    if hasattr(one, '__len__') or hasattr(other, '__len__'):
        return len(one) == len(other) and all(map(same, one, other))
    return one == other or (math.isnan(one) and math.isnan(other))
