"""Node: the compensator for `replay`, on topics of its own that no arm has."""

from __future__ import annotations

import argparse
import sys

from dvrk_gravity import command_line
from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate import DroppedSampleError, Sample, Settings, Status, Supervisor
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.ros import runtime
from dvrk_gravity.ros.compensator_node import Compensator
from dvrk_gravity.ros.wire import CommandTopic

NAME = "replayed"
EXAMPLE = "python -m dvrk_gravity replay my_bag --model config/mtmr_28002.yaml (which starts this)"

REPLAYED_MEASURED = "replay/measured_js"
REPLAYED_COMMANDS = "replay/servo_jf"


class BareModelSupervisor(Supervisor):
    """Answers every readable sample with the bare model: no limit, ramp, time-out or check."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(settings)
        self._last_stamp = 0
        self._status, self._reason = Status.COMMANDING, "the bare model, for a replay"

    def command(self, sample: Sample, now: float, clock: int) -> Array | None:
        """Return the model's (n,) torque, N·m; see :meth:`Supervisor.command`."""
        if sample.stamp < self._last_stamp:
            raise DroppedSampleError("stamp_backwards", "stamp before the last one")
        self._last_stamp = sample.stamp
        return self.settings.finite(self.settings.torque(sample.position, sample.velocity))

    def in_time(self, now: float) -> bool:
        """Send every answer, however late: no arm moves."""
        return True


class ReplayCompensator(Compensator):
    """The compensator's path from message to message, with the bare model in between."""

    def _supervise(self, settings: Settings) -> Supervisor:
        return BareModelSupervisor(settings)

    def _command_topic(self) -> CommandTopic:
        return CommandTopic(REPLAYED_COMMANDS, as_array=False)

    def _connect(self) -> None:
        super()._connect()
        for topic, wanted in (
            (self._arm.topic, REPLAYED_COMMANDS),
            (self.resolve_topic_name(REPLAYED_MEASURED), REPLAYED_MEASURED),
        ):
            if not topic.endswith(f"/{wanted}"):
                raise ConfigError("remapping", topic, f"…/{wanted}, which no arm has")

    def _on_listen(self) -> None:
        if self.prompt is None:
            self._subscribe(REPLAYED_MEASURED)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command line."""
    parser.usage = "%(prog)s [-h] [--ros-args …]"


def run(arguments: argparse.Namespace) -> int:
    """Run the node until SIGINT or SIGTERM; return the exit status."""
    return runtime.spin(ReplayCompensator, arguments.ros_args)


if __name__ == "__main__":
    sys.exit(command_line.run("dvrk_gravity.ros.replay_node"))
