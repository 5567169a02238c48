"""Reading rosbag2 recordings (sqlite3, mcap) without ROS."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any

from dvrk_gravity.errors import RecordingError
from dvrk_gravity.files import text_file, yaml_file

JOINT_STATE = "sensor_msgs/msg/JointState"
SUFFIXES = (".db3", ".mcap")
URI_MARKS = "?#%"  # the library opens sqlite3 files by URI and does not quote these


@cache
def typestore() -> Any:
    """Return the message definitions of ROS 2 Jazzy (a ``rosbags`` type store)."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


class BagReader:
    """A rosbag2 folder or a bare ``.db3`` / ``.mcap`` file, open for reading (context manager).

    Attributes:
        path: Folder or file.
        topics: Message type of every topic.

    Raises:
        RecordingError: On entering and reading, for whatever is wrong with the files.
    """

    def __init__(self, path: str | Path) -> None:
        """Store the path; nothing is opened before ``with``."""
        self.path = Path(path)
        self.topics: dict[str, str] = {}

    def __enter__(self) -> BagReader:
        """Open the bag and list its topics."""
        from rosbags.rosbag2 import Reader

        if not self.path.exists():
            raise RecordingError(self.path, "no such file or folder")
        for path in (self.path, *(p for p in self._inside() if p.suffix in SUFFIXES)):
            if not text_file.is_file(path):
                raise RecordingError(path, "is a pipe or device, expected a file of a rosbag2")
        if self.path.is_dir() and not (self.path / "metadata.yaml").exists():
            inside = [p.name for p in self._inside() if p.suffix in SUFFIXES]
            hint = f"; try the file {inside[0]} in it" if inside else ""
            raise RecordingError(
                self.path, f"has no metadata.yaml, expected the folder of a rosbag2{hint}"
            )
        try:
            if self.path.is_dir():
                yaml_file.load(self.path / "metadata.yaml")  # the library's reader has no limits
            self._reader = Reader(self.path)
            self._reader.open()
            self.topics = {c.topic: c.msgtype for c in self._reader.connections}
            if not all(isinstance(text, str) for pair in self.topics.items() for text in pair):
                raise TypeError("a topic's name or type is no text")
        except Exception as error:
            # The library's parsers raise whatever damaged bytes lead them to.
            raise self._broken(error) from error
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the files."""
        self._reader.close()

    def _inside(self) -> list[Path]:
        return sorted(self.path.iterdir()) if self.path.is_dir() else []

    def _broken(self, error: Exception) -> RecordingError:
        text = " ".join(str(error).split()) or type(error).__name__
        if any(mark in str(self.path) for mark in URI_MARKS):
            text += f" (sqlite3 bags cannot be opened under a path with any of {URI_MARKS})"
        return RecordingError(
            self.path, f"cannot be read as a rosbag2 (cut off or damaged?): {text[:300]}"
        )

    def joint_state_topic(self, topic: str | None = None) -> str:
        """Return the JointState topic: the named one, the only one, or the only measured_js.

        Raises:
            RecordingError: If there is none, or several and no reason to prefer one.
        """
        known = ", ".join(f"{name} ({kind})" for name, kind in self.topics.items()) or "none"
        if topic is not None:
            if self.topics.get(topic) != JOINT_STATE:
                raise RecordingError(
                    self.path, f"no JointState topic {topic!r}, topics in the bag: {known}"
                )
            return topic
        found = [name for name, kind in self.topics.items() if kind == JOINT_STATE]
        if not found:
            raise RecordingError(self.path, f"no {JOINT_STATE} topic, topics in the bag: {known}")
        # The dVRK publishes the gripper under the same last name.
        measured = [
            name
            for name in found
            if name.split("/")[-1] == "measured_js" and "gripper" not in name.split("/")
        ]
        if len(found) > 1 and len(measured) != 1:
            raise RecordingError(
                self.path,
                f"several JointState topics ({', '.join(found)}), expected one to be named",
            )
        return measured[0] if len(found) > 1 else found[0]

    def raw(self, *topics: str) -> Iterator[tuple[str, int, bytes]]:
        """Yield topic, receive time (ns) and CDR bytes of some topics' messages, in time order.

        Raises:
            RecordingError: If a topic is absent or the file breaks off.
        """
        for topic in topics:
            if topic not in self.topics:
                known = ", ".join(self.topics) or "none"
                raise RecordingError(self.path, f"no topic {topic!r}, topics in the bag: {known}")
        wanted = [c for c in self._reader.connections if c.topic in topics]
        messages = self._reader.messages(wanted)
        while True:
            try:
                connection, receive_ns, data = next(messages)
            except StopIteration:
                return
            except Exception as error:
                raise self._broken(error) from error
            # A sqlite3 column holds whatever was put there.
            if not isinstance(data, bytes) or not isinstance(receive_ns, int):
                raise RecordingError(
                    self.path,
                    f"a message of {connection.topic} holds {type(data).__name__} received at "
                    f"{receive_ns!r:.40}, expected bytes received at a whole number of ns",
                )
            yield connection.topic, receive_ns, data

    def message(self, topic: str, data: bytes) -> Any:
        """Return CDR bytes of one of the topic's messages as a ``rosbags`` message object.

        Raises:
            RecordingError: If the bytes are not of the topic's type.
        """
        try:
            return typestore().deserialize_cdr(data, self.topics[topic])
        except Exception as error:
            raise RecordingError(
                self.path, f"a message of {topic} is not a {self.topics[topic]}: {error}"
            ) from error
