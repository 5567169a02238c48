"""A supervisor with a clock of the test's own, and an arm that publishes every 2 ms."""

from __future__ import annotations

import numpy as np
from support import MODEL_FILE

from dvrk_gravity import TorqueModel
from dvrk_gravity.arms import JOINT_NAMES
from dvrk_gravity.compensate import DroppedSampleError, SampleReader, Settings, Status, Supervisor

Q = np.array([0.05, 0.2, 0.1, 0.3, 1.0, 0.1, 0.2])
HELD = np.array([0.1, 0.3, 0.1, 0.0, 0.02, -0.01, 0.0])  # what the arm holds itself with
MS = 1_000_000
OFF = {"slew_limit": [0.0] * 7}
# Friction that explains what the arm holds itself with.
STICKY = {"coulomb_friction.joint_positive": [1.0, 1.0, 1.0, 0.2, 0.06, 0.06, 0.02]}
AT_ONCE = OFF | {"ramp_time": 0.0}
TOLERANT = {"start_tolerance": 2.0}  # changes of the torque are not compared with the last start
MODEL = TorqueModel.load(MODEL_FILE)
ARM, BASE = MODEL.arm, MODEL.parameters()


def settings_of(**values) -> Settings:
    """Settings of the shipped model."""
    return Settings.from_parameters(BASE | values)


class SupervisorInLoop:
    """A supervisor, its clock and its arm.

    Where no ramp is wanted the arm measures no efforts: commands begin with the model's torque.
    Otherwise the model knows friction that explains what the arm holds itself with.
    """

    def __init__(self, settings: Settings | None = None, **values) -> None:
        self.ramps = values.get("ramp_time", 1.0) > 0.0
        if self.ramps:
            values = STICKY | values
        self.supervisor = Supervisor(settings_of(**values) if settings is None else settings)
        self.reader = SampleReader(ARM)
        self.now = 100.0
        self.stamp = 5_000_000 * MS
        self.late = 0  # of the stamps against the node's clock, ns
        self.cause = ""  # of the last message that was dropped
        self.holds = 0

    def send(self, after: float = 0.002, **fields) -> np.ndarray | None:
        """Send one message, as the node would; return the command that answers it."""
        self.now += after
        self.stamp += int(after * 1e9)
        self.cause, command = "", None
        try:
            sample = self.reader.read(
                fields.get("stamp", self.stamp),
                fields.get("name", JOINT_NAMES),
                fields.get("position", Q),
                fields.get("velocity", np.zeros(7)),
                fields.get("effort", HELD if self.ramps else []),
            )
            command = self.supervisor.command(sample, self.now, self.stamp + self.late)
        except DroppedSampleError as error:
            self.cause = error.cause
            self.supervisor.drop(error)
        self.settle()
        return command

    def first(self, **fields) -> np.ndarray | None:
        """Send messages until one is answered, for as long as a start takes; return the answer."""
        for _ in range(60):
            command = self.send(**fields)
            if command is not None:
                return command
        return None

    def run(self, duration: float, **fields) -> list[np.ndarray | None]:
        """Send messages for a while."""
        return [self.send(**fields) for _ in range(round(duration / 0.002))]

    def wait(self, duration: float) -> None:
        """Let time pass without messages; the node's timer looks four times in a timeout."""
        end = self.now + duration
        while self.now < end:
            self.now += self.supervisor.settings.timeout / 4
            self.supervisor.check_input(self.now)
            self.settle()
        self.stamp += int(duration * 1e9)

    def settle(self) -> None:
        """Do as the node does: send a hold that is due, once."""
        self.holds += self.supervisor.hold_due
        self.supervisor.hold_due = False

    def configure(self, **values) -> None:
        self.supervisor.configure(settings_of(**values), self.now)
        self.settle()

    def builtin(self, *effort: float) -> bool:
        """Say what the arm's own compensation does; return whether to switch it off."""
        off = self.supervisor.observe_builtin(np.array(effort))
        self.settle()
        return off

    @property
    def status(self) -> Status:
        return self.supervisor.status

    @property
    def reason(self) -> str:
        return self.supervisor.reason


def target(loop: SupervisorInLoop, position: np.ndarray = Q, velocity=None) -> np.ndarray:
    """The model's torque within the arm's limits."""
    settings = loop.supervisor.settings
    velocity = np.zeros(7) if velocity is None else velocity
    return settings.limits.clip(settings.torque(position, velocity))
