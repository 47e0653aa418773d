"""
Coverage-guided fuzzing of the reader of CSV recordings.

    pip install atheris
    python3 fuzz/fuzz_recordings.py -max_total_time=180 [CORPUS FOLDER]

The arguments are libFuzzer's. Whatever the bytes: messages in the order of time, places that
could not be used, or a ValueError.
"""

import math
from pathlib import Path
import sys
import tempfile

import atheris

with atheris.instrument_imports(include=['kinopt_ros']):
    from kinopt_ros.tools.recordings import read_recording, RecordedMessage

NAMES = ['shoulder', 'elbow', 'wrist']
HEADERS = [b'', b'time,shoulder,elbow,wrist\n', b'wrist,elbow,time,shoulder,gripper\n',
           b'time;shoulder;elbow;wrist\n', b'\xef\xbb\xbftime, "shoulder",elbow,wrist\r\n']
COLUMNS = [None, None, ['time', *NAMES], [*NAMES, 'time'], ['a']]

_path = Path(tempfile.mkdtemp(prefix='kinopt_ros_fuzz_')) / 'recording.csv'


def read(content):
    """Give a file to the reader."""
    data = atheris.FuzzedDataProvider(content)
    columns = data.PickValueInList(COLUMNS)
    _path.write_bytes(data.PickValueInList(HEADERS) + data.ConsumeBytes(data.remaining_bytes()))
    latest = -math.inf
    try:
        for item in read_recording(_path, NAMES, columns):
            if isinstance(item, RecordedMessage):
                assert latest <= item.time < math.inf
                latest = item.time
                assert all(isinstance(position, float) for position in item.positions)
            else:
                assert item.place and item.reason
    except ValueError:
        return


def main():
    """Fuzz."""
    atheris.Setup(sys.argv, read)
    atheris.Fuzz()


if __name__ == '__main__':
    main()
