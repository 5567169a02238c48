"""Hypotheses that the reading is wrong: zeros, scales, leaks, delay, clipping."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arm import JOINT_NAMES, N_JOINTS
from dvrk_gravity.diagnosis.columns_friction import mixed_motors
from dvrk_gravity.diagnosis.hypothesis import Hypothesis
from dvrk_gravity.diagnosis.motion import Motion

Array = NDArray[np.float64]
Setting = Mapping[str, float]

_SMALL = 1e-3  # below: a slope serves in place of a secant
_DELAY = 0.01  # s, first guess
_LIMITS = (90.0, 95.0, 98.0, 99.5)  # percentiles of the measured effort


def reading(motion: Motion) -> Iterator[Hypothesis]:
    """Yield every wrong reading that changes torques smoothly."""
    arm = motion.arm
    for joint in np.flatnonzero(motion.present).tolist():
        unit = np.eye(N_JOINTS)[joint]
        yield _zero(joint, "joint", unit)
        yield _scale((joint,), "joint", np.diag(unit))
        for percentile in _LIMITS:
            limit = float(np.percentile(np.abs(motion.effort[:, joint]), percentile))
            if limit > 0.0:
                yield _clipped(joint, limit)
    if motion.present.all():
        yield _scale(tuple(range(N_JOINTS)), "all", np.eye(N_JOINTS))
        for motor in mixed_motors(arm):
            yield _zero(motor, "motor", arm.actuator_to_joint[:, motor])
            unit = np.diag(np.eye(N_JOINTS)[motor])
            yield _scale((motor,), "motor", arm.actuator_to_joint @ unit @ arm.joint_to_actuator)
    for target in np.flatnonzero(motion.present).tolist():
        for source in np.flatnonzero(motion.present).tolist():
            if source != target:
                yield _torque_leak(target, source)
                yield _motion_leak(target, source)
    if not motion.static:
        yield _late()


def _zero(joint: int, place: str, shift: Array) -> Hypothesis:
    def build(motion: Motion, setting: Setting) -> Array:
        # measured = true + offset; a secant at the last estimate serves large offsets.
        step = setting["offset"]
        if abs(step) < _SMALL:
            return -(motion.slope @ shift)[:, :, None]
        there = motion.torque_at(motion.q - step * shift)
        return ((there - motion.modelled) / step)[:, :, None]

    return Hypothesis(
        "joint_offset", (joint,), place, build,
        lambda theta, _: {"offset": float(theta[0])},
        {"offset": 0.0}, fixed_point=("offset",),
    )  # fmt: skip


def _scale(joints: tuple[int, ...], place: str, mixing: Array) -> Hypothesis:
    def build(motion: Motion, setting: Setting) -> Array:
        del setting
        return (motion.modelled @ mixing)[:, :, None]

    return Hypothesis(
        "torque_scale", joints, place, build,
        lambda theta, _: {"factor": 1.0 + float(theta[0])},
    )  # fmt: skip


def _clipped(joint: int, limit: float) -> Hypothesis:
    def build(motion: Motion, setting: Setting) -> Array:
        torque = np.zeros((len(motion.q), N_JOINTS, 1))
        modelled = motion.modelled[:, joint]
        clipped = np.clip(modelled, -setting["limit"], setting["limit"])
        torque[:, joint, 0] = clipped - modelled
        return torque

    return Hypothesis(
        "effort_saturation", (joint,), "joint", build,
        lambda theta, setting: {"limit": setting["limit"], "share": float(theta[0])},
        {"limit": limit}, ("limit",), prior_count=4,
    )  # fmt: skip


def _torque_leak(target: int, source: int) -> Hypothesis:
    def build(motion: Motion, setting: Setting) -> Array:
        del setting
        torque = np.zeros((len(motion.q), N_JOINTS, 1))
        torque[:, target, 0] = motion.modelled[:, source]
        return torque

    return Hypothesis(
        "joint_coupling", (target, source), f"torque of {JOINT_NAMES[source]} leaks", build,
        lambda theta, _: {"factor": float(theta[0])},
    )  # fmt: skip


def _motion_leak(target: int, source: int) -> Hypothesis:
    def build(motion: Motion, setting: Setting) -> Array:
        # Read position = true + factor * position of the source.
        step = setting["factor"]
        if abs(step) < _SMALL:
            return -(motion.slope[:, :, target] * motion.q[:, [source]])[:, :, None]
        there = motion.q.copy()
        there[:, target] -= step * motion.q[:, source]
        return ((motion.torque_at(there) - motion.modelled) / step)[:, :, None]

    return Hypothesis(
        "joint_coupling", (target, source), f"motion of {JOINT_NAMES[source]} leaks", build,
        lambda theta, _: {"factor": float(theta[0])},
        {"factor": 0.0}, fixed_point=("factor",),
    )  # fmt: skip


def _late() -> Hypothesis:
    def build(motion: Motion, setting: Setting) -> Array:
        # Of the model's torques: the measured ones hold noise that the residual holds, too, and
        # a shift of them would explain it.
        step = setting["delay"] if abs(setting["delay"]) > _SMALL else _DELAY
        late = np.empty_like(motion.modelled)
        for part in motion.parts:
            time = motion.time[part]
            for joint in range(N_JOINTS):
                late[part, joint] = np.interp(time - step, time, motion.modelled[part, joint])
        return ((late - motion.modelled) / step)[:, :, None]

    return Hypothesis(
        "time_delay", (), "effort", build,
        lambda theta, _: {"delay": float(theta[0])},
        {"delay": 0.0}, fixed_point=("delay",), variable="time",
    )  # fmt: skip
