"""
JointState messages as they come over the wire, read in one step.

From one message of a publisher to the next only the stamp and the numbers change. To make all
fields of a JointState anew takes more time than to judge its posture, so what stays the same is
compared as bytes, and only the numbers are made.
"""

import struct
from typing import NamedTuple

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

# Layouts kept: an arm's parts may come from so many publishers in turn.
_MOST_LAYOUTS = 8
# Of longer messages (bytes) there is no time to win, and nothing to be kept.
_LONGEST = 8192


class UnreadableError(ValueError):
    """Bytes that are no JointState."""


class Reading(NamedTuple):
    """
    What a JointState says, but for the efforts.

    Attributes
    ----------
    seconds, nanoseconds : int
        Of the stamp.
    frame_id : str
    names : list of str
    positions, velocities : sequence of float
        In rad and rad/s.
    """

    seconds: int
    nanoseconds: int
    frame_id: str
    names: list
    positions: tuple
    velocities: tuple

    @property
    def stamp(self):
        """Time of the stamp in s."""
        return self.seconds + 1e-9 * self.nanoseconds

    @property
    def header(self):
        """Header of the message."""
        header = Header(frame_id=self.frame_id)
        header.stamp.sec, header.stamp.nanosec = self.seconds, self.nanoseconds
        return header


class JointStateReader:
    """Read the serialized messages of one topic."""

    def __init__(self):
        self._layouts = ()

    def read(self, data):
        """
        Read a message.

        Parameters
        ----------
        data : bytes
            A serialized sensor_msgs/JointState.

        Returns
        -------
        reading : Reading

        Raises
        ------
        UnreadableError
            If it is none.
        """
        for layout in self._layouts:
            reading = layout.read(data)
            if reading is not None:
                return reading
        try:
            message = deserialize_message(data, JointState)
        except RuntimeError as error:
            # Where in its own sources the middleware says so is nothing for people.
            reason = str(error).split(', at ')[0]
            raise UnreadableError(f'{len(data)} bytes that are no JointState: {reason}') from error
        self._learn(message, data)
        stamp = message.header.stamp
        return Reading(stamp.sec, stamp.nanosec, message.header.frame_id, message.name,
                       message.position, message.velocity)

    def _learn(self, message, data):
        if len(data) > _LONGEST:
            return
        layout = _Layout(message)
        reading = layout.read(data)
        # The middleware's own reading decides whether this one is right.
        if (reading is not None and reading.header == message.header
                and _same_bits(reading.positions, message.position)
                and _same_bits(reading.velocities, message.velocity)):
            self._layouts = (layout, *self._layouts[:_MOST_LAYOUTS - 1])


class _Layout:
    """
    Where things are in messages of one frame, one list of names and so many values.

    The encoding is DDS's CDR, least byte first: four bytes that name it, then each value at a
    multiple of its size. What is between two values may be anything.

    Parameters
    ----------
    message : JointState
        One of these messages.
    """

    def __init__(self, message):
        self._frame_id, self._names = message.header.frame_id, message.name
        self._constants, self._size = [b'\x00\x01\x00\x00'], 0
        self._constant_form, self._number_form = '<4s', '<4x'
        self._add_numbers('iI', 8)
        self._add_text(self._frame_id)
        self._add_constant('I', 4, len(self._names))
        for name in self._names:
            self._add_text(name)
        self._end_of_positions = 2 + len(message.position)
        for values in (message.position, message.velocity):
            self._add_constant('I', 4, len(values))
            self._add_numbers(f'{len(values)}d', 8 * len(values))
        self._add_constant('I', 4, len(message.effort))
        self._add_numbers(f'{8 * len(message.effort)}x', 8 * len(message.effort))
        self._constants = tuple(self._constants)
        self._constant_fields = struct.Struct(self._constant_form)
        self._number_fields = struct.Struct(self._number_form)

    def _add_text(self, text):
        encoded = text.encode() + b'\x00'
        self._add_constant('I', 4, len(encoded))
        self._add_constant(f'{len(encoded)}s', len(encoded), encoded, alignment=1)

    def _add_constant(self, code, size, value, alignment=4):
        self._align(alignment)
        self._constants.append(value)
        self._constant_form += code
        self._number_form += f'{size}x'
        self._size += size

    def _add_numbers(self, code, size):
        if size:
            self._align(8)
            self._constant_form += f'{size}x'
            self._number_form += code
            self._size += size

    def _align(self, alignment):
        gap = -self._size % alignment
        self._constant_form += f'{gap}x'
        self._number_form += f'{gap}x'
        self._size += gap

    def read(self, data):
        """Give the Reading of a message; None if it is not one of these."""
        if (len(data) < self._constant_fields.size
                or self._constant_fields.unpack_from(data) != self._constants):
            return None
        fields = self._number_fields.unpack_from(data)
        end = self._end_of_positions
        return Reading(fields[0], fields[1], self._frame_id, self._names, fields[2:end],
                       fields[end:])


def _same_bits(values, array_of_doubles):
    return struct.pack(f'{len(values)}d', *values) == array_of_doubles.tobytes()
