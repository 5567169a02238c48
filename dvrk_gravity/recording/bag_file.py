"""What files of bags have in common, whatever their format."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any


class BagFileError(Exception):
    """A file of a bag of which nothing can be read."""


@dataclass(frozen=True)
class Channel:
    """One source of messages in a file.

    Attributes:
        topic: Its name.
        msgtype: Message type, as ROS 2 writes it.
        encoding: ``cdr``, ``ros1``, or how else its messages are encoded.
    """

    topic: str
    msgtype: str
    encoding: str


class BagFile(ABC):
    """A file of a bag, read from its beginning to where it ends or breaks off.

    Attributes:
        channels: By their number in the file.
        broken: Where and why it breaks off; ``""``: it does not.
        left_out: Parts that cannot be read, by what is wrong with them.
    """

    def __init__(self) -> None:
        """Begin with nothing found."""
        self.channels: dict[Any, Channel] = {}
        self.broken = ""
        self.left_out: Counter[str] = Counter()

    @abstractmethod
    def messages(self, wanted: Collection[Any]) -> Iterator[tuple[Any, Any, Any]]:
        """Yield number of the channel, time of reception (ns) and bytes of some channels."""

    @abstractmethod
    def close(self) -> None:
        """Close the file."""


def ros2_type(name: str) -> str:
    """Return a message type as ROS 2 writes it: ``package/msg/Name``."""
    package, _, rest = name.partition("/")
    return name if not rest or "/" in rest else f"{package}/msg/{rest}"
