"""
Recordings of joint states: CSV files and rosbag2 bags (mcap, sqlite3), read message by message.

Whatever stands in a file comes out either as a message, numbers that cannot be read being NaN in
it, or as a place in the file and the reason why nothing there could be used.
"""

import csv
import math
from pathlib import Path
from typing import NamedTuple

# Longest line of a CSV, in characters: some thousand joints.
MAX_LINE = 100_000

JOINT_STATE = 'sensor_msgs/msg/JointState'

INSTALL_HINT = 'reading a bag needs the package rosbags: pip install rosbags'


class RecordedMessage(NamedTuple):
    """
    A message of a recording.

    Attributes
    ----------
    place : str
        Where it stands in the file.
    time : float
        Time in s, as recorded; in a bag since its first message.
    names : list of str
    positions : sequence of float
        rad; as many as names if the recording is sound.
    """

    place: str
    time: float
    names: list
    positions: object


class Unusable(NamedTuple):
    """
    A place in a recording that cannot be given a time, and hence no posture.

    Attributes
    ----------
    place, reason : str
    """

    place: str
    reason: str


def read_recording(path, joint_names, columns=None, topic=None, progress=lambda done, total: None):
    """
    Messages of a CSV file or of a bag.

    Parameters
    ----------
    path : path-like
        A directory, or a file that ends in .mcap or .db3, is a bag; another file is a CSV.
    joint_names : sequence of str
        Joints of the arm; of a CSV, meaning the columns behind the time if nothing else tells.
    columns : sequence of str, optional
        Names of the columns of a CSV without header.
    topic : str, optional
        Topic of a bag, if there are joint states on several.
    progress : callable
        Told now and then how much of how much is done (bytes or messages).

    Yields
    ------
    item : RecordedMessage or Unusable

    Raises
    ------
    ValueError
        If the file as a whole cannot be read or does not hold the joints.
    ImportError
        If it is a bag and rosbags is not installed.
    OSError
        If the file cannot be opened.
    """
    path = Path(path)
    if path.is_dir() or path.suffix in ('.mcap', '.db3'):
        items = _bag_items(path, joint_names, topic, progress)
    else:
        items = _csv_items(path, joint_names, columns, progress)
    return _in_order(items)


def _in_order(items):
    """Pass on what is in the order of time."""
    latest = -math.inf
    for item in items:
        if isinstance(item, RecordedMessage):
            if not math.isfinite(item.time):
                item = Unusable(item.place, 'has no finite time')
            elif item.time < latest:
                item = Unusable(item.place, f'its time {item.time!r} s is before {latest!r} s')
            else:
                latest = item.time
        yield item


def _csv_items(path, joint_names, columns, progress):
    total = path.stat().st_size
    # Bytes that are no text become characters that are no numbers, in their own line only.
    with path.open(encoding='utf-8-sig', errors='replace', newline='') as file:
        rows = _rows(file, lambda done: progress(done, total))
        place, fields = next(rows, (None, None))
        if fields is None:
            raise ValueError(f'{path}: holds no row')
        is_header = columns is None and not any(map(_is_number, fields))
        if is_header:
            columns = fields
        elif columns is None:
            columns = _default_columns(fields, joint_names)
        _check_columns(columns, joint_names)
        if not is_header:
            yield _message(place, fields, columns)
        for place, fields in rows:
            yield _message(place, fields, columns)


def _rows(file, progress):
    """Places and fields of the lines that are not empty."""
    done = 0
    for number, line in enumerate(_lines(file), start=1):
        done += len(line)
        progress(done)
        fields = _fields(line)
        if any(fields):
            yield f'line {number}', fields


def _lines(file):
    while line := file.readline(MAX_LINE + 1):
        if len(line) > MAX_LINE:
            raise ValueError(f'{file.name}: a line has more than {MAX_LINE} characters, this is '
                             'no recording')
        yield line


def _fields(line):
    """Fields of one line; a quote left open ends with it."""
    try:
        return [field.strip() for field in next(csv.reader([line], skipinitialspace=True), [])]
    except csv.Error as error:
        return [f'({error})']


def _default_columns(fields, joint_names):
    if len(fields) != len(joint_names) + 1:
        raise ValueError(
            f'the recording has no header and {len(fields)} columns, not the time and the '
            f'{len(joint_names)} joints of the arm: name the columns (--columns)')
    return ['time', *joint_names]


def _check_columns(columns, joint_names):
    for name in joint_names:
        if columns.count(name) != 1:
            raise ValueError(f"the recording has {columns.count(name)} columns for the joint "
                             f"'{name}', must have one; its columns are {list(columns)}")


def _message(place, fields, columns):
    """Turn a row of a CSV into a message; the time is its first column unless one is named so."""
    slot = columns.index('time') if 'time' in columns else 0
    names = [*columns[:slot], *columns[slot + 1:]]
    numbers = [float(field) if _is_number(field) else math.nan for field in fields]
    time = numbers.pop(slot) if len(numbers) > slot else math.nan
    return RecordedMessage(place, time, names, numbers)


def _is_number(field):
    try:
        float(field)
    except ValueError:
        return False
    return True


def _bag_items(path, joint_names, topic, progress):
    try:
        from rosbags.rosbag2 import Reader
        from rosbags.typesys import get_typestore, Stores
    except ImportError as error:
        raise ImportError(f'{INSTALL_HINT} ({error})') from error
    # JointState is the same in all distributions, whatever definitions the bag brings along.
    typestore = get_typestore(Stores.ROS2_JAZZY)
    number = 0
    try:
        with Reader(path) as reader:
            connections = _joint_state_connections(reader, topic)
            total = sum(connection.msgcount for connection in connections)
            origin = reader.start_time
            for number, (_, stamp, data) in enumerate(reader.messages(connections), start=1):
                progress(number, total)
                yield _bag_message(f'message {number}', (stamp - origin) * 1e-9, data, typestore)
    except (OSError, _BagRefusedError):
        raise
    # A damaged bag makes its reader raise whatever its bytes lead to.
    except Exception as error:
        raise ValueError(f'{path}: cannot be read behind message {number}: '
                         f'{type(error).__name__}: {str(error)[:300]}') from error


class _BagRefusedError(ValueError):
    """The bag is sound but not what is asked for."""


def _joint_state_connections(reader, topic):
    found = [connection for connection in reader.connections
             if connection.msgtype == JOINT_STATE]
    topics = sorted({connection.topic for connection in found})
    if topic is None and len(topics) == 1:
        return found
    if topic in topics:
        return [connection for connection in found if connection.topic == topic]
    wanted = 'choose one (--topic)' if topic is None else f'not on {topic}'
    raise _BagRefusedError(f'the bag has joint states on {topics or "no topic"}: {wanted}')


def _bag_message(place, time, data, typestore):
    try:
        message = typestore.deserialize_cdr(data, JOINT_STATE)
    # As above: a message of a damaged bag can be anything.
    except Exception as error:
        return Unusable(place, f'is no {JOINT_STATE}: {str(error)[:200]}')
    return RecordedMessage(place, time, list(message.name), message.position.tolist())
