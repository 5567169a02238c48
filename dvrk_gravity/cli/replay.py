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
from dvrk_gravity.arrays import Array
from dvrk_gravity.cli import options
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.files import outputs, text_file
from dvrk_gravity.ros import PRIVATE, NodeProcess, ProcessError, end_on_signals, private_domain

if TYPE_CHECKING:
    from dvrk_gravity.arms import Arm
    from dvrk_gravity.compensate import Sample
    from dvrk_gravity.model import TorqueModel

NAME = "replay"
EXAMPLE = "python -m dvrk_gravity replay my_bag --model config/mtmr_28002.yaml --out my_bag_answers"

TOLERANCE = 1e-9  # N·m or N between the node's effort and the expected one
_JOINT_STATE = "sensor_msgs/msg/JointState"
# Messages on the way at once when answers set the pace: enough to keep both processes busy.
_WINDOW = 20


def _bare_parameters(n: int) -> dict[str, Any]:
    from dvrk_gravity.parameters import ACCEPT_READING_ERRORS  # slow to load

    # The whole friction, and every message answered; a replayed compensator has no limits.
    return {
        "allow_poor_model": True,
        ACCEPT_READING_ERRORS: True,  # no arm is commanded
        "position_margin": 1e9,
        "friction_compensation.ratio": [1.0] * n,
        "friction_compensation.dead_band": [0.0] * n,
        "output": "servo_jf",
        "input_depth": 1000,
    }


@dataclass(frozen=True)
class Result:
    """The result of a replay.

    Attributes:
        messages: Messages in the bag.
        valid: Messages that can be answered.
        answered: Answers received.
        in_order: Answers bear the stamps of their messages, in order.
        largest_difference: Largest |effort - expected torque|; ``None`` if not comparable.
        seconds: Duration.
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
    """Play a bag into a compensator of its own and compare the answers with the model.

    The node is the compensator without its supervisor, on topics that no arm has. Expected is
    :func:`compensation` with the whole friction, and without limits.

    Args:
        bag: rosbag2 folder or file.
        model_file: Parameter file of the compensator.
        out: Bag for messages and answers; ``None``: none.
        topic: Topic of the bag; ``None``: the one with JointStates.
        recorded: Play at the recorded speed rather than as fast as answers come.

    Raises:
        RecordingError: A bag that cannot be read or written, or without a valid message.
        ConfigError: A model that cannot be used.
        ProcessError: The node did not start, or stopped answering.
    """
    from dvrk_gravity.model import TorqueModel
    from dvrk_gravity.recording import BagReader, is_bag, is_recording
    from dvrk_gravity.ros import namespace_of

    if is_recording(bag) and not is_bag(bag):
        raise RecordingError(
            bag,
            "is no bag, whose messages are played: convert it first: python -m dvrk_gravity "
            f"convert {bag} {bag.with_suffix('')}_bag",
        )
    model = TorqueModel.load(model_file)
    options.require_parameters(model, model_file)
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
    """Return the samples that the node should answer, or raise RecordingError if there is none."""
    from dvrk_gravity.compensate import DroppedSampleError, SampleReader
    from dvrk_gravity.recording import read_joint_states

    reader = SampleReader(model.arm)
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
    """Return the (N, n) expected efforts, N·m or the arm's unit; friction needs a velocity."""
    from dvrk_gravity.parameters import node_parameters

    # As for the node: the model file's settings, overridden by those of the replay.
    settings, defaults = {**model.node, **_bare_parameters(model.arm.n)}, node_parameters(model.arm)
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


def compensation(
    model: TorqueModel, position: Array, velocity: Array | None, ratio: Array, dead_band: Array
) -> Array:
    """Return the torque that compensates an arm, before any limit, from the terms themselves.

    It shares the terms' formulae with the compensator, and none of its code: each term computes all
    samples at once, through its own ``torque``. Weights and elastic torques count, and of friction
    the asked part; not inertia of links or payloads, effects with memory, or sensor effects.

    Args:
        model: The model.
        position: (N, n) measured positions, rad.
        velocity: (N, n) rad/s; ``None``: unknown, without friction.
        ratio: (n,) part of friction that is compensated, at each joint and motor.
        dead_band: (n,) rad/s below which a joint's velocity counts as zero in friction.

    Returns:
        (N, n) N·m.
    """
    from dvrk_gravity.effects import State

    q = position - model.joint_offset
    sliding = None if velocity is None else np.where(np.abs(velocity) < dead_band, 0.0, velocity)
    torque = np.zeros_like(q)
    for term in model.terms:
        if not term.COMPENSATED or (term.WEIGHT_OF_ARM and not model.arm.gravity_in_command):
            continue
        smooth, friction = term.split(ratio)
        if smooth is not None:
            torque += smooth.torque(State(q))  # at rest: of a payload its weight
        if friction is not None:
            torque += friction.torque(State(q, sliding))
    return torque


def _play(
    messages: Sequence[tuple[int, bytes]],
    model_file: Path,
    arm: Arm,
    due: int,
    recorded: bool,
) -> tuple[list[tuple[int, bytes]], list[tuple[int, int, Any, bytes]]]:
    """Return messages, time (ns) and CDR, and answers, time, stamp (ns), (n,) effort and CDR."""
    from rclpy.serialization import deserialize_message
    from sensor_msgs.msg import JointState

    from dvrk_gravity.ros import REPLAYED_COMMANDS, REPLAYED_MEASURED, Client, namespace_of

    answers: list[tuple[int, int, Any, bytes]] = []

    def on_answer(data: bytes) -> None:
        message = deserialize_message(data, JointState)
        stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        answers.append((time.time_ns(), stamp, np.array(message.effort), data))

    arguments = ["--params-file", str(model_file)]
    for name, value in _bare_parameters(arm.n).items():
        arguments += ["-p", f"{name}:={json.dumps(value)}"]
    program = ("-m", "dvrk_gravity.ros.replay_node")
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
            raise ProcessError(f"{error}; its last output: {node.lines[-1:] or 'none'}") from error
    if node.process.returncode != 0:
        raise ProcessError(f"the compensator ended with status {node.process.returncode}: "
                           f"{node.lines[-1] if node.lines else 'no output'}")  # fmt: skip
    return sent, answers


def _feed(
    client: Any, publisher: Any, messages: Sequence[tuple[int, bytes]], answers: list[Any],
    due: int, recorded: bool,
) -> list[tuple[int, bytes]]:  # fmt: skip
    """Publish all messages, wait for the last answers; return the messages with times (ns)."""
    published = []
    progress = command_line.Progress("replay", len(messages))
    start, first = time.monotonic(), messages[0][0]
    for sent, (received, data) in enumerate(messages):
        if recorded:
            while (ahead := (received - first) * 1e-9 - (time.monotonic() - start)) > 0.0:
                client.spin_once(ahead)
        else:
            # A message without answer leaves the window after a moment.
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
    parser.add_argument("--model", type=Path, required=True, help="model file")
    parser.add_argument("--topic", help="topic of the bag, if it has several with JointStates")
    parser.add_argument("--speed", choices=("fast", "recorded"), default="fast",
                        help="as fast as the node answers (default), or as recorded")  # fmt: skip
    parser.add_argument("--out", type=Path, help="bag for messages and answers")
    parser.add_argument("--json", type=Path, help="file for the result")


def run(arguments: argparse.Namespace) -> int:
    """Replay and print the result; status 1 if an answer is missing or wrong."""
    bag, model, out = arguments.bag, arguments.model, arguments.out
    outputs.check({"--json": arguments.json}, [bag, model], {"--out": out})
    end_on_signals()
    result = replay(bag, model, out, arguments.topic, arguments.speed == "recorded")
    difference = result.largest_difference
    shown = "not comparable" if difference is None else f"{difference:.2e} {result.unit}"
    print(
        f"{arguments.bag}: {result.answered} of {result.valid} answered in {result.seconds:.1f} s"
    )
    invalid = result.messages - result.valid
    if invalid:
        print(f"  {invalid} other messages are invalid, and correctly have no answer")
    print(f"  in order, with the stamps of their messages: {'yes' if result.in_order else 'NO'}")
    print(f"  largest difference from the model offline: {shown} (allowed {TOLERANCE:g})")
    if arguments.json is not None:
        content = asdict(result) | {"passed": result.passed}
        text_file.write(arguments.json, json.dumps(content, indent=1) + "\n")
    return 0 if result.passed else 1
