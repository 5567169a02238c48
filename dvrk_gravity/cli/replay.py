"""Play a bag's measured_js into the real compensator and check every answer."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dvrk_gravity import command_line
from dvrk_gravity.cli import arm_options
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.files import outputs, text_file
from dvrk_gravity.ros import PRIVATE, NodeProcess, ProcessError, end_on_signals, private_domain

if TYPE_CHECKING:
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.compensate import Sample
    from dvrk_gravity.model import TorqueModel

NAME = "replay"
EXAMPLE = "python -m dvrk_gravity replay my_bag --model config/mtmr_28002.yaml --out my_bag_answers"

TOLERANCE = 1e-9  # N·m or N between the node's effort and what is due
_JOINT_STATE = "sensor_msgs/msg/JointState"
# Messages on the way at once when answers set the pace: enough to keep both processes busy.
_WINDOW = 20


def _bare(n: int) -> dict[str, Any]:
    # All of friction, and no message left out; a replayed compensator has no limits.
    return {
        "allow_poor_model": True,
        "position_margin": 1e9,
        "friction_compensation.ratio": [1.0] * n,
        "friction_compensation.dead_band": [0.0] * n,
        "output": "servo_jf",
        "input_depth": 1000,
    }


@dataclass(frozen=True)
class Result:
    """What a replay found.

    Attributes:
        messages: Messages in the bag.
        valid: Messages that can be answered.
        answered: Answers that came.
        in_order: Every answer bears the stamp of the message it is due to, in order.
        largest_difference: Largest |effort - torque that is due|; ``None`` if not comparable.
        seconds: How long it took.
        unit: Of the difference: the joints' N·m, or N where they slide.
    """

    messages: int
    valid: int
    answered: int
    in_order: bool
    largest_difference: float | None
    seconds: float
    unit: str

    @property
    def passed(self) -> bool:
        """Whether all was answered, in order, and right."""
        return (
            self.answered == self.valid > 0
            and self.in_order
            and self.largest_difference is not None
            and self.largest_difference <= TOLERANCE
        )


def replay(
    bag: Path, model_file: Path, out: Path | None, topic: str | None = None, recorded: bool = False
) -> Result:
    """Play a bag into a compensator of its own and compare its answers with what is due.

    The node is the compensator without its supervisor, on topics that no arm has. Due is what the
    model compensates (:func:`~dvrk_gravity.cli.replay_reference.compensation`) with all of
    its friction, and without limits.

    Args:
        bag: rosbag2 folder or file.
        model_file: Parameter file of the compensator.
        out: Bag to write messages and answers to; ``None`` for none.
        topic: Topic of the bag; ``None`` finds the one with JointStates.
        recorded: Play at the recorded speed rather than as fast as answers come.

    Raises:
        RecordingError: A bag that cannot be read or written, or without a valid message.
        ConfigError: A model that cannot be used.
        ProcessError: The node did not start, or stopped answering.
    """
    from dvrk_gravity.model import TorqueModel
    from dvrk_gravity.recording import BagReader
    from dvrk_gravity.ros import namespace_of

    model = TorqueModel.load(model_file)
    arm_options.require_parameters(model, model_file)
    with BagReader(bag) as reader:
        name = reader.joint_state_topic(topic, model.arm.name, model.arm.joint_names)
        messages = [(received, data) for _, received, data in reader.raw(name)]
    expected = _expected(bag, name, model)
    start = time.monotonic()
    with private_domain():
        sent, answers = _play(messages, model_file, model.arm, len(expected), recorded)
    seconds = time.monotonic() - start
    if out is not None:
        _write(out, namespace_of(model.arm), sent, answers)
    stamps = [sample.stamp for sample in expected]
    comparable = [stamp for _, stamp, _, _ in answers] == stamps
    difference = None
    if comparable:
        efforts = np.array([effort for _, _, effort, _ in answers])
        difference = float(np.abs(efforts - _offline(model, expected)).max())
    unit = " or ".join(dict.fromkeys(model.arm.effort_units))
    return Result(len(messages), len(expected), len(answers), comparable, difference, seconds, unit)


def _expected(bag: Path, topic: str, model: TorqueModel) -> list[Sample]:
    """Return the samples that the node should answer: all but those it is to drop.

    Raises:
        RecordingError: All are to be dropped; why, is told of the first.
    """
    from dvrk_gravity.compensate import DroppedSampleError, SampleReader
    from dvrk_gravity.recording import read_joint_states

    reader = SampleReader(model.arm.joint_names, held=model.arm.held)
    samples: list[Sample] = []
    first: DroppedSampleError | None = None
    for state in read_joint_states(bag, topic):
        try:
            sample = reader.read(
                state.stamp_ns, state.names, state.position, state.velocity, state.effort
            )
        except DroppedSampleError as error:
            first = first or error
            continue
        if not samples or sample.stamp >= samples[-1].stamp:
            samples.append(sample)
    if not samples:
        raise RecordingError(bag, f"no message that could be answered: {first or 'there is none'}")
    return samples


def _offline(model: TorqueModel, samples: Sequence[Sample]) -> np.ndarray:
    """Return (N, n) efforts that are due, friction only where a velocity came along.

    In N·m, or in what the arm takes.
    """
    from dvrk_gravity.cli.replay_reference import compensation
    from dvrk_gravity.parameters import node_parameters

    # As the node gets them: the model file's settings, and over them those of the replay.
    settings, defaults = {**model.node, **_bare(model.arm.n)}, node_parameters(model.arm)
    ratio, dead_band = (
        np.array(settings.get(name, defaults[name].default))
        for name in ("friction_compensation.ratio", "friction_compensation.dead_band")
    )
    position = np.array([sample.position for sample in samples])
    torque = compensation(model, position, None, ratio, dead_band)
    moving = [i for i, sample in enumerate(samples) if sample.velocity is not None]
    if moving:
        velocity = np.array([samples[i].velocity for i in moving])
        torque[moving] = compensation(model, position[moving], velocity, ratio, dead_band)
    return model.arm.reading_of_torque(torque)


def _play(
    messages: Sequence[tuple[int, bytes]],
    model_file: Path,
    arm: Arm,
    due: int,
    recorded: bool,
) -> tuple[list[tuple[int, bytes]], list[tuple[int, int, Any, bytes]]]:
    """Return what was sent and what was answered.

    Sent: time (ns) and CDR bytes. Answered: time (ns), stamp (ns), effort (n,), CDR bytes.
    """
    from rclpy.serialization import deserialize_message
    from sensor_msgs.msg import JointState

    from dvrk_gravity.ros import REPLAYED_COMMANDS, REPLAYED_MEASURED, Client, namespace_of

    answers: list[tuple[int, int, Any, bytes]] = []

    def on_answer(data: bytes) -> None:
        message = deserialize_message(data, JointState)
        stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        answers.append((time.time_ns(), stamp, np.array(message.effort), data))

    arguments = ["--params-file", str(model_file)]
    for name, value in _bare(arm.n).items():
        arguments += ["-p", f"{name}:={json.dumps(value)}"]
    program = ("-m", "dvrk_gravity.ros.replayed")
    namespace = f"{PRIVATE}{namespace_of(arm)}"
    with (
        Client(namespace) as client,
        NodeProcess(None, *arguments, namespace=namespace, program=program) as node,
    ):
        publisher = client.node.create_publisher(JointState, REPLAYED_MEASURED, 1000)
        client.node.create_subscription(JointState, REPLAYED_COMMANDS, on_answer, 1000, raw=True)
        client.watch_state("compensator")
        try:
            client.wait(
                lambda: (
                    (client.state("compensator") != "" and
                     client.connected(publisher) and
                     client.node.count_publishers(REPLAYED_COMMANDS) > 0)
                    or node.process.poll() is not None
                ),
                "the compensator",
            )  # fmt: skip
            sent = _feed(client, publisher, messages, answers, due, recorded)
        except ProcessError as error:
            raise ProcessError(f"{error}; it said: {node.lines[-1:] or 'nothing'}") from error
    if node.process.returncode != 0:
        raise ProcessError(f"the compensator ended with status {node.process.returncode}: "
                           f"{node.lines[-1] if node.lines else 'no output'}")  # fmt: skip
    return sent, answers


def _feed(
    client: Any, publisher: Any, messages: Sequence[tuple[int, bytes]], answers: list[Any],
    due: int, recorded: bool,
) -> list[tuple[int, bytes]]:  # fmt: skip
    """Publish all messages, wait for the last answers; return when each was sent (ns)."""
    published = []
    progress = command_line.Progress("replay", len(messages))
    start, first = time.monotonic(), messages[0][0]
    for sent, (received, data) in enumerate(messages):
        if recorded:
            while (ahead := (received - first) * 1e-9 - (time.monotonic() - start)) > 0.0:
                client.spin_once(ahead)
        else:
            # A message that is not to be answered leaves the window after a moment.
            patience = time.monotonic() + 0.1
            while sent - len(answers) >= _WINDOW and time.monotonic() < patience:
                client.spin_once(0.01)
        published.append((time.time_ns(), data))
        publisher.publish(data)
        client.spin_once(0.0)
        progress.update(sent + 1)
    quiet, count = time.monotonic(), len(answers)
    while len(answers) < due and time.monotonic() - quiet < 2.0:
        client.spin_once()
        if len(answers) > count:
            quiet, count = time.monotonic(), len(answers)
    progress.done()
    return published


def _write(
    out: Path,
    namespace: str,
    sent: Sequence[tuple[int, bytes]],
    answers: Sequence[tuple[int, int, Any, bytes]],
) -> None:
    """Write messages and answers at the times of the replay, as `ros2 bag record` would."""
    from dvrk_gravity.recording import BagWriter

    measured, commands = f"{namespace}/measured_js", f"{namespace}/servo_jf"
    with BagWriter(out) as writer:
        writer.add_topic(measured, _JOINT_STATE)
        writer.add_topic(commands, _JOINT_STATE)
        for when, data in sent:
            writer.write(measured, _JOINT_STATE, data, when)
        for when, _, _, data in answers:
            writer.write(commands, _JOINT_STATE, data, when)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("bag", type=Path, help="rosbag2 (sqlite3 or mcap) with JointStates")
    parser.add_argument("--model", type=Path, required=True, help="model: a parameter file")
    parser.add_argument("--topic", help="topic of the bag, if it has several with JointStates")
    parser.add_argument("--speed", choices=("fast", "recorded"), default="fast",
                        help="as fast as it answers (default), or as recorded")  # fmt: skip
    parser.add_argument("--out", type=Path, help="bag to write messages and answers to")
    parser.add_argument("--json", type=Path, help="file to write the result to")


def run(arguments: argparse.Namespace) -> int:
    """Replay, print what was found; status 1 if an answer is missing or wrong."""
    outputs.check(
        {"--json": arguments.json},
        [arguments.bag, arguments.model],
        {"--out": arguments.out},
    )
    end_on_signals()
    result = replay(
        arguments.bag,
        arguments.model,
        arguments.out,
        arguments.topic,
        arguments.speed == "recorded",
    )
    difference = result.largest_difference
    shown = "not comparable" if difference is None else f"{difference:.2e} {result.unit}"
    print(
        f"{arguments.bag}: {result.answered} of {result.valid} answered in {result.seconds:.1f} s"
    )
    if result.valid < result.messages:
        print(
            f"  {result.messages - result.valid} further messages are invalid: not to be answered"
        )
    print(f"  in order, each with its own stamp: {'yes' if result.in_order else 'NO'}")
    print(f"  largest difference to the compensated terms offline: {shown} (allowed {TOLERANCE:g})")
    if arguments.json is not None:
        content = asdict(result) | {"passed": result.passed}
        text_file.write(arguments.json, json.dumps(content, indent=1) + "\n")
    return 0 if result.passed else 1


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of ``ros2 run dvrk_gravity replay``."""
    return command_line.run(__name__, argv)
