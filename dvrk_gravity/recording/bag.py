"""Reading bags without ROS: rosbag2 (sqlite3, mcap) and ROS 1, complete or cut off by a crash."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from itertools import islice
from pathlib import Path, PurePath
from types import TracebackType
from typing import Any

import zstandard

from dvrk_gravity.errors import ConfigError, RecordingError, printable
from dvrk_gravity.files import text_file, yaml_file
from dvrk_gravity.recording import mcap_file, ros1_file, sqlite_file
from dvrk_gravity.recording.bag_file import BagFile, Channel, one_line
from dvrk_gravity.recording.cdr import JOINT_STATE, CdrError, from_ros1, typestore
from dvrk_gravity.recording.joint_names import fits
from dvrk_gravity.recording.notes import Note, note

# A JointState of 7 joints takes 400 bytes, of 1000 joints 60 kB.
LARGEST_MESSAGE = 1_000_000
# Of rosbag2; a ROS 1 bag, and one whose recorder was killed.
ROSBAG2_SUFFIXES = (".db3", ".mcap", ".db3.zstd", ".mcap.zstd")
SUFFIXES = (*ROSBAG2_SUFFIXES, ".bag", ".bag.active")
METADATA = "metadata.yaml"
OTHERS = "docs/recordings.md#what-is-no-bag-of-jointstates-and-no-csv"
"""Where the documentation shows how to make a CSV of what is not read."""
_COUNTS = "topics_with_message_count"  # its list of topics
_KINDS: dict[bytes, Callable[[Path], BagFile]] = {
    sqlite_file.MAGIC: sqlite_file.SqliteFile,
    mcap_file.MAGIC: mcap_file.McapFile,
    ros1_file.MAGIC: ros1_file.Ros1File,
}
# Topic names of arms' readings, the most certain first: of the dVRK, of its version 1, of ROS's
# own drivers (and, for all arms together, of whatever draws them).
_READINGS = ("measured_js", "state_joint_current", "joint_states")
_NUMBER = re.compile(r"_(\d+)$")  # of a part of a bag that was split
_LATEST = 2**63 - 1  # ns, of ROS's times
_HEAD = 18  # bytes, as many as the head of a file packed by zstd has at most
_DISK_SHARE = 0.5  # of the free space, that unpacking a file may take


def is_bag(path: Path) -> bool:
    """Return whether a path is a bag's, by its name: a folder, or a file of one."""
    return path.is_dir() or path.name.lower().endswith(SUFFIXES)


class SeveralTopicsError(RecordingError):
    """Several JointState topics, and no reason to prefer one.

    Attributes:
        topics: Their names.
    """

    def __init__(self, source: str | Path, topics: Sequence[str], shown: str = "") -> None:
        """Name the topics; ``shown``: with what is known of them."""
        self.topics = tuple(topics)
        named = shown or ", ".join(topics)
        super().__init__(
            source, f"several JointState topics ({named}), expected one to be named (--topic)"
        )


class BagReader:
    """A bag, open for reading (context manager): a rosbag2's folder, or a file of any bag.

    Of a damaged bag, the readable part is read.

    Attributes:
        path: Folder or file.
        topics: Message type of every topic.
        notes: Irregularities; complete when all messages were read.

    Raises:
        RecordingError: On entering and reading, if nothing can be read.
    """

    def __init__(self, path: str | Path) -> None:
        """Store the path; nothing is opened before ``with``."""
        self.path = Path(path)
        self.topics: dict[str, str] = {}
        self.notes: list[Note] = []
        self._files: list[tuple[str, BagFile]] = []
        self._described: dict[str, str] = {}  # topics that the metadata names
        self._stack = ExitStack()
        self._zstd = zstandard.ZstdDecompressor()

    def __enter__(self) -> BagReader:
        """Open the files and list their topics."""
        if not self.path.exists():
            raise RecordingError(self.path, "no such file or folder")
        names = self._named() if self.path.is_dir() else [self.path]
        problems = []
        try:
            for path in names:
                try:
                    file = self._open(path)
                except RecordingError:
                    raise
                # Damaged bytes make parsers raise any error.
                except Exception as error:
                    problems.append(f"{path.name}: {one_line(error)}")
                    continue
                self._stack.callback(file.close)
                self._files.append((path.name, file))
        except BaseException:
            self._stack.close()
            raise
        if not self._files:
            self._stack.close()
            raise self._unreadable("; ".join(problems) or "none of its files exists")
        for problem in problems:
            self._note(f"not read: {problem}")
        for _, file in self._files:
            for channel in file.channels.values():
                encoded = channel.encoding in ("cdr", "ros1")
                kind = channel.msgtype if encoded else f"{channel.msgtype} as {channel.encoding}"
                self.topics[channel.topic] = kind
        # An mcap file has no trace of a topic without messages.
        self.topics = {**self._described, **self.topics}
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the files."""
        self._stack.close()

    def _note(self, text: str) -> None:
        self.notes.append(note("cut_off", text))

    def _unreadable(self, why: str) -> RecordingError:
        return RecordingError(
            self.path, f"cannot be read as a bag (cut off or damaged?): {why[:300]}"
        )

    def _named(self) -> list[Path]:
        """Return the files of a folder: those that its metadata names, or all."""
        inside = {
            path.name: path
            for path in sorted(self.path.iterdir(), key=_place)
            if path.name.lower().endswith(ROSBAG2_SUFFIXES)
        }
        metadata = self.path / METADATA
        for path in (*inside.values(), *([metadata] if metadata.exists() else [])):
            if not text_file.is_file(path):
                raise RecordingError(path, "is a pipe or device, expected a file of a rosbag2")
        try:
            content = yaml_file.load(metadata)["rosbag2_bagfile_information"]
            named = [PurePath(name).name for name in content["relative_file_paths"]]
            topics = [each["topic_metadata"] for each in content.get(_COUNTS) or ()]
            self._described = {
                printable(str(each["name"])): printable(str(each["type"])) for each in topics
            }
        except (ConfigError, KeyError, TypeError, AttributeError):
            return self._all(list(inside.values()), metadata.exists())
        for name in named:
            if name not in inside:
                self._note(f"{name} is missing, a part that {METADATA} names")
        return [inside[name] for name in named if name in inside]

    def _all(self, inside: list[Path], described: bool) -> list[Path]:
        """Return all files of a folder without readable metadata; raise if of several bags."""
        if not inside:
            raise RecordingError(
                self.path,
                f"has no {METADATA} and no .db3 or .mcap file, expected the folder of a rosbag2; "
                "of a ROS 1 bag, give the .bag file",
            )
        bags = {_place(path)[0] for path in inside}
        if len(bags) > 1:
            names = ", ".join(path.name for path in inside)
            raise RecordingError(
                self.path, f"has no {METADATA}, and files of several bags: {names}; give one file"
            )
        what = f"a {METADATA} that cannot be read" if described else f"no {METADATA}"
        self._note(f"has {what} (its recorder was not ended?): read {len(inside)} file(s) in order")
        return inside

    def _open(self, path: Path) -> BagFile:
        """Open one file; raise ``ValueError`` or a parser's error if it is no bag's."""
        if not text_file.is_file(path):
            raise RecordingError(path, "is a pipe or device, expected a file of a bag")
        head = _head(path)
        if head.startswith(zstandard.FRAME_HEADER):
            path = self._unpacked(path, zstandard.frame_content_size(head))
            head = _head(path)
        for magic, kind in _KINDS.items():
            if head.startswith(magic):
                return kind(path)
        raise ValueError("does not begin like a file of a bag" if head else "is empty")

    def _unpacked(self, path: Path, size: int) -> Path:
        """Return a file that was compressed as a whole, unpacked for as long as it is open.

        Args:
            path: The file.
            size: Its unpacked size as it declares it, bytes; -1: it does not.
        """
        folder = self._stack.enter_context(tempfile.TemporaryDirectory(prefix="dvrk_gravity-"))
        if size > (most := _DISK_SHARE * shutil.disk_usage(folder).free):
            raise ValueError(
                f"unpacks to {size / 1e9:.3g} GB, expected at most {most / 1e9:.3g}, half of what "
                f"is free in {folder}"
            )
        target = Path(folder, path.stem)
        with path.open("rb") as source, target.open("wb") as file:
            try:
                self._zstd.copy_stream(source, file)
            except zstandard.ZstdError as error:
                self._note(f"{path.name} cannot be unpacked to its end ({one_line(error)})")
        return target

    def joint_state_topic(
        self, topic: str | None = None, arm: str = "", joints: Sequence[str] = ()
    ) -> str:
        """Return the JointState topic: the named one, the only one, or that of an arm's readings.

        Of several, it is the only one under the arm's name (``/MTMR/measured_js`` of mtmr), or the
        only one that names its joints.

        Raises:
            RecordingError: If there is none.
            SeveralTopicsError: If there are several, and no reason to prefer one.
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
            raise RecordingError(
                self.path,
                f"no {JOINT_STATE} topic, topics in the bag: {known}; to make a CSV of another "
                f"one: {OTHERS}",
            )
        among = found
        for last in _READINGS:
            # The dVRK publishes the gripper under the same last name.
            measured = [name for name in found if name.split("/")[-1] == last
                        and "gripper" not in name.split("/")]  # fmt: skip
            if measured:
                among = measured
                break
        if len(among) == 1:
            return among[0]
        named = [name for name in among if arm and _is_under(name, arm)]
        if len(named) != 1 and joints:
            named = [name for name in named or among if fits(self._names(name), joints)]
        if len(named) != 1:
            raise SeveralTopicsError(self.path, found)
        others = ", ".join(name for name in among if name != named[0])
        self.notes.append(note("topic", f"read {named[0]}, the one of arm {arm}, and not {others}"))
        return named[0]

    def _names(self, topic: str) -> set[str]:
        """Return the joints that the first messages of a topic name."""
        names: set[str] = set()
        notes = list(self.notes)
        for _, _, data in islice(self.raw(topic), 20):
            try:
                names.update(self.message(topic, data).name)
            except RecordingError:
                continue
        self.notes = notes
        return names

    def raw(self, *topics: str) -> Iterator[tuple[str, int, bytes]]:
        """Yield topic, receive time (ns) and CDR bytes of some topics' messages, in file order.

        JointStates of ROS 1 are converted to CDR.

        Raises:
            RecordingError: If a topic is absent, or nothing of a damaged file can be read.
        """
        for topic in topics:
            if topic not in self.topics:
                known = ", ".join(self.topics) or "none"
                raise RecordingError(self.path, f"no topic {topic!r}, topics in the bag: {known}")
        count = 0
        for name, file in self._files:
            wanted = [key for key, channel in file.channels.items() if channel.topic in topics]
            for key, received, data in file.read(wanted):
                channel = file.channels[key]
                # A sqlite3 column may hold any type.
                if not isinstance(data, bytes) or not isinstance(received, int):
                    raise RecordingError(
                        self.path,
                        f"a message of {channel.topic} holds {type(data).__name__} received at "
                        f"{received!r:.40}, expected bytes received at a whole number of ns",
                    )
                if received > _LATEST:
                    file.left_out["message received at a time beyond the year 2262"] += 1
                    continue
                try:
                    data = _cdr(data, channel, self._zstd)
                except _MessageError as error:
                    file.left_out[str(error)] += 1
                    continue
                count += 1
                yield channel.topic, received, data
            self._note_damage(name, file, count)
        if not count and any(note.kind == "cut_off" for note in self.notes):
            raise self._unreadable("; ".join(note.text for note in self.notes))

    def _note_damage(self, name: str, file: BagFile, count: int) -> None:
        """Note what could not be read of a file, once it was read."""
        if file.broken:
            self._note(f"{name} {file.broken}: {count} messages read until there")
        for what, times in file.left_out.items():
            self._note(f"{name}: left out {times} × {what}")
        file.broken = ""
        file.left_out.clear()

    def message(self, topic: str, data: bytes) -> Any:
        """Return a message from its CDR bytes; raise ``RecordingError`` if of another type."""
        try:
            return typestore().deserialize_cdr(data, self.topics[topic])
        except Exception as error:
            raise RecordingError(
                self.path, f"a message of {topic} is not a {self.topics[topic]}: {error}"
            ) from error


def _head(path: Path) -> bytes:
    """Return a file's first bytes, which say its kind and what it unpacks to."""
    with path.open("rb") as file:
        return file.read(_HEAD)


class _MessageError(ValueError):
    """A message that is left out; the text says what is wrong with it."""


def _cdr(data: bytes, channel: Channel, zstd: zstandard.ZstdDecompressor) -> bytes:
    """Return a message's bytes, unpacked if they are packed; a JointState of ROS 1 as CDR bytes."""
    size = len(data)
    try:
        if data.startswith(zstandard.FRAME_HEADER):
            size = zstandard.frame_content_size(data)
            data = b"" if size > LARGEST_MESSAGE else zstd.decompress(data, LARGEST_MESSAGE)
        if size > LARGEST_MESSAGE:
            raise _MessageError(f"message of more than {LARGEST_MESSAGE} bytes")
        if channel.encoding == "ros1" and channel.msgtype == JOINT_STATE:
            return from_ros1(data)
    except zstandard.ZstdError as error:
        raise _MessageError("message that cannot be unpacked") from error
    except CdrError as error:
        raise _MessageError("message that is not a JointState") from error
    return data


def _place(path: Path) -> tuple[str, int]:
    """Return the name of a file without the number of a part, and that number."""
    stem = path.name.partition(".")[0]
    number = _NUMBER.search(stem)
    return (stem[: number.start()], int(number[1])) if number else (stem, -1)


def _is_under(topic: str, arm: str) -> bool:
    """Return whether a topic lies in an arm's namespace: /MTMR, or a numbered one, /PSM1."""
    return any(
        part.lower().rstrip("0123456789") == arm.lower() or part.lower() == arm.lower()
        for part in topic.split("/")
    )
