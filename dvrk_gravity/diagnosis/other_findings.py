"""Findings that are no named effect: wrong readings, and structure without a name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis.bench import Bench
from dvrk_gravity.diagnosis.candidate import Candidate
from dvrk_gravity.diagnosis.contest import Contest
from dvrk_gravity.diagnosis.findings import (
    FLOORS,
    Alternative,
    Finding,
    FloorFrom,
    Gain,
    Picture,
)
from dvrk_gravity.diagnosis.judge import Judge
from dvrk_gravity.diagnosis.motion import Motion
from dvrk_gravity.diagnosis.readings import ReadingScore
from dvrk_gravity.diagnosis.selection import Tried
from dvrk_gravity.effects.effect import Hypothesis
from dvrk_gravity.effects.meaning import Estimate
from dvrk_gravity.effects.unknown import Unknown
from dvrk_gravity.effects.wrong_coordinates import WrongCoordinates
from dvrk_gravity.quantity import quantity

Array = NDArray[np.float64]


def unknown_finding(
    judge: Judge, contest: Contest, named: Sequence[Candidate], tried: Tried, before: Array
) -> Finding:
    """Return the finding of structure that no name fits."""
    hypothesis = tried.candidate.hypothesis
    after = judge.error([*named, tried.candidate])
    joint = hypothesis.joints[0]
    gain = judge.gain(before, after, [joint])
    rms = float(np.sqrt(max(judge.rmse(before)[joint] ** 2 - judge.rmse(after)[joint] ** 2, 0.0)))
    return Finding(
        effect=Unknown.NAME,
        joints=hypothesis.names,
        place=hypothesis.place,
        parameters={"rms": Estimate(rms, rms, rms, hypothesis.unit("rms"))},
        gain=gain,
        alternatives=(),
        rejected=(),
        sentence=(
            f"{hypothesis.names[0]} has structure of {quantity(rms, hypothesis.unit('rms'))} RMS "
            f"that depends on {hypothesis.place}, and no known effect explains it"
        ),
        picture=picture_of(contest.bench, judge, hypothesis, joint, before, after),
        in_model=False,
    )


def as_read_before(motion: Motion, bench: Bench, judge: Judge) -> Array:
    """Return (H, 7) errors of the recording as it was read first, same samples."""
    error = bench.reduce(motion.residual)[judge.rows]
    return np.where(bench.usable[judge.rows], error, np.nan)


def reading_finding(
    score: ReadingScore, alike: Sequence[ReadingScore], before: Array, after: Array, judge: Judge
) -> Finding:
    """Return the finding that the recording was read wrongly."""
    old, new = judge.rmse(before), judge.rmse(after)
    joints = list(score.reading.joints) or [int(np.argmin(new / np.maximum(old, 1e-12)))]
    gain: Gain = judge.gain(before, after, joints)
    joint_names = judge.joint_names
    names = tuple(joint_names[joint] for joint in score.reading.joints)
    return Finding(
        effect=WrongCoordinates.NAME,
        joints=names,
        place=score.reading.words,
        parameters={},
        gain=gain,
        alternatives=tuple(
            Alternative(
                WrongCoordinates.NAME,
                tuple(joint_names[joint] for joint in other.reading.joints),
                f"{other.reading.words}: log-likelihood gain {other.gain:.0f} "
                f"against {score.gain:.0f}",
            )
            for other in alike
        ),
        rejected=(),
        sentence=(
            f"The recording is read wrongly: {score.reading.words}; read rightly, "
            f"{100 * gain.relative:.0f} % of the error at {joint_names[joints[0]]} is gone"
        ),
        picture=None,
        in_model=False,
    )


def picture_of(
    bench: Bench, judge: Judge, hypothesis: Hypothesis, joint: int, before: Array, after: Array
) -> Picture:
    """Return the held-out error of a joint against what a hypothesis depends on."""
    motion = bench.motion
    variable = hypothesis.variable if not motion.static else "position"
    own = joint if hypothesis.depends_on is None else hypothesis.depends_on
    name, unit = motion.arm.joint_names[own], motion.arm.joints[own].unit
    scale, shown = (np.degrees(1.0), "deg") if unit == "rad" else (1e3, "mm")
    values, label = {
        "position": (scale * motion.q[:, own], f"position of {name} [{shown}]"),
        "velocity": (scale * motion.qd[:, own], f"velocity of {name} [{shown}/s]"),
        "acceleration": (scale * motion.qdd[:, own], f"acceleration of {name} [{shown}/s²]"),
        "time": (motion.time, "time [s]"),
    }[variable]
    x = bench.reduce_state(values[:, None])[judge.rows, 0]
    forward = None
    if variable == "position" and hypothesis.directed:
        way = motion.qd if motion.direction is None else motion.direction
        forward = bench.reduce_state(way[:, [own]])[judge.rows, 0] > 0.0
    return Picture(
        motion.arm.joint_names[joint], label, x, before[:, joint], after[:, joint], forward
    )


def shapeless_finding(
    arm: Arm, joint: int, after: float, floor: float, source: FloorFrom
) -> Finding:
    """Return the finding that a joint is off by more than noise, whatever it depends on."""
    rms = float(np.sqrt(after**2 - floor**2))
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
            f"{name} is off by {quantity(after, unit)} RMS, {after / floor:.2g} times "
            f"{FLOORS[source]}, and it depends on nothing that was tried"
        ),
        picture=None,
        in_model=False,
    )
