"""
Coverage-guided fuzzing of the reader of serialized JointStates.

    pip install atheris
    python3 fuzz/fuzz_joint_state.py -max_total_time=180 [CORPUS FOLDER]

The arguments are libFuzzer's. Whatever the bytes, and whatever was read before: what the
middleware reads, or an error where it reads nothing.
"""

import struct
import sys

import atheris
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

with atheris.instrument_imports(include=['kinopt_ros']):
    from kinopt_ros.monitor.joint_state_reader import JointStateReader, UnreadableError

SOUND = [serialize_message(JointState(name=names, position=[0.5] * len(names), velocity=rates))
         for names in ([], ['a'], ['shoulder', 'elbow', 'wrist']) for rates in ([], [0.1, 0.2])]


def bits(values):
    """Give the bytes of doubles."""
    return struct.pack(f'{len(values)}d', *values)


def read(content):
    """Change bytes of a sound message, after the reader has seen it, and read that."""
    data = atheris.FuzzedDataProvider(content)
    reader = JointStateReader()
    sound = data.PickValueInList(SOUND)
    reader.read(sound)
    changed = bytearray(sound)
    for _ in range(data.ConsumeIntInRange(0, 4)):
        changed[data.ConsumeIntInRange(0, len(changed) - 1)] = data.ConsumeIntInRange(0, 255)
    changed = bytes(changed[:data.ConsumeIntInRange(0, len(changed))])
    for message in (changed, changed + data.ConsumeBytes(data.remaining_bytes())):
        compare(reader, message)


def compare(reader, data):
    """Hold the reader against the middleware."""
    try:
        expected = deserialize_message(data, JointState)
    except RuntimeError:
        expected = None
    try:
        reading = reader.read(data)
    except UnreadableError:
        reading = None
    if expected is None or reading is None:
        assert expected is reading
        return
    assert (reading.header, reading.names) == (expected.header, expected.name)
    assert bits(reading.positions) == bits(expected.position)
    assert bits(reading.velocities) == bits(expected.velocity)


def main():
    """Fuzz."""
    atheris.Setup(sys.argv, read)
    atheris.Fuzz()


if __name__ == '__main__':
    main()
