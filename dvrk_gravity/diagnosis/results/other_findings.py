"""Findings that are no named effect: wrong readings, and structure without a name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.held_out import HeldOut
from dvrk_gravity.diagnosis.inference.pool import prepared
from dvrk_gravity.diagnosis.inference.readings import ReadingScore, WrongReading
from dvrk_gravity.diagnosis.inference.selection import EffectTrial
from dvrk_gravity.diagnosis.inference.unstated import unstated
from dvrk_gravity.diagnosis.results.findings import (
    FLOORS,
    NO_TERM,
    Alternative,
    Finding,
    FloorFrom,
    Gain,
    Picture,
)
from dvrk_gravity.effects import Estimate, Hypothesis, Kind, Unknown
from dvrk_gravity.units import quantity

EXPECTED = "the error that the model is known to have"


def unknown_finding(
    held_out: HeldOut,
    validation: CrossValidation,
    named: Sequence[Candidate],
    trial: EffectTrial,
) -> Finding:
    """Return the finding of structure that no name fits."""
    hypothesis = trial.candidate.hypothesis
    with_it = [*named, trial.candidate]
    before, after = held_out.error(named, with_it), held_out.error(with_it)
    joint = hypothesis.joints[0]
    gain = held_out.gain(before, after, [joint])
    rms = float(
        np.sqrt(max(held_out.rmse(before)[joint] ** 2 - held_out.rmse(after)[joint] ** 2, 0.0))
    )
    parameters = {"rms": Estimate(rms, rms, rms, hypothesis.unit("rms"))}
    return Finding(
        effect=Unknown.NAME,
        joints=hypothesis.names,
        place=hypothesis.place,
        parameters=parameters,
        gain=gain,
        alternatives=(),
        rejected=(),
        sentence=hypothesis.claim(parameters),
        picture=picture_of(validation.data, held_out, hypothesis, joint, before, after),
        left_out=NO_TERM,
        remedy=hypothesis.remedy(carried=False),
    )


def as_read_before(motion: MeasuredMotion, data: FilteredData, held_out: HeldOut) -> Array:
    """Return (H, n) errors of the recording as it was read first, same samples."""
    error = data.reduce(motion.residual)[held_out.rows]
    return np.where(data.usable[held_out.rows], error, np.nan)


def error_beside(motion: MeasuredMotion) -> Array:
    """Return (H, n) held-out errors of a motion beside what its arm's file says little of."""
    validation, pool = prepared(motion)
    return HeldOut(validation).error(unstated(validation, pool))


def reading_gain(
    score: ReadingScore, before: Array, after: Array, held_out: HeldOut
) -> tuple[list[int], Gain]:
    """Return the joints that a reading is judged by, and what it gains there on held-out blocks.

    Args:
        score: The reading.
        before: (H, n) errors of the recording as it was read first.
        after: (H, n) errors of the other reading.
        held_out: The held-out blocks.
    """
    old, new = held_out.rmse(before), held_out.rmse(after)
    joints = list(score.reading.joints) or [int(np.argmin(new / np.maximum(old, 1e-12)))]
    return joints, held_out.gain(before, after, joints)


def reading_finding(
    reading: WrongReading, before: Array, after: Array, held_out: HeldOut
) -> Finding:
    """Return the finding that the recording was read wrongly."""
    score = reading.score
    joints, gain = reading_gain(score, before, after, held_out)
    joint_names, factor = held_out.joint_names, score.reading.factor
    names = tuple(joint_names[joint] for joint in score.reading.joints)
    place = "clock" if score.reading.clock else score.reading.words
    if score.reading.scale:
        place = Kind.JOINT.value if names else "all"
        names = names or tuple(joint_names)
    return Finding(
        effect=score.reading.effect.NAME,
        joints=names,
        place=place,
        parameters={"factor": factor} if factor else {},
        gain=gain,
        alternatives=tuple(
            Alternative(
                other.reading.effect.NAME,
                tuple(joint_names[joint] for joint in other.reading.joints),
                f"{other.reading.words}: log-likelihood gain {other.gain:.0f} "
                f"against {score.gain:.0f}",
            )
            for other in reading.alternatives
        ),
        rejected=(),
        sentence=(
            f"The recording is read wrongly: {score.reading.words}; read rightly, "
            f"{100 * gain.relative:.0f} % of the error at {joint_names[joints[0]]} is gone"
        ),
        picture=None,
        left_out=NO_TERM,
        remedy=score.reading.remedy,
    )


def picture_of(
    data: FilteredData,
    held_out: HeldOut,
    hypothesis: Hypothesis,
    joint: int,
    before: Array,
    after: Array,
) -> Picture:
    """Return the held-out error of a joint against what a hypothesis depends on."""
    motion = data.motion
    variable = hypothesis.variable if not motion.static else "position"
    argument = joint if hypothesis.depends_on is None else hypothesis.depends_on
    name, unit = motion.arm.joint_names[argument], motion.arm.joints[argument].unit
    scale, shown = (np.degrees(1.0), "deg") if unit == "rad" else (1e3, "mm")
    values, label = {
        "position": (scale * motion.q[:, argument], f"position of {name} [{shown}]"),
        "velocity": (scale * motion.qd[:, argument], f"velocity of {name} [{shown}/s]"),
        "acceleration": (scale * motion.qdd[:, argument], f"acceleration of {name} [{shown}/s²]"),
        "time": (motion.time, "time [s]"),
    }[variable]
    x = data.reduce_state(values[:, None])[held_out.rows, 0]
    forward = None
    if variable == "position" and hypothesis.directed:
        way = motion.qd if motion.direction is None else motion.direction
        forward = data.reduce_state(way[:, [argument]])[held_out.rows, 0] > 0.0
    return Picture(
        motion.arm.joint_names[joint], label, x, before[:, joint], after[:, joint], forward
    )


def shapeless_finding(
    arm: Arm, joint: int, after: float, floor: float, expected: float, source: FloorFrom
) -> Finding:
    """Return the finding that a joint is off by more than noise, whatever it depends on.

    Static poses whose directions are not known tell no noise: then by more than the model expects.
    """
    least, words = (floor, FLOORS[source]) if np.isfinite(floor) else (expected, EXPECTED)
    rms = float(np.sqrt(after**2 - least**2))
    name, unit = arm.joint_names[joint], arm.joints[joint].effort_unit
    return Finding(
        effect=Unknown.NAME,
        joints=(name,),
        place="nothing that was tried",
        parameters={"rms": Estimate(rms, rms, rms, unit)},
        gain=Gain(0.0, 0.0, 0.0, 1.0),
        alternatives=(),
        rejected=(),
        sentence=(
            f"{name} is off by {quantity(after, unit)} RMS, {after / least:.2g} times "
            f"{words}, and it depends on nothing that was tried"
        ),
        picture=None,
        left_out=NO_TERM,
        remedy=Unknown.REMEDY,
    )
