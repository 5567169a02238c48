"""The last minutes of an arm's messages, kept in memory; on demand a bag, and its diagnosis."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections import deque
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from dvrk_gravity.errors import DvrkGravityError
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import JOINT_STATE, BagWriter
from dvrk_gravity.ros.processes import end_with

BAG, MODEL, DIAGNOSIS = "recording", "model.yaml", "diagnosis"
"""In the folder of a save."""

_RATE = 1000  # messages a second that there is room for: the fastest that a console publishes
_BESIDE = 10  # niceness of the diagnosis: what commands an arm goes first


class MessageBuffer:
    """Keeps messages, and saves them.

    Attributes:
        last_result: What has become of the last save, in words; ``""``: there was none.
    """

    def __init__(self, model: TorqueModel, topic: str, seconds: float) -> None:
        """Keep messages of some seconds, at most a thousand a second.

        Args:
            model: What a save is diagnosed with.
            topic: Full name of the topic.
            seconds: How long a message is kept.
        """
        self._model, self._topic, self._seconds = model, topic, seconds
        self._kept: deque[tuple[int, bytes]] = deque(maxlen=round(_RATE * seconds))
        self._work: threading.Thread | None = None
        self._process: subprocess.Popen[str] | None = None
        self._ended = False
        self.last_result = ""

    def __len__(self) -> int:
        """Return the number of messages that are kept."""
        return len(self._kept)

    def add(self, data: bytes, received: int) -> None:
        """Keep the bytes of a message that was received at a time, ns."""
        oldest = received - int(self._seconds * 1e9)
        while self._kept and self._kept[0][0] < oldest:
            self._kept.popleft()
        self._kept.append((received, data))

    def save(self, folder: Path) -> tuple[bool, str]:
        """Write the messages to a new folder, and have them diagnosed; return at once.

        Returns:
            Whether that has begun, and where it is, or why not.
        """
        if self._work is not None and self._work.is_alive():
            return False, f"the last one is not ready: {self.last_result}"
        if not self._kept:
            return False, f"nothing was received on {self._topic}"
        name = f"{self._model.arm.name}_{datetime.now(UTC):%Y%m%dT%H%M%S.%fZ}"
        target = folder.absolute() / name
        try:
            target.mkdir(parents=True)
        except OSError as error:
            return False, f"{target}: {error.strerror or error}"
        self.last_result = f"{target / BAG}: being written"
        self._work = threading.Thread(
            target=self._write, args=(target, tuple(self._kept)), name="save", daemon=True
        )
        self._work.start()
        return True, f"{target / BAG}; its diagnosis, when ready: {target / DIAGNOSIS}"

    def _write(self, folder: Path, messages: tuple[tuple[int, bytes], ...]) -> None:
        """Write a bag and diagnose it, in a thread of its own."""
        try:
            with BagWriter(folder / BAG) as bag:
                for received, data in messages:
                    bag.write(self._topic, JOINT_STATE, data, received)
            self._model.save(folder / MODEL)
            self.last_result = (
                f"{folder / BAG}: {len(messages)} messages; the diagnosis is on its way"
            )
            self.last_result = f"{folder}: {self._diagnose(folder)}"
        except (DvrkGravityError, OSError) as error:
            self.last_result = str(error)

    def _diagnose(self, folder: Path) -> str:
        command = [sys.executable, "-m", "dvrk_gravity", "diagnose", str(folder / BAG)]
        command += ["--model", str(folder / MODEL), "--out", str(folder / DIAGNOSIS)]
        if self._ended:
            return "the monitor ended before the diagnosis"
        # A process of its own: the diagnosis computes for half a minute.
        self._process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
            text=True, preexec_fn=partial(_begin_beside, os.getpid()),
        )  # fmt: skip
        _, errors = self._process.communicate()
        written = folder / DIAGNOSIS / "findings.json"
        if not written.is_file():
            return errors.strip().splitlines()[-1] if errors.strip() else "no diagnosis"
        findings = json.loads(written.read_text(encoding="utf-8"))["findings"]
        return "; ".join(each["sentence"] for each in findings) or "nothing found"

    def wait(self, timeout: float) -> bool:
        """Wait for a save at most ``timeout`` seconds; return whether none goes on."""
        if self._work is not None:
            self._work.join(timeout)
        return self._work is None or not self._work.is_alive()

    def close(self) -> None:
        """End the diagnosis, if one goes on."""
        self._ended = True
        if self._process is not None and self._process.poll() is None:
            self._process.terminate()
        self.wait(5.0)


def _begin_beside(parent: int) -> None:
    end_with(parent)
    os.nice(_BESIDE)
