"""Whether an arm may be compensated with an identified model: good, usable, or not at all."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import sqrt

from dvrk_gravity.arms import SCALES, Arm, Joint, thousandth
from dvrk_gravity.arrays import Array
from dvrk_gravity.identification.quality.uncertainty import NARROW
from dvrk_gravity.identification.quality.weights import scale_in_words
from dvrk_gravity.identification.result import (
    SIGNIFICANT,
    Constant,
    Contradiction,
    Fit,
    HeldWeight,
    Holding,
    JointError,
    JointVerdict,
    Verdict,
)
from dvrk_gravity.model import VERDICTS
from dvrk_gravity.observation import Misread
from dvrk_gravity.recording import STILL, Coordinates, Note
from dvrk_gravity.units import quantity

GOOD, USABLE, POOR = VERDICTS
# What to record instead: of a motion, of static poses.
CLEAN = (
    "a free motion, without contact and with smooth commands (`diagnose` names the unmodelled "
    "effect)",
    "free poses, without contact, each settled before it is read (`diagnose` names the unmodelled "
    "effect)",
)
MORE = (
    "a longer motion of all joints at once over most of their ranges",
    "more poses, all joints over most of their ranges in many combinations",
)
FURTHER = (
    "more motions in other parts of the joints' ranges (`excite --seed`), and pass all of them to "
    "identify",
    "poses nearer to the limits of all joints, and more positions of each",
)
NOISE = (
    "the efforts of no joint are predicted better than by a constant: noise, or those of another "
    "motion?"
)
CLOCK = "times in seconds of one clock, and velocities that match them"
SETTLES = (
    "no motion settles what a constant is: a release does (`calibrate`), or --bias-is "
    "reading|torque states it"
)
THIS_JOINT = ("a motion of {joint}, too", "poses of {joint}, too")
BOTH_WAYS = "every pose approached from both directions, with a `direction` column that says which"

_TINY = 1e-12  # N·m, in place of a torque of zero that an error is divided by

# Largest error of a good model, relative to the torque, at joints of which none is published
# (``Joint.published_error``): that of an MTM's shoulder, which carries the weight of all further
# links as most joints do.
_GOOD = 0.163
# Relative error above which not to compensate: the dVRK console's own test of a calibration warns
# from there; but never less than so many times what is good, twice its square: the published error
# of an MTM's wrist_roll alone is more.
_USABLE = 0.30
_USABLE_OVER_GOOD = 2.0**0.5
# Error that moves no joint, as a part of its effort limit. The least dry friction of any joint of a
# real MTM is about as much: 0.8 % at elbow_pitch, 9 % at wrist_platform (half the difference
# between the directions of the poses in docs/static_poses.md).
_NEGLIGIBLE = 0.01
# Error that dry friction may be, as a part of the effort limit: about the most of the same joints.
# Where poses do not separate friction, it is in the error.
_FRICTION = 0.1
# s of motion, below which held-out errors say little of another motion: a twelfth of it is held out
# at a time, next to what was fitted. As for a diagnosis (``LoadSettings.shortest``).
_SHORTEST = 8.0

RULE = (
    f"|e|/|tau| is good up to the joint's 'good to', and usable up to the larger of {_USABLE:g} "
    f"and {_USABLE_OVER_GOOD:.2g} times its 'good to'; an error below {100 * _NEGLIGIBLE:g} % of "
    "its effort limit is less than dry friction, and is good"
)


def good_to(joint: Joint) -> float:
    """Return the largest good error of a joint, relative to its torque."""
    return joint.published_error or _GOOD


def level_of(joint: Joint, relative: float) -> str:
    """Return the verdict on an error relative to a joint's torque."""
    good = good_to(joint)
    if relative <= good:
        return GOOD
    return USABLE if relative <= max(_USABLE, _USABLE_OVER_GOOD * good) else POOR


def judge(
    errors: Mapping[str, JointError],
    training: Mapping[str, JointError],
    holding: Mapping[str, Holding],
    arm: Arm,
    coordinates: Coordinates,
    static: bool = False,
    with_friction: Collection[str] = (),
    duration: float | None = None,
    against: Sequence[Contradiction] = (),
) -> Verdict:
    """Judge a fit by its held-out error and by what it leaves open.

    A joint's verdict is the worst of five: contradictions with the arm's masses
    (:mod:`~dvrk_gravity.identification.quality.weights`); the held-out error; the standard error of
    the gravity torque, where it was recorded; the same anywhere within the arm's limits, and
    whether the joint moved at all, which cost no more than "good". An error of the gravity torque
    that is less than the joint's own dry friction does not set it in motion: it costs no more than
    "good" either. Errors too small to move the joint count as none, unless a constant's are as
    small: then nothing is predicted. Friction that poses do not separate costs no more than "good"
    either.

    Args:
        errors: Held out, by joint.
        training: On the data fitted, by joint.
        holding: Gravity torque and its uncertainty, by joint.
        arm: The arm.
        coordinates: Of the errors.
        static: Whether the recordings were poses.
        with_friction: Joints whose errors include friction, as the directions of approach are not
            known.
        duration: s of motion, if it is one.
        against: Contradictions with the arm's masses, and of the clock.
    """
    lines = tuple(each.line for each in against)
    if not any(errors[name].beats_constant for name in arm.joint_names):
        lines = (NOISE, *lines)
    if duration is not None and duration < _SHORTEST:
        why = f"{duration:.2g} s of motion, of which parts are held out next to what was fitted"
        short = JointVerdict(POOR, why, MORE[0])
        return Verdict(POOR, why, MORE[0], dict.fromkeys(arm.joint_names, short), lines)
    joints = {}
    limits = arm.actuator_effort_limit if coordinates == "actuator" else arm.effort_limit
    comparable = (_comparable(efforts, arm).tolist() for efforts in (limits, arm.effort_limit))
    for joint, limit, at_joint in zip(arm.joints, *comparable, strict=True):
        name = joint.name
        if not static and _stood(joint, holding[name], arm):
            why = "stood still all the time: friction may hold any part of its effort, not fitted"
            joints[name] = JointVerdict(POOR, why, THIS_JOINT[0].format(joint=name))
            continue
        found = [
            *(JointVerdict(x.level, x.reason, x.record) for x in against if name in x.joints),
            _of_error(joint, errors[name], training[name], limit, static, name in with_friction),
            *_of_holding(joint, holding[name], static, at_joint),
        ]
        joints[name] = max(found, key=lambda verdict: VERDICTS.index(verdict.level))
    return _overall(joints, lines)


def _overall(joints: Mapping[str, JointVerdict], lines: tuple[str, ...]) -> Verdict:
    """Return the verdict of the worst joint, with all that have it."""
    level = max((verdict.level for verdict in joints.values()), key=VERDICTS.index)
    named = {n: v for n, v in joints.items() if v.level == level != GOOD}
    return Verdict(
        level,
        "; ".join(f"{name}: {verdict.reason}" for name, verdict in named.items()),
        "; ".join(dict.fromkeys(verdict.record for verdict in named.values())),
        joints,
        lines,
    )


def with_constants(
    verdict: Verdict, constants: Mapping[str, Constant], weights: Sequence[HeldWeight], arm: Arm
) -> Verdict:
    """Return a verdict that no constant in doubt leaves good, with what is known of the scale.

    Args:
        verdict: Of a fit's errors and of what it leaves open.
        constants: The constant part of what holds each joint, by joint.
        weights: The weight that was found, where the arm's masses are known.
        arm: The arm.
    """
    joints = dict(verdict.joints)
    for joint in arm.joints:
        found = constants[joint.name]
        if found.in_doubt and joints[joint.name].level == GOOD:
            reason = (
                f"a constant of {constant_in_words(found, joint)}, of a spring, a bias or a hand"
            )
            joints[joint.name] = JointVerdict(USABLE, reason, SETTLES)
    if joints != verdict.joints:
        verdict = _overall(joints, verdict.findings)
    scale = scale_in_words(weights)
    if verdict.level == POOR or not scale:
        return verdict
    return replace(verdict, reason="; ".join(filter(None, (verdict.reason, scale))))


def constant_in_words(constant: Constant, joint: Joint) -> str:
    """Return the size of a constant, with what it may be off by where that moves the joint."""
    if constant.determined:
        return quantity(constant.value, joint.effort_unit)
    half = SIGNIFICANT * constant.error
    if abs(constant.value) <= half:
        return f"up to {quantity(abs(constant.most), joint.effort_unit)}"
    return quantity(constant.value, joint.effort_unit, half)


def of_clock(warnings: Iterable[Note], arm: Arm) -> tuple[Contradiction, ...]:
    """Return the evidence against a model of recordings whose clock, or all velocities, are wrong.

    With a wrong clock, viscous friction is off by its factor and inertia by the square, on held-out
    data as well.
    """
    return tuple(
        Contradiction(
            arm.joint_names, POOR, "the clock, or all velocities, are wrong", str(warning), CLOCK
        )
        for warning in warnings
        if warning.kind == "wrong_clock"
    )


def of_misread(fit: Fit, wrong: Misread) -> Fit:
    """Return a fit to a recording that is not of the arm as its file has it, as unfit.

    What it has against joints comes of that, and is left out.
    """
    rest = JointVerdict(USABLE, f"not judged: {', '.join(wrong.joints)} first")
    own = JointVerdict(POOR, wrong.reason, wrong.record)
    joints = {name: own if name in wrong.joints else rest for name in fit.verdict.joints}
    return replace(
        fit,
        model=replace(fit.model, verdict=POOR, reason=wrong.line),
        verdict=Verdict(POOR, wrong.line, wrong.record, joints, (wrong.line,)),
        constants={},
        weights=(),
        against=(),
    )


def negligible(arm: Arm) -> Array:
    """Return (n,) torques that move no joint, N·m or N."""
    return _NEGLIGIBLE * _comparable(arm.effort_limit, arm)


def _stood(joint: Joint, holding: Holding, arm: Arm) -> bool:
    """Whether friction may have held a joint all the time."""
    still = STILL * SCALES[joint.kind]
    return holding.upper - holding.lower < still and joint.name not in arm.frictionless


def by_errors(
    arm: Arm,
    errors: Mapping[str, JointError],
    coordinates: Coordinates,
    with_friction: Collection[str] = (),
) -> dict[str, JointVerdict]:
    """Judge the joints of a recording by a model's errors on it alone.

    A reason is given where it is not the bound on the relative error. Arguments as of
    :func:`judge`.
    """
    limits = arm.actuator_effort_limit if coordinates == "actuator" else arm.effort_limit
    found = {}
    for joint, limit in zip(arm.joints, _comparable(limits, arm).tolist(), strict=True):
        if joint.name not in errors:
            continue
        error = errors[joint.name]
        level = _level(joint, error, limit, joint.name in with_friction)
        reason = ""
        if level != level_of(joint, error.nrmse):
            reason = (
                f"{_shown(error.rmse, joint)} is less than dry friction"
                if error.rmse <= _NEGLIGIBLE * limit
                else f"{_shown(error.rmse, joint)} may be friction, which these poses do not show"
            )
        found[joint.name] = JointVerdict(level, reason)
    return found


def _comparable(limits: Array, arm: Arm) -> Array:
    """Return effort limits that errors compare with: none where their size is not known."""
    return 0.0 * limits if arm.read_in and arm.effort_size == 1.0 else limits


def _level(joint: Joint, error: JointError, limit: float, with_friction: bool) -> str:
    """Return the verdict on an error alone, whose joint or motor has an effort limit."""
    if not error.beats_constant:
        return POOR
    if error.rmse <= _NEGLIGIBLE * limit:
        return GOOD
    level = level_of(joint, error.nrmse)
    may_rub = with_friction and error.rmse <= _FRICTION * limit
    return USABLE if may_rub and level == POOR else level


def _of_error(
    joint: Joint,
    error: JointError,
    training: JointError,
    limit: float,
    static: bool,
    with_friction: bool,
) -> JointVerdict:
    reason = f"held-out error {_percent(error.nrmse)} of its torque ({_shown(error.rmse, joint)})"
    if not error.beats_constant:
        return JointVerdict(POOR, f"{reason}, no better than a constant", CLEAN[static])
    if error.rmse <= _NEGLIGIBLE * limit:
        return JointVerdict(GOOD, f"{reason}, less than dry friction")
    level = _level(joint, error, limit, with_friction=False)
    if level == GOOD:
        return JointVerdict(GOOD, reason)
    fitted = _percent(training.nrmse)
    if with_friction and error.rmse <= _FRICTION * limit:
        # Friction is in both errors; the held-out one adds what the fit does not determine.
        added = sqrt(max(1.0 - (training.nrmse / error.nrmse) ** 2, 0.0))
        unknown = JointError(added * error.rmse, added * error.nrmse, error.r2)
        if _level(joint, unknown, limit, with_friction=False) == POOR:
            reason += f", {fitted} on the data fitted, both with friction: too little was recorded"
            return JointVerdict(POOR, reason, MORE[static])
        reason += f", hardly less on the data fitted ({fitted}): friction, as the poses' directions"
        reason += " of approach are not known, or an unmodelled effect"
        return JointVerdict(USABLE, reason, BOTH_WAYS)
    if VERDICTS.index(level_of(joint, training.nrmse)) >= VERDICTS.index(level):
        reason += f", hardly less on the data fitted ({fitted}): an unmodelled effect"
        return JointVerdict(level, reason, CLEAN[static])
    reason += f", {fitted} on the data fitted: too little was recorded"
    return JointVerdict(level, reason, MORE[static])


def _of_holding(
    joint: Joint, holding: Holding, static: bool, limit: float
) -> Iterator[JointVerdict]:
    here, anywhere = (
        GOOD if error <= _NEGLIGIBLE * limit else level_of(joint, error / max(torque, _TINY))
        for error, torque in (
            (holding.error, holding.torque),
            (holding.error_anywhere, holding.torque_anywhere),
        )
    )
    if here != GOOD:
        size = quantity(holding.torque, joint.effort_unit, holding.error)
        reason = f"gravity torque uncertain: {size}"
        # A joint stays at rest where |e| <= friction: of e ~ N(0, error^2) at two poses of three,
        # if both are equal, and it drifts slowly at the third. That is usable. A calibration's
        # certificate demands 95 % (``calibration.release``).
        if here == POOR and holding.error <= holding.friction:
            here = USABLE
            reason += f", less than its dry friction ({_shown(holding.friction, joint)})"
        yield JointVerdict(here, reason, MORE[static])
    elif anywhere == POOR:
        error, outside = _shown(holding.error_anywhere, joint), "outside the recorded poses"
        yield JointVerdict(
            USABLE, f"gravity torque uncertain by ±{error} {outside}", FURTHER[static]
        )  # fmt: skip
    span = holding.upper - holding.lower
    if span < NARROW * SCALES[joint.kind]:
        yield JointVerdict(
            USABLE,
            f"hardly moved (by {joint.shown(span, 1)}): its dependence on position is not known",
            THIS_JOINT[static].format(joint=joint.name),
        )


def _shown(torque: float, joint: Joint) -> str:
    """Return a torque or force, from 1 N·m or N on as such and else in thousandths."""
    if abs(torque) >= 1.0:
        return f"{torque:.3g} {joint.effort_unit}"
    number = f"{1e3 * torque:.2g}" if abs(torque) < 0.01 else f"{1e3 * torque:.0f}"
    return f"{number} {thousandth(joint.effort_unit)}"


def _percent(part: float) -> str:
    return f"{100 * part:.0f} %"
