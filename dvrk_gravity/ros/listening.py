"""Reading an arm that a person moves, and nothing else."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from sensor_msgs.msg import JointState

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate import DroppedSampleError, InputGate, SampleReader
from dvrk_gravity.ros.client import Client
from dvrk_gravity.ros.presence import MEASURED
from dvrk_gravity.ros.runtime import asked_to_end
from dvrk_gravity.ros.wire import JointStateReader

_TIMEOUT = 0.1  # s; positions after a longer silence are compared with none before
_PAUSE = 0.05  # s


def on_position(client: Client, arm: Arm, receive: Callable[[Array], None]) -> None:
    """Call ``receive`` from now on with every (n,) measured position that is believed."""
    unpack, gate = JointStateReader().read, InputGate(arm)
    read = SampleReader(arm.joint_names, units=arm.units, arm=arm.name, held=arm.held).read

    def believe(data: bytes) -> None:
        try:
            fields = unpack(data)
            sample = read(
                fields.stamp_ns, fields.names, fields.position, fields.velocity, fields.effort
            )
            clock = client.node.get_clock().now().nanoseconds
            admitted = gate.admit(sample, time.monotonic(), clock, _TIMEOUT, 0.0, False)
        except DroppedSampleError:
            return
        receive(admitted.sample.position)

    client.node.create_subscription(JointState, MEASURED, believe, 100, raw=True)


def listen(client: Client, arm: Arm) -> Iterator[Array | None]:
    """Yield (n,) measured positions that are believed, until a signal asks for the end.

    While nothing comes, ``None`` is yielded some times a second.
    """
    heard: list[Array | None] = []
    ended: list[bool] = []
    on_position(client, arm, heard.append)
    with asked_to_end(lambda: ended.append(True)):
        while not ended:
            client.spin_once(_PAUSE)
            yield from heard or [None]
            heard.clear()
