"""Node: the compensator as `replay` plays bags into it, on topics of its own that no arm has."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from dvrk_gravity import command_line

NAME = "replayed"
EXAMPLE = "python -m dvrk_gravity replay my_bag --model config/mtmr_28002.yaml (which starts this)"

REPLAYED_MEASURED = "replay/measured_js"
REPLAYED_COMMANDS = "replay/servo_jf"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments: all that there is to set are ROS parameters."""
    parser.usage = "%(prog)s [-h] [--ros-args …]"


def run(arguments: argparse.Namespace) -> int:
    """Run the node until SIGINT or SIGTERM; return the exit status."""
    # Here and not above: rclpy and Pinocchio are slow to load and --help needs neither.
    from dvrk_gravity.compensate import Settings, Supervisor, Unsupervised
    from dvrk_gravity.errors import ConfigError
    from dvrk_gravity.ros import runtime
    from dvrk_gravity.ros.command_topic import CommandTopic
    from dvrk_gravity.ros.compensator_node import Compensator

    class Replayed(Compensator):
        """The compensator's way from message to message, with the bare model in between."""

        def _supervise(self, settings: Settings) -> Supervisor:
            return Unsupervised(settings)

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

    return runtime.spin(Replayed, arguments.ros_args)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of ``python -m dvrk_gravity.ros.replayed``."""
    return command_line.run("dvrk_gravity.ros.replayed", argv)


if __name__ == "__main__":
    sys.exit(main())
