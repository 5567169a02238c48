"""What physics says of every answer: an arm's mirror image, and one of other mass, do alike.

The mirror is the base's x-z plane. It turns joints that turn the other way, and leaves what
slides; of links' first moments the y part changes sign, and of inertia's, xy and yz. An arm of
eight times the mass, friction and limits has eight times the torques: a power of two, so that not
even digits change.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import diagnosed
import fitted
import numpy as np
import pytest
import yaml
from diagnosed import HALF, MIDDLE, PITCH, ROLL, YAW, eye
from support import REPOSITORY

from dvrk_gravity import identify
from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate import DroppedSampleError, SampleReader, Settings, Status, Supervisor
from dvrk_gravity.diagnosis import (
    Finding,
    MeasuredMotion,
    diagnose,
    every_hypothesis,
    extended,
    load,
    track,
)
from dvrk_gravity.effects import Hypothesis, State
from dvrk_gravity.identification import Fit
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording

FILE = REPOSITORY / "testing" / "chain.yaml"
MIRROR = np.array([-1.0, -1.0, 1.0, -1.0])
OF_BODY = np.array([1.0, 1.0, -1.0, 1.0, 1.0, -1.0, 1.0, 1.0, -1.0, 1.0])
OF_MASS = ("link_weight.", "link_inertia.", "coulomb_friction.joint_", "viscous", "rotor")


@dataclass(frozen=True, eq=False)
class Twin:
    """The small arm, in a mirror or not, with other masses.

    Attributes:
        arm: The arm.
        sign: (n,) its positions over those of the small arm.
        scale: Its masses over those of the small arm.
    """

    arm: Arm
    sign: Array
    scale: float

    @classmethod
    def of(cls, sign: Array, scale: float) -> Twin:
        content = yaml.safe_load(FILE.read_text())
        for joint, way in zip(content["joints"], sign.tolist(), strict=True):
            mirror = float(sign.min())
            joint |= {"alpha": mirror * joint["alpha"], "offset": mirror * joint["offset"]}
            joint["lower"], joint["upper"] = sorted((way * joint["lower"], way * joint["upper"]))
            joint["effort_limit"] *= scale
        mixed = sign[:, None] * np.array(content["actuator_to_joint"]) * sign
        limits = [scale * limit for limit in content["actuator_effort_limit"]]
        sizes = {f"link{k}": [scale * 2.0 / k, 0.1 * k] for k in range(1, 5)}
        content |= {"actuator_to_joint": mixed.tolist(), "actuator_effort_limit": limits}
        path = fitted.folder() / f"twin_{sign[0]:g}_{scale:g}.yaml"
        path.write_text(yaml.safe_dump(content | {"sizes": sizes}))
        return cls(Arm.load(path), sign, scale)

    def model(self) -> TorqueModel:
        """Return what knows all of it."""
        values = dict(diagnosed.model().parameters())
        for name, value in values.items():
            if name.startswith(OF_MASS):
                values[name] = tuple(self.scale * np.array(value))
            if name.startswith("link_") and self.sign.min() < 0.0:
                values[name] = tuple(np.array(values[name]) * OF_BODY[: len(value)])
        return TorqueModel.from_parameters(values, self.arm)

    def recording(self, recording: Recording) -> Recording:
        """Return what it shows where the small arm shows a recording."""
        return replace(
            recording, position=self.sign * recording.position, arm=self.arm,
            velocity=self.sign * recording.velocity,
            effort=self.scale * self.sign * recording.effort,
        )  # fmt: skip

    def shown(self, torque: Array) -> Array:
        """Return its (…, n) torques as the small arm has them."""
        return torque * self.sign / self.scale

    def supposed(self) -> list[tuple[Hypothesis, MeasuredMotion]]:
        """Return every hypothesis of a motion, in the small arm's order."""
        motion = load([self.recording(diagnosed.recorded())], self.model())

        def order(each: Hypothesis) -> tuple[str, tuple[int, ...], str]:
            effect, joints, place = each.key
            if effect == "joint_spring" and np.prod(self.sign[list(joints)]) < 0.0:
                place = {"sum": "difference", "difference": "sum"}[place]
            return effect, joints, place

        return [(each, motion) for each in sorted(every_hypothesis(motion), key=order)]

    def times(self, unit: str) -> float:
        """Return its sizes in a unit over those of the small arm: the power of mass it has."""
        above, _, below = unit.partition("/(")
        return self.scale ** (float("N" in above or "kg" in above) - float("N" in below))

    def sizes(self, values: Mapping[str, float], of: Hypothesis) -> list[float]:
        """Return how large each parameter is, as the small arm has it."""
        return sorted(abs(value) / self.times(of.unit(name)) for name, value in values.items())


@cache
def small() -> Twin:
    return Twin.of(np.ones(4), 1.0)


@cache
def mirrored() -> Twin:
    return Twin.of(MIRROR, 1.0)


@cache
def heavy() -> Twin:
    return Twin.of(np.ones(4), 8.0)


TWINS = pytest.mark.parametrize("twin", [mirrored, heavy])


def close(got: object, wanted: Array | list[float], part: float, name: str) -> None:
    """Compare to a part of the largest."""
    atol = part * max(np.abs(wanted).max(initial=0.0), 1e-9)
    np.testing.assert_allclose(got, wanted, 0.0, atol, err_msg=name)


@TWINS
def test_every_cause_that_can_be_supposed_looks_and_means_alike(twin):
    twin, random, compared = twin(), np.random.default_rng(1), 0
    for (one, motion), (other, moved) in zip(small().supposed(), twin.supposed(), strict=True):
        name, columns = str(one), one.regressor(motion)
        prior = np.array(one.prior_std or np.full(columns.shape[2], 0.02))
        theta = random.uniform(0.2, 0.4, len(prior)) * prior
        seen = (other.regressor(moved) * twin.sign[:, None] / twin.scale).reshape(-1, len(theta))
        if np.linalg.cond(seen / np.maximum(np.abs(seen).max(axis=0), 1e-12)) > 1e6:
            continue  # that motion does not show all of it
        compared += 1
        torque = (columns @ theta).ravel()
        again = np.linalg.lstsq(seen, torque, rcond=1e-12)[0]
        # A tilt's columns are right to second order, about half-way.
        part = 2e-4 if one.effect == "base_tilt" else 1e-7
        close(seen @ again, torque, part, name)
        if one.prior_std:
            close(
                np.linalg.norm(again / other.prior_std), np.linalg.norm(theta / prior), part, name
            )
        given, got = one.parameters(theta), other.parameters(again)
        assert given.keys() == got.keys(), name
        close(twin.sizes(got, other), small().sizes(given, one), part, name)
        if np.isfinite(one.removable):
            assert other.removable == pytest.approx(twin.scale * one.removable), name
        assert other.plausible(again) == one.plausible(theta), name
        assert other.typical(again) == one.typical(theta), name
        (model, why), (same, same_why) = (
            extended(motion, [(one, theta)]), extended(moved, [(other, again)])
        )  # fmt: skip
        assert same_why == why, name
        added = motion.read_by(model) - motion.modelled
        close(twin.shown(moved.read_by(same) - moved.modelled), added, part, name)
    assert compared > 200


MOTION = diagnosed.moving()
WHOLE = MOTION.torque()
HIDDEN = {
    "a load, and friction that differs by direction": MOTION.torque(
        diagnosed.loaded(0.15, (0.02, 0.03, 0.1))
    )
    + np.where(MOTION.qd > 0.0, 0.3, -0.2) * eye(PITCH),
    "a cable beside a constant": WHOLE
    + (0.3 * MOTION.q - 0.2 * MOTION.q**2) * eye(ROLL) + 0.2 * eye(YAW),
    "a drift beside what no cause has": WHOLE
    + 0.5 * np.sin(2.0 * MOTION.q[:, [YAW]]) * np.cos(3.0 * MOTION.q[:, [ROLL]]) * eye(PITCH)
    + 0.3 * (1.0 - np.exp(-MOTION.time / 5.0))[:, None] * eye(YAW),
}  # fmt: skip


@cache
def fit_of(twin: Twin) -> Fit:
    return identify(twin.recording(diagnosed.recorded()), twin.arm)


@pytest.mark.parametrize(("hidden", "identified"), [*zip(HIDDEN, [False, True, True], strict=True)])
def test_a_diagnosis_of_one_is_that_of_the_other(hidden, identified):
    recording = MOTION.read(HIDDEN[hidden])
    twins = [small(), mirrored(), heavy()]
    first, *others = (
        diagnose(twin.recording(recording), fit_of(twin).model if identified else twin.model())
        for twin in twins
    )
    assert first.findings
    for twin, other in zip(twins[1:], others, strict=True):
        assert other.verdict == first.verdict
        for got, wanted in zip(other.findings, first.findings, strict=True):
            assert (got.effect, got.joints, got.place) == (
                wanted.effect, wanted.joints, wanted.place
            )  # fmt: skip
            assert got.certain == wanted.certain
            assert got.parameters.keys() == wanted.parameters.keys()
            for size, same in zip(sizes(twin, got), sizes(small(), wanted), strict=True):
                assert size[0] == pytest.approx(same[0], rel=1e-5, abs=1e-9), wanted
                draws_of_its_own = 0.3 if twin is mirrored() else 1e-5
                assert size[1] == pytest.approx(same[1], rel=draws_of_its_own), wanted
            ends = [[each.relative, each.low, each.high] for each in (got.gain, wanted.gain)]
            close(ends[0], ends[1], 1e-6, wanted.effect)
        assert [(each.effect, each.joints) for each in other.known] == [
            (each.effect, each.joints) for each in first.known
        ]
        for each, one in zip(other.detectable, first.detectable, strict=True):
            assert (each.effect, each.joint) == (one.effect, one.joint)
            part = 3e-4 if one.effect == "base_tilt" else 1e-5
            assert each.size == pytest.approx(twin.times(each.unit) * one.size, rel=part), one
        for errors in ("before", "after", "floor", "expected"):
            got, wanted = (list(getattr(each, errors).values()) for each in (other, first))
            close(np.array(got) / twin.scale, wanted, 1e-6, errors)


@TWINS
def test_what_is_tracked_of_one_is_what_is_of_the_other(twin):
    """A history follows every simple change, found or not."""
    recording, twin = MOTION.read(HIDDEN["a load, and friction that differs by direction"]), twin()
    tracked = (track(each.recording(recording), each.model()) for each in (small(), twin))
    for one, other in zip(*tracked, strict=True):
        assert (one.effect, one.joint) == (other.effect, other.joint)
        assert one.parameter == other.parameter
        if twin is mirrored() and one.parameter in ("positive", "negative"):
            continue  # a mirror exchanges them
        scale = twin.times(one.unit)
        part = 1e-3 if one.effect == "base_tilt" else 1e-6
        assert abs(other.value) == pytest.approx(scale * abs(one.value), rel=part, abs=1e-9), one
        assert other.error == pytest.approx(scale * one.error, rel=part), one


def sizes(twin: Twin, finding: Finding) -> list[tuple[float, float]]:
    """Return how large each parameter is, and how wide its interval, as the small arm has them."""
    return sorted(
        (abs(each.value) / scale, (each.high - each.low) / scale)
        for each in finding.parameters.values()
        for scale in [twin.times(each.unit)]
    )


def test_what_is_identified_of_one_is_that_of_the_other():
    fits = [(twin, fit_of(twin)) for twin in (small(), mirrored(), heavy())]
    states = [[twin.sign * each for each in (MOTION.q, MOTION.qd, MOTION.qdd)] for twin, _ in fits]
    wanted, *others = (
        twin.shown(fit.model.torque_at(State(*state)))
        for (twin, fit), state in zip(fits, states, strict=True)
    )
    assert np.abs(wanted - WHOLE).max() < 0.1 * np.abs(WHOLE).max()
    for (twin, fit), got in zip(fits[1:], others, strict=True):
        close(got, wanted, 1e-9, twin.arm.name)
        assert fit.model.verdict == fits[0][1].model.verdict


@TWINS
def test_one_is_commanded_as_the_other(twin):
    """Beside messages that go on, some that jump, that are late, and efforts that do not fit."""
    held = stopped = 0
    for seed in range(12):
        one, other = (ran(each, seed) for each in (small(), twin()))
        assert [status for status, _ in one] == [status for status, _ in other]
        for (status, command), (_, same) in zip(one, other, strict=True):
            assert (command is None) == (same is None)
            if command is not None:
                close(twin().shown(same), command, 1e-9, status.name)
                held += 1
        stopped += any(status is Status.FAULT for status, _ in one)
    assert held > 500
    assert 2 < stopped < 12


def ran(twin: Twin, seed: int) -> list[tuple[Status, Array | None]]:
    """Return how a supervisor of a twin answers a motion to which something happens."""
    random = np.random.default_rng(seed)
    values = twin.model().parameters() | {"ramp_time": 0.2, "slew_limit": [50.0 * twin.scale] * 4}
    supervisor = Supervisor(Settings.from_parameters(values | {"timeout": 0.1}))
    supervisor.enable()
    reader, now, answers = SampleReader(twin.arm), 100.0, []
    way, angle = 0.5 * random.uniform(-1.0, 1.0, 4) * HALF, 0.01 * np.arange(-60.0, 240.0)
    angle = np.maximum(angle, 0.0)
    q = MIDDLE + 0.5 * (1.0 - np.cos(angle))[:, None] * way
    qd, qdd = (
        2.0**k * np.outer(each, 0.5 * way) for k, each in ((1, np.sin(angle)), (2, np.cos(angle)))
    )
    effort = small().model().torque_at(State(q, qd, qdd))
    happens, at = int(random.integers(0, 6)), int(random.integers(150, 250))
    joint = eye(int(random.integers(0, 4)))
    for k in range(300):
        now += 0.005 if (happens, k) != (1, at) else 0.3
        position = q[k] + (0.4 * joint if (happens, k) == (3, at) else 0.0)
        velocity = qd[k] + (8.0 * joint if happens == 4 and k > at else 0.0)
        read = effort[k] + (3.0 * joint if happens == 2 and k > at else 0.0)
        stamp = round((now - (0.0 if happens != 5 or k < at else 0.5)) * 1e9)
        command = None
        try:
            sample = reader.read(
                stamp, twin.arm.joint_names, twin.sign * position, twin.sign * velocity,
                twin.scale * twin.sign * read,
            )  # fmt: skip
            command = supervisor.command(sample, now, round(now * 1e9))
        except DroppedSampleError as error:
            supervisor.drop(error)
        answers.append((supervisor.status, command))
    return answers
