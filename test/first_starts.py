"""A simulated arm under a compensator whose model has a constant torque in doubt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from support import MODEL_FILE

from dvrk_gravity import TorqueModel
from dvrk_gravity.compensate import Sample, Settings, Status, Supervisor
from dvrk_gravity.effects import ElasticCable
from dvrk_gravity.simulate import PlantFile, SimulatedArm

STEP, EACH = 1e-3, 5  # s; a message each five steps, at 200 Hz
POSE = np.radians([0.0, 15.0, 5.0, 30.0, 80.0, 10.0, 0.0])
NAMES = ("outer_yaw", "shoulder_pitch", "elbow_pitch")
FASTEST, FARTHEST = 30.0, 3.0  # deg/s and deg, within which a joint is held
SHIPPED = TorqueModel.load(MODEL_FILE)


class Loop:
    """An arm under a compensator whose model has a constant torque at a joint.

    Attributes:
        supervisor: The compensator.
        fastest: Largest speed of the joint, rad/s.
        farthest: Largest way of it since the first message, rad.
        holds: Number of holds.
    """

    def __init__(
        self, joint: int, torque: float, feels: bool, reads: bool, known: bool = True,
        slow: int = 1, **settings: object,
    ):  # fmt: skip
        """Build it at rest.

        Args:
            joint: Number of the joint.
            torque: The constant of the model, N·m.
            feels: The arm has a spring of that torque.
            reads: Efforts are read with it.
            known: The model's file has it as a constant in doubt.
            slow: How much more time passes for the compensator than for the arm.
            settings: Parameters of the compensator.
        """
        truth = PlantFile.load("mtmr_28002")
        constant = torque * np.eye(7)[joint]
        pull = ElasticCable.constant(SHIPPED.arm, constant)
        model = replace(SHIPPED, terms=(*SHIPPED.terms, pull))
        if feels:
            terms = (*truth.model.terms, ElasticCable.constant(SHIPPED.arm, constant))
            truth = replace(truth, model=replace(truth.model, terms=terms))
        if known:
            model = replace(model, constant=constant)
        self._plant = truth.plant()
        self._plant.reset(POSE)
        self._arm = SimulatedArm(self._plant, truth.sensors, 1, builtin_compensation=False, dt=STEP)
        self._joint, self._bias = joint, constant * reads
        self._slow = slow
        self.supervisor = Supervisor(Settings.from_parameters(model.parameters() | settings))
        self.fastest = self.farthest = 0.0
        self.holds, self._steps = 0, 0
        self._run(0.6, answers=False)
        self._start = self._plant.q[joint]

    def run(self, seconds: float) -> Loop:
        """Go on for so long."""
        return self._run(seconds, answers=True)

    def configure(self, **settings: object) -> None:
        """Change parameters of the compensator."""
        given = self.supervisor.settings.model.parameters() | settings
        changed = Settings.from_parameters(given, self.supervisor.settings)
        self.supervisor.configure(changed, self._now)

    @property
    def _now(self) -> float:
        return self._steps * self._slow * STEP

    def push(self, torque: float, seconds: float) -> None:
        """Push the joint by hand."""
        self._arm.push(torque * np.eye(7)[self._joint], seconds)

    def _run(self, seconds: float, answers: bool) -> Loop:
        for _ in range(round(seconds / STEP)):
            self._arm.step()
            self._steps += 1
            if not answers:
                continue
            self.fastest = max(self.fastest, abs(float(self._plant.v[self._joint])))
            way = abs(float(self._plant.q[self._joint] - self._start))
            self.farthest = max(self.farthest, way)
            if self._steps % EACH == 0:
                self._answer()
        return self

    def _answer(self) -> None:
        read, now = self._arm.measure(), self._now
        stamp = round(self._steps * STEP * 1e9)
        effort = np.array(read.effort) + self._bias
        sample = Sample(stamp, np.array(read.position), np.array(read.velocity), effort)
        command = self.supervisor.command(sample, now, stamp)
        if self.supervisor.hold_due:
            self._arm.hold()
            self.supervisor.hold_due, self.holds = False, self.holds + 1
        elif command is not None:
            self._arm.servo_jf(command)


def check_held(joint: int, part: float, reads: bool) -> None:
    """Require that a constant that the arm does not feel is held before it moves the joint.

    Args:
        joint: Number of the joint.
        part: The constant, of the joint's effort limit.
        reads: Efforts are read with it: a bias, else a steady push.
    """
    loop = Loop(joint, part * SHIPPED.arm.effort_limit[joint], feels=False, reads=reads).run(3.0)

    assert np.degrees(loop.fastest) < FASTEST
    assert np.degrees(loop.farthest) < FARTHEST
    assert loop.supervisor.status is Status.FAULT
    assert loop.holds == 1
    for token in (NAMES[joint], "calibrate", "--bias-is"):
        assert token in loop.supervisor.reason
