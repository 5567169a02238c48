"""Reading an arm that a person moves, and nothing else."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from sensor_msgs.msg import JointState

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate import (
    DroppedSampleError,
    InputGate,
    MotionError,
    Sample,
    SampleReader,
)
from dvrk_gravity.ros.client import Client
from dvrk_gravity.ros.executor import subscribe_raw
from dvrk_gravity.ros.presence import MEASURED, Presence
from dvrk_gravity.ros.runtime import catch_end_signals
from dvrk_gravity.ros.wire import JointStateReader

_TIMEOUT = 0.1  # s; positions after a longer silence are compared with none before
_PAUSE = 0.05  # s


def on_sample(client: Client, arm: Arm, receive: Callable[[Sample], None]) -> None:
    """Call ``receive`` from now on with every measurement that is believed.

    An impossible one is left out. Where later ones stay there, an encoder has slipped, or it is
    another arm: spinning ``client`` then raises MotionError, as where two nodes measure.
    """
    presence = Presence(client.node, any_subscriber=False)
    unpack, gate = JointStateReader().read, InputGate(arm)
    read = SampleReader(arm).read
    heard, jump = -math.inf, ""

    def believe(data: bytes, info: Mapping[str, Any]) -> None:
        nonlocal heard, jump
        if several := presence.note_message(info):
            raise MotionError(several)
        now = time.monotonic()
        try:
            clock = client.node.get_clock().now().nanoseconds
            believed = gate.admit(read(*unpack(data)), now, clock, _TIMEOUT, 0.0, False)
        except DroppedSampleError as error:
            if error.cause == "position_jump":
                jump = jump or str(error)
            return
        if jump and now - heard > _TIMEOUT:  # compared with none before
            raise MotionError(f"{topic.topic_name}: {jump} It stays there: begin again")
        heard, jump = now, ""
        receive(believed)

    topic = subscribe_raw(client.node, JointState, MEASURED, believe, 100)


def listen(client: Client, arm: Arm) -> Iterator[Array | None]:
    """Yield (n,) measured positions that are believed, until a signal asks for the end.

    While nothing comes, ``None`` is yielded some times a second.

    Raises:
        MotionError: Positions have jumped: those before and after it do not belong together.
    """
    heard: list[Array | None] = []
    ended: list[bool] = []
    on_sample(client, arm, lambda sample: heard.append(sample.position))
    with catch_end_signals(lambda: ended.append(True)):
        while not ended:
            client.spin_once(_PAUSE)
            yield from heard or [None]
            heard.clear()
