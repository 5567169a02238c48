"""What models and readings that are wrong do to an arm, attack by attack, through real nodes.

    PYTHONPATH=. python benchmark/attacks.py [--only WORDS] [--json FILE]

Simulator, compensator and watchdog run as processes of their own, each attack in a ROS domain of
its own; this process publishes what the simulated arm measures, changed as the attack says. An end
is safe where the compensator refuses before its first command, or where no joint moves by more than
30 deg/s from the moment of the attack, and the hold comes within the time-out after the reading
that calls for it. Status 1 if one is not.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty, Float64MultiArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))

from simulated_lab import record

from dvrk_gravity import TorqueModel, identify
from dvrk_gravity.arms import Arm
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.files import text_file
from dvrk_gravity.recording import Recording
from dvrk_gravity.ros import Client, NodeProcess, ProcessError, private_domain

FASTEST = 30.0  # deg/s
# s: a machine that stands still for less must not be taken for an attack's end.
TIMEOUT = 0.5
STALL = 0.03  # s: a measurement that is late by more shows the machine, and not the nodes
PART = 0.09  # of a joint's limit, the constant in its efforts
MODEL_FILE = Path(__file__).resolve().parents[1] / "config" / "mtmr_28002.yaml"
ARM = Arm.load("mtmr")
POSE = (0.0, 0.2, 0.1, 0.3, 1.4, 0.1, 0.0)
NAMES = ARM.joint_names
SHOULDER, PITCH = NAMES.index("shoulder_pitch"), NAMES.index("wrist_pitch")
PATIENT = ("-p", f"timeout:={TIMEOUT}", "-p", "max_stamp_age:=0.0")
ARRAY = ("-p", "output:=array", "-p", "output_topic:=commands")

Reading = Callable[[float, JointState], None]


@dataclass
class End:
    """How an attack ended.

    Attributes:
        fastest: Largest speed of a joint since the attack, deg/s.
        farthest: Largest way of a joint since the attack, deg.
        after: Time from the attack to the hold, s; ``None``: none came.
        silence: Time from the last command to the hold, s.
        line: What was said of it.
        commands: How many efforts the arm was sent.
        stall: Longest time between two measurements, s.
    """

    fastest: float = 0.0
    farthest: float = 0.0
    after: float | None = None
    silence: float = 0.0
    line: str = ""
    commands: int = 0
    stall: float = 0.0

    @property
    def safe(self) -> bool:
        """Whether no joint was fast, and the arm was held or never commanded."""
        held = self.commands == 0 if self.after is None else self.silence <= 1.25 * TIMEOUT
        return self.fastest <= FASTEST and held and bool(self.line)


class Stage(Client):
    """The simulated arm as the attacked compensator sees it (context manager)."""

    def __init__(self) -> None:
        super().__init__()
        self.reading: Reading = lambda since, message: None
        self.begun = np.inf  # when the attack began
        self.end = End()
        self._last = self._heard = np.inf  # when the last command and measurement came
        self._at: np.ndarray | None = None
        node, many = self.node, QoSProfile(depth=100)
        self._out = node.create_publisher(JointState, "measured_js", many)
        self.push = node.create_publisher(JointState, "simulator/push_jf", 10)
        node.create_subscription(JointState, "true_js", self._relay, many)
        node.create_subscription(JointState, "servo_jf", self._count, many)
        node.create_subscription(Empty, "hold", self._held, 10)
        self.watch_state("compensator")
        self.watch_state("watchdog")

    def takes_arrays(self, joints: list[str]) -> None:
        """Be a controller with joints in this order; the arm does what it says."""
        out = self.node.create_publisher(Float64MultiArray, "true_commands", 10)
        self.node.declare_parameter("joints", joints)

        def take(message: Float64MultiArray) -> None:
            self._count(message)
            effort = dict(zip(joints, message.data, strict=True))
            out.publish(Float64MultiArray(data=[effort[name] for name in NAMES]))

        self.node.create_subscription(Float64MultiArray, "commands", take, 10)

    def _relay(self, message: JointState) -> None:
        now = time.monotonic()
        if now >= self.begun and self.end.after is None:
            position = np.degrees(message.position)
            self._at = position if self._at is None else self._at
            self.end.stall = max(self.end.stall, now - self._heard)
            speed = float(np.degrees(np.abs(message.velocity).max()))
            self.end.fastest = max(self.end.fastest, speed)
            self.end.farthest = max(self.end.farthest, float(np.abs(position - self._at).max()))
        self._heard = now
        self.reading(now - self.begun, message)
        self._out.publish(message)

    def _count(self, _: object) -> None:
        self.end.commands += 1
        self._last = time.monotonic()

    def _held(self, _: object) -> None:
        now = time.monotonic()
        if self.end.after is None and now >= self.begun:
            self.end.after, self.end.silence = now - self.begun, now - self._last

    def attack(self) -> None:
        """Note that it begins now."""
        self.begun = time.monotonic()

    def commanding(self) -> None:
        """Wait until the arm is compensated, and its constants, if any, have been watched."""
        self.wait(lambda: self.state("compensator").startswith("commanding"), "commands", 30.0)

    def until_held(self, seconds: float) -> None:
        """Go on until the arm is held, or for so long."""
        stop = time.monotonic() + seconds
        while self.end.after is None and time.monotonic() < stop:
            self.spin(0.02)
        self.spin(0.2)
        if self.end.after is not None or self.end.commands == 0:
            self.end.line = self.state("compensator")


def simulator(*arguments: str) -> NodeProcess:
    """Start the arm, whose measurements go through us."""
    given = ("rate:=200.0", "sensor_noise:=false", "builtin_gravity_compensation:=false",
             f"initial_position:={list(POSE)}")  # fmt: skip
    words = [word for each in given for word in ("-p", each)]
    return NodeProcess("simulator", "-r", "measured_js:=true_js", *words, *arguments)


def refused(*arguments: str) -> End:
    """Start a compensator that should end by itself, and return its line."""
    with private_domain(), Stage() as stage, simulator():
        stage.attack()
        with NodeProcess("compensator", *arguments) as node:
            stop = time.monotonic() + 15.0
            while node.process.poll() is None and time.monotonic() < stop:
                stage.spin(0.05)
            if node.process.poll() == 2:
                stage.end.line = node.lines[-1]
        return stage.end


def two_models(folder: Path) -> End:
    """Give two parameter files, of two models."""
    return refused("--params-file", str(folder / "identified.yaml"),
                   "--params-file", str(MODEL_FILE))  # fmt: skip


def override(folder: Path) -> End:
    """Override a model's gravity on the command line."""
    beta = [1.25 * value for value in TorqueModel.load(MODEL_FILE).parameters()["beta"]]
    return refused("--params-file", str(MODEL_FILE), "-p", f"beta:={beta}")


def unfit(folder: Path) -> End:
    """Give a model of which its identification says that it is unfit."""
    path = folder / "unfit.yaml"
    replace(TorqueModel.load(MODEL_FILE), verdict="do_not_compensate").save(path)
    return refused("--params-file", str(path))


def foreign_uncertainty(folder: Path) -> End:
    """Give a model the uncertainty of another one; diagnoses and collections would believe it."""
    path = folder / "foreign.yaml"
    text = (folder / "shoulder.yaml").read_text()
    path.write_text(text.replace("shoulder.uncertainty.npz", "wrist.uncertainty.npz"))
    try:
        return End(line=f"{TorqueModel.load(path)} was believed")
    except ConfigError as error:
        return End(line=str(error))


def constant(name: str, joint: int, read: bool) -> Callable[[Path], End]:
    """Return the attack of a model with a constant at a joint that the arm does not feel.

    Its recording had a bias, which is still ``read``, or a hand that pushed steadily.
    """

    def attack(folder: Path) -> End:
        bias = PART * ARM.effort_limit * np.eye(7)[joint] * read

        def biased(_: float, message: JointState) -> None:
            message.effort = (np.array(message.effort) + bias).tolist()

        with private_domain(), Stage() as stage:
            stage.reading = biased
            stage.attack()
            with simulator(), _watchdog(stage), _compensator(folder / f"{name}.yaml"):
                stage.until_held(15.0)
            return stage.end

    return attack


def _compensator(model: Path, *arguments: str) -> NodeProcess:
    return NodeProcess("compensator", "--params-file", str(model), *PATIENT, *arguments)


@contextmanager
def _watchdog(stage: Stage, *arguments: str) -> Iterator[None]:
    given = ("-p", f"watchdog_timeout:={TIMEOUT}", *arguments)
    with NodeProcess("watchdog", *given):
        stage.wait(lambda: bool(stage.state("watchdog")), "the watchdog")
        yield


def deaf_watchdog(folder: Path) -> End:
    """Let the watchdog watch another topic than the one that is commanded."""
    with private_domain(), Stage() as stage:
        stage.attack()
        stage.takes_arrays(list(NAMES))
        arm = simulator("-p", "output:=array", "-p", "output_topic:=true_commands")
        with arm, _watchdog(stage), _compensator(MODEL_FILE, *ARRAY):
            stage.until_held(8.0)
        return stage.end


def permuted(folder: Path) -> End:
    """Let the controller take efforts in another order of the joints."""
    with private_domain(), Stage() as stage:
        stage.attack()
        stage.takes_arrays([NAMES[i] for i in (1, 0, 2, 3, 4, 5, 6)])
        arm = simulator("-p", "output:=array", "-p", "output_topic:=true_commands")
        with arm, _watchdog(stage, *ARRAY), _compensator(MODEL_FILE, *ARRAY):
            stage.until_held(8.0)
        return stage.end


def broken_encoder(reading: Callable[[Stage], Reading]) -> Callable[[Path], End]:
    """Return the attack of an encoder that breaks while the arm is commanded."""

    def attack(folder: Path) -> End:
        with private_domain(), Stage() as stage:
            with simulator(), _watchdog(stage), _compensator(MODEL_FILE):
                stage.commanding()
                stage.attack()
                stage.reading = reading(stage)
                stage.until_held(10.0)
            return stage.end

    return attack


def frozen(stage: Stage) -> Reading:
    """Freeze the shoulder's positions, and nudge it now and then: its velocities live."""
    at: list[float] = []
    nudges = 0

    def change(since: float, message: JointState) -> None:
        nonlocal nudges
        if not at:
            at.append(message.position[SHOULDER])
        if since > 0.5 * nudges:
            nudges += 1
            stage.push.publish(JointState(effort=(0.2 * np.eye(7)[SHOULDER]).tolist()))
        message.position[SHOULDER] = at[0]

    return change


def drifting(stage: Stage) -> Reading:
    """Let the shoulder's positions drift by 0.06 rad/s, and its velocities stay."""

    def change(since: float, message: JointState) -> None:
        message.position[SHOULDER] += 0.06 * since

    return change


def killed(folder: Path) -> End:
    """Kill the compensator: the watchdog that watches its topic holds the arm."""
    with private_domain(), Stage() as stage:
        with simulator(), _watchdog(stage), _compensator(MODEL_FILE) as node:
            stage.commanding()
            stage.attack()
            node.signal(signal.SIGKILL)
            stage.until_held(5.0)
            stage.end.line = stage.state("watchdog")
        return stage.end


# What is done, and what must be said: a machine that stands still ends an attack otherwise.
ATTACKS: dict[str, tuple[Callable[[Path], End], str]] = {
    "two parameter files": (two_models, "another model"),
    "a model with an override": (override, "another model"),
    "an unfit model": (unfit, "do_not_compensate"),
    "another's uncertainty": (foreign_uncertainty, "expected the uncertainty of this model"),
    "a bias at the shoulder": (constant("shoulder", SHOULDER, read=True), "the model pushes"),
    "a push at the shoulder": (constant("shoulder", SHOULDER, read=False), "the model pushes"),
    "a bias at the wrist": (constant("wrist", PITCH, read=True), "the model pushes"),
    "a push at the wrist": (constant("wrist", PITCH, read=False), "the model pushes"),
    "a deaf watchdog": (deaf_watchdog, "watches"),
    "a permuted controller": (permuted, "takes efforts of"),
    "a frozen encoder": (broken_encoder(frozen), "an encoder"),
    "a drifting encoder": (broken_encoder(drifting), "an encoder"),
    "a killed compensator": (killed, "hold sent"),
}


def told(attack: Callable[[Path], End], word: str, folder: Path) -> End:
    """Return how an attack ended; of three, where the machine stood still in the first ones."""
    end = End()
    for _ in range(3):
        try:
            end = attack(folder)
        except ProcessError as error:
            end = End(line=str(error))
        if end.safe and word in end.line:
            return end
        if end.stall < STALL and word in end.line:
            break
        print(f"tried again, {1e3 * end.stall:.0f} ms stalled: {end.line}", file=sys.stderr)
    return end if word in end.line else replace(end, line="")


def make_models(folder: Path) -> None:
    """Identify a model from a clean recording, and from ones with a constant at a joint."""
    clean = record(seed=1)
    joints = {"identified": None, "shoulder": SHOULDER, "wrist": PITCH}
    for name, joint in joints.items():
        constant = np.zeros(7) if joint is None else PART * ARM.effort_limit * np.eye(7)[joint]
        read: Recording = replace(clean, effort=clean.effort + constant)
        identify(read, "mtmr").model.save(folder / f"{name}.yaml")


def main() -> int:
    """Print a line an attack; status 1 if an end is not safe."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", default="", metavar="WORDS", help="attacks whose names have them")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to FILE")
    arguments = parser.parse_args()
    rows = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_models(folder)
        print(f"{'attack':<26}{'deg/s':>7}{'deg':>7}{'hold, ms':>10}  said")
        for title, (attack, word) in ATTACKS.items():
            if arguments.only not in title:
                continue
            end = told(attack, word, folder)
            hold = "none" if end.after is None else f"{1e3 * end.after:.0f}"
            rows[title] = {**vars(end), "safe": end.safe}
            print(
                f"{title:<26}{end.fastest:>7.1f}{end.farthest:>7.2f}{hold:>10}  {end.line}"
                f"{'' if end.safe else '  NOT SAFE'}",
                flush=True,
            )
    if arguments.json is not None:
        text_file.write(arguments.json, json.dumps(rows, indent=1) + "\n")
    return 0 if all(row["safe"] for row in rows.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
