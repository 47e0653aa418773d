"""Bytes of JointStates are read as the middleware reads them, with fewer steps."""

import random
import struct

from hypothesis import example, given, HealthCheck, settings, strategies
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from support import assert_numbers, expected_numbers, LENGTHS, NAMES, REGULAR

from kinopt_ros.monitor import joint_state_reader
from kinopt_ros.monitor.joint_state_reader import JointStateReader, UnreadableError

PROPERTY = settings(deadline=None, derandomize=True, database=None,
                    suppress_health_check=[HealthCheck.too_slow])
TEXTS = strategies.text(
    strategies.characters(codec='utf-8', exclude_characters='\0'), max_size=9)
DOUBLES = strategies.lists(strategies.floats(), max_size=4)
HEADERS = strategies.builds(
    Header, frame_id=TEXTS,
    stamp=strategies.builds(type(Header().stamp), sec=strategies.integers(-2**31, 2**31 - 1),
                            nanosec=strategies.integers(0, 2**32 - 1)))
JOINT_STATES = strategies.builds(
    JointState, header=HEADERS,
    name=strategies.lists(TEXTS, max_size=4), position=DOUBLES, velocity=DOUBLES, effort=DOUBLES)


def bits(values):
    return struct.pack(f'{len(values)}d', *values)


def assert_read_as_by_the_middleware(reader, data):
    try:
        message = deserialize_message(data, JointState)
    except RuntimeError:
        with pytest.raises(UnreadableError, match=f'{len(data)} bytes'):
            reader.read(data)
        return
    reading = reader.read(data)
    assert reading.header == message.header
    assert reading.names == message.name
    assert bits(reading.positions) == bits(message.position)
    assert bits(reading.velocities) == bits(message.velocity)
    stamp = message.header.stamp
    assert reading.stamp == pytest.approx(stamp.sec + 1e-9 * stamp.nanosec, abs=1e-6)


def without_the_middleware(monkeypatch):
    def refuse(*_):
        raise AssertionError('read by the middleware')
    monkeypatch.setattr(joint_state_reader, 'deserialize_message', refuse)


def sample(positions=REGULAR, names=NAMES, **fields):
    return JointState(name=names, position=positions, **fields)


@PROPERTY
@given(strategies.lists(JOINT_STATES, min_size=1, max_size=12), strategies.randoms())
def test_any_messages_in_turn(messages, rng):
    reader = JointStateReader()
    for message in rng.choices(messages, k=24):
        message.header.stamp.sec = rng.randrange(2**31)
        for numbers in (message.position, message.velocity, message.effort):
            for place in range(len(numbers)):
                numbers[place] = rng.gauss(0.0, 1e3)
        assert_read_as_by_the_middleware(reader, serialize_message(message))


@PROPERTY
@given(JOINT_STATES, strategies.randoms())
@example(sample(), random.Random(1))
def test_any_damage(message, rng):
    """A byte that is another, bytes cut off or appended: as the middleware has it, or an error."""
    reader = JointStateReader()
    sound = serialize_message(message)
    reader.read(sound)
    for _ in range(20):
        damaged = bytearray(sound)
        damaged[rng.randrange(len(damaged))] = rng.randrange(256)
        length = rng.choice([len(damaged), rng.randrange(len(damaged) + 1)])
        assert_read_as_by_the_middleware(
            reader, bytes(damaged[:length]) + rng.randbytes(rng.choice([0, 0, 3, 8])))


@PROPERTY
@given(strategies.binary(max_size=80))
def test_any_bytes(data):
    reader = JointStateReader()
    for _ in range(2):
        assert_read_as_by_the_middleware(reader, b'\x00\x01\x00\x00' + data)
        assert_read_as_by_the_middleware(reader, data)


@pytest.mark.parametrize('fields', [
    {}, {'velocity': [0.1, 0.2, 0.3]}, {'velocity': [0.1], 'effort': [1.0, 2.0, 3.0]},
    {'header': Header(frame_id='base')}, {'names': ['é', '', 'a longer name of a joint']}])
def test_second_message_is_read_without_the_middleware(monkeypatch, fields):
    reader = JointStateReader()
    first, second = (serialize_message(sample(positions, **fields))
                     for positions in ([0.1, 0.2, 0.3], [1e300, float('-inf'), -0.0]))
    reader.read(first)
    expected = deserialize_message(second, JointState)
    without_the_middleware(monkeypatch)
    reading = reader.read(second)
    assert bits(reading.positions) == bits(expected.position)
    assert bits(reading.velocities) == bits(expected.velocity)
    assert reading.names == expected.name
    assert reading.header == expected.header


def test_parts_of_eight_publishers_in_turn(monkeypatch):
    reader = JointStateReader()
    names = list('abcdefgh')
    parts = [serialize_message(sample([float(i)], [name])) for i, name in enumerate(names)]
    for part in parts:
        reader.read(part)
    without_the_middleware(monkeypatch)
    for _ in range(3):
        assert [(r.names, r.positions) for r in map(reader.read, parts)] == [
            ([name], (float(i),)) for i, name in enumerate(names)]


def test_bytes_between_the_values_may_be_anything(monkeypatch):
    """What fills up the encoding is left as it happens to be by the middleware."""
    reader = JointStateReader()
    data = serialize_message(sample(names=['a', 'bcd', 'efghi']))
    reader.read(data)
    # Behind 'a' and its end there are two such bytes.
    place = data.index(b'a\0') + 2
    other = data[:place] + b'\xaa\xbb' + data[place + 2:]
    assert other != data
    assert deserialize_message(other, JointState) == deserialize_message(data, JointState)
    without_the_middleware(monkeypatch)
    assert reader.read(other) == reader.read(data)


def test_other_byte_order_is_left_to_the_middleware():
    """Most significant byte first: read, never as if it were the other order."""
    texts = b''.join(struct.pack('>I4s', 2, name + b'\0\0\0') for name in (b'a', b'b', b'c'))
    data = (b'\0\0\0\0' + struct.pack('>iII4sI', 5, 7, 1, b'\0\0\0\0', 3) + texts
            + struct.pack('>I3dII', 3, *REGULAR, 0, 0))
    reader = JointStateReader()
    for _ in range(2):
        reading = reader.read(data)
        assert reading.names == ['a', 'b', 'c']
        assert list(reading.positions) == REGULAR
        assert (reading.seconds, reading.nanoseconds) == (5, 7)


def test_names_by_the_ten_thousand_are_left_to_the_middleware(monkeypatch):
    reader = JointStateReader()
    names = [f'joint_{i}' for i in range(10_000)]
    data = serialize_message(sample([0.5] * len(names), names))
    for _ in range(2):
        assert reader.read(data).names == names
    without_the_middleware(monkeypatch)
    with pytest.raises(AssertionError, match='by the middleware'):
        reader.read(data)


def test_unreadable_bytes_are_told_and_the_next_message_is_believed(bench, capfd):
    for _ in range(3):
        bench.publisher.publish(b'\x00\x01\x00\x00' + b'\xff' * 60)
    numbers, _ = bench.cycle(REGULAR)
    assert_numbers(numbers, expected_numbers(LENGTHS, REGULAR))
    told = [line for line in capfd.readouterr().err.splitlines() if 'no JointState' in line]
    assert len(told) == 1 and 'joint_states: 64 bytes' in told[0] and '[WARN]' in told[0]
