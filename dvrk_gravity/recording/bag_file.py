"""What files of bags have in common: channels, and messages up to where one ends or breaks off."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any

from dvrk_gravity.errors import printable


@dataclass(frozen=True)
class Channel:
    """One source of messages in a file.

    Attributes:
        topic: Its name.
        msgtype: Message type, as ROS 2 writes it.
        encoding: Of its messages: ``cdr``, ``ros1`` or another.
    """

    topic: str
    msgtype: str
    encoding: str

    def __post_init__(self) -> None:
        """Make the names printable."""
        for name in ("topic", "msgtype", "encoding"):
            object.__setattr__(self, name, printable(getattr(self, name)))


class BagFile(ABC):
    """A file of a bag, read from its beginning to where it ends or breaks off.

    Attributes:
        channels: By their number in the file.
        broken: Where and why it breaks off; ``""``: it does not.
        left_out: Numbers of unreadable parts, by what is wrong with them.
    """

    def __init__(self) -> None:
        """Begin with nothing found."""
        self.channels: dict[Any, Channel] = {}
        self.broken = ""
        self.left_out: Counter[str] = Counter()

    def read(self, wanted: Collection[Any]) -> Iterator[tuple[Any, Any, Any]]:
        """Yield number, time of reception (ns) and bytes of some channels' messages."""
        try:
            yield from self._messages(wanted)
        except Exception as error:  # damaged bytes make parsers raise any
            self.broken = f"is damaged from there on ({one_line(error)})"

    @abstractmethod
    def _messages(self, wanted: Collection[Any]) -> Iterator[tuple[Any, Any, Any]]:
        """Yield what ``read`` does, or raise any error where the file is damaged."""

    @abstractmethod
    def close(self) -> None:
        """Close the file."""


def one_line(error: Exception) -> str:
    """Return an error's text, or else its kind, on one line."""
    return " ".join(str(error).split()) or type(error).__name__
