"""ROS 1 bags, read by the library ``rosbags`` by the index at their end."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

from dvrk_gravity.errors import RecordingError
from dvrk_gravity.recording.bag_file import BagFile, Channel, one_line

MAGIC = b"#ROSBAG V"


class Ros1File(BagFile):
    """A ROS 1 ``.bag`` file with an index.

    Raises:
        RecordingError: It has none, or is of another version than 2.0.
    """

    def __init__(self, path: Path) -> None:
        """Open the file and list its connections."""
        from rosbags.rosbag1 import Reader

        super().__init__()
        self._reader = Reader(path)
        try:
            self._reader.open()
        except Exception as error:  # damaged bytes make the parser raise any
            raise RecordingError(
                path,
                f"cannot be read as a ROS 1 bag of version 2.0 ({one_line(error)}); one that was "
                f"not closed, or is cut off, is mended by `rosbag reindex {path.name}`",
            ) from error
        for each in self._reader.connections:
            self.channels[each.id] = Channel(each.topic, each.msgtype, "ros1")

    def close(self) -> None:
        """Close the file."""
        self._reader.close()

    def _messages(self, wanted: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        """Yield number of the connection, time of reception (ns) and bytes, sorted by time."""
        connections = [each for each in self._reader.connections if each.id in wanted]
        if connections:  # none would mean all
            for connection, received, data in self._reader.messages(connections):
                yield connection.id, received, data
