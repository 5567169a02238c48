"""Whether an arm may be compensated with an identified model: good, usable, or not at all."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import sqrt

from dvrk_gravity.arms import SCALES, Arm, Joint, thousandth
from dvrk_gravity.arrays import Array
from dvrk_gravity.identification.holding import HoldingSettings
from dvrk_gravity.identification.result import (
    Contradiction,
    Holding,
    JointError,
    JointVerdict,
    Verdict,
    in_words,
)
from dvrk_gravity.model import NO_VERDICT, VERDICTS, TorqueModel
from dvrk_gravity.recording import STILL, Coordinates, DataWarning

GOOD, USABLE, POOR = VERDICTS
# What to record instead: of a motion, of static poses.
CLEAN = (
    "a motion with nothing touching the arm and commands as smooth as the motion (`diagnose` tells "
    "what else acts)",
    "poses with nothing touching the arm, each settled before it is read (`diagnose` tells what "
    "else acts)",
)
MORE = (
    "a longer motion of all joints at once over most of their ranges",
    "more poses, all joints over most of their ranges in many combinations",
)
FURTHER = (
    "further motions elsewhere in the joints' ranges, as `excite --seed` makes them, and give all "
    "of them to identify",
    "poses nearer to the limits of all joints, and more positions of each",
)
NOISE = (
    "the efforts of no joint are predicted better than by a constant: noise, or those of another "
    "motion?"
)
CLOCK = "times in seconds of one clock, and velocities that go with them"
THIS_JOINT = ("a motion of {joint}, too", "poses of {joint}, too")
BOTH_WAYS = "every pose approached from both directions, with a `direction` column that says which"

TINY = 1e-12  # N·m, in place of a torque of zero that an error is divided by


@dataclass(frozen=True)
class VerdictSettings:
    """Thresholds of the verdict.

    Attributes:
        good: Largest error of a good model, as a part of the torque, at joints of which none is
            published (:class:`~dvrk_gravity.arms.Joint`): that of an MTM's shoulder, which carries
            the weight of all further links as most joints do.
        usable: Error above which not to compensate, as a part of the torque: the dVRK console's own
            test of a calibration warns from there.
        usable_over_good: But never less than so many times what is good, that is twice its square:
            the published error of an MTM's wrist_roll alone is more than ``usable``.
        negligible: Error that moves no joint, as a part of its effort limit. The least dry friction
            of any joint of a real MTM is about as much: 0.8 % at elbow_pitch, 9 % at wrist_platform
            (half the difference between the directions of the poses in docs/static_poses.md).
        friction: Error that dry friction may be, as a part of the effort limit: about the most of
            the same joints. Where poses do not tell friction apart, it is in the error.
        shortest: s of motion, below which errors held out say little of another motion: a twelfth
            of it is held out at a time, next to what was fitted. As for a diagnosis (``load.py``).
    """

    good: float = 0.163
    usable: float = 0.30
    usable_over_good: float = 2.0**0.5
    negligible: float = 0.01
    friction: float = 0.1
    shortest: float = 8.0

    def good_to(self, joint: Joint) -> float:
        """Return up to which part of a joint's torque an error is good."""
        return joint.published_error or self.good

    def level(self, joint: Joint, share: float) -> str:
        """Return the verdict on an error that is such a part of a joint's torque."""
        good = self.good_to(joint)
        if share <= good:
            return GOOD
        return USABLE if share <= max(self.usable, self.usable_over_good * good) else POOR

    @property
    def rule(self) -> str:
        """What decides between good, usable and neither, in a line."""
        return (
            "|e|/|tau| is good up to the joint's 'good to', and usable up to the larger of "
            f"{self.usable:g} and {self.usable_over_good:.2g} times its 'good to'; an error below "
            f"{100 * self.negligible:g} % of its effort limit moves no joint, and is good"
        )


def judge(
    errors: Mapping[str, JointError],
    training: Mapping[str, JointError],
    holding: Mapping[str, Holding],
    arm: Arm,
    coordinates: Coordinates,
    static: bool = False,
    with_friction: Collection[str] = (),
    settings: VerdictSettings | None = None,
    duration: float | None = None,
    against: Sequence[Contradiction] = (),
) -> Verdict:
    """Judge a fit by its error on data that it had not seen, and by what it leaves open.

    A joint is judged by the worst of five: what the arm's masses say against it
    (:mod:`~dvrk_gravity.identification.weights`); the held-out error; the standard error of the
    torque that holds the arm still, where it was recorded; the same anywhere within the arm's
    limits, and whether the joint moved at all, which cost no more than "good". Errors too small to
    move the joint count as none, unless a constant's are as small: then nothing is predicted.
    Friction that poses do not tell apart keeps a model from being "good", and does not make it one
    that is not to be compensated with.

    Args:
        errors: Held out, by joint.
        training: On the data fitted, by joint.
        holding: Certainty of the torque that holds the arm still, by joint.
        arm: The arm.
        coordinates: Of the errors.
        static: Whether the recordings were poses.
        with_friction: Joints whose friction these errors hold, as the way in which their poses were
            approached is not known.
        settings: Thresholds; default: :class:`VerdictSettings`.
        duration: s of motion, if it is one.
        against: What the arm's masses say against it.
    """
    lines = tuple(each.line for each in against)
    if not any(errors[name].beats_constant for name in arm.joint_names):
        lines = (NOISE, *lines)
    settings = settings or VerdictSettings()
    if duration is not None and duration < settings.shortest:
        why = f"{duration:.2g} s of motion, of which parts are held out next to what was fitted"
        short = JointVerdict(POOR, why, MORE[0])
        return Verdict(POOR, why, MORE[0], dict.fromkeys(arm.joint_names, short), lines)
    at_motor = coordinates == "actuator"
    joints = {}
    limits = arm.actuator_effort_limit if at_motor else arm.effort_limit
    comparable = (_comparable(efforts, arm).tolist() for efforts in (limits, arm.effort_limit))
    for joint, limit, at_joint in zip(arm.joints, *comparable, strict=True):
        name = joint.name
        if not static and _stood(joint, holding[name], arm):
            joints[name] = JointVerdict(
                POOR,
                "stood still all the time: its effort, which its friction may hold any part of, "
                "was not fitted",
                f"a motion of {name}, too",
            )
            continue
        found = [
            *(
                JointVerdict(each.level, each.reason, each.record)
                for each in against
                if name in each.joints
            ),
            _of_error(
                joint, errors[name], training[name], settings, limit, static, name in with_friction
            ),
            *_of_holding(joint, holding[name], settings, static, at_joint),
        ]
        joints[name] = max(found, key=lambda verdict: VERDICTS.index(verdict.level))
    level = max((verdict.level for verdict in joints.values()), key=VERDICTS.index)
    named = (
        {}
        if level == GOOD
        else {n: verdict for n, verdict in joints.items() if verdict.level == level}
    )
    return Verdict(
        level,
        "; ".join(f"{name}: {verdict.reason}" for name, verdict in named.items()),
        "; ".join(dict.fromkeys(verdict.record for verdict in named.values())),
        joints,
        lines,
    )


def of_clock(warnings: Iterable[DataWarning], arm: Arm) -> tuple[Contradiction, ...]:
    """Return what speaks against a model of recordings whose times, or all velocities, are wrong.

    Where it is the clock, viscous friction is off by its factor and inertia by the square, on data
    held out as well: their times are as wrong.

    Args:
        warnings: What was found in the recordings.
        arm: The arm.
    """
    return tuple(
        Contradiction(
            arm.joint_names, POOR, "the clock, or all velocities, are wrong", str(warning), CLOCK
        )
        for warning in warnings
        if warning.kind == "wrong_clock"
    )


def _stood(joint: Joint, holding: Holding, arm: Arm) -> bool:
    """Tell whether friction may have held a joint all the time."""
    still = STILL * SCALES[joint.kind]
    return holding.upper - holding.lower < still and joint.name not in arm.frictionless


def compared(
    model: TorqueModel,
    errors: Mapping[str, JointError],
    coordinates: Coordinates,
    with_friction: Collection[str] = (),
) -> str:
    """Say in a line how errors on a recording compare with what identification said of a model.

    Args:
        model: The model.
        errors: Of the model on the recording, by joint.
        coordinates: Of the errors.
        with_friction: As of :func:`judge`.
    """
    alone = by_errors(model.arm, errors, coordinates, with_friction)
    levels = {name: verdict.level for name, verdict in alone.items()}
    found = max(levels.values(), key=VERDICTS.index)
    which = [
        f"{name} {_percent(errors[name].nrmse)}" for name, level in levels.items() if level == found
    ]
    rubs = any(level == found and name in with_friction for name, level in levels.items())
    said = (
        "the model carries no verdict of identify"
        if model.verdict == NO_VERDICT
        else f"verdict in the model file: {in_words(model.verdict)}"
    )
    held = ", with friction that these poses do not tell apart" if rubs else ""
    why = "" if found == GOOD else f" ({', '.join(which)} of the torque{held})"
    further = "; `diagnose` tells whether that is news, and of what" if found == POOR else ""
    return f"{said}; from these errors alone it would be: {in_words(found)}{why}{further}"


def by_errors(
    arm: Arm,
    errors: Mapping[str, JointError],
    coordinates: Coordinates,
    with_friction: Collection[str] = (),
) -> dict[str, JointVerdict]:
    """Judge the joints of a recording by the errors of a model on it alone.

    A reason is given where it is not the bound on the error relative to the torque.

    Args:
        arm: The arm.
        errors: By joint.
        coordinates: Of the errors.
        with_friction: As of :func:`judge`.
    """
    settings = VerdictSettings()
    limits = arm.actuator_effort_limit if coordinates == "actuator" else arm.effort_limit
    found = {}
    for joint, limit in zip(arm.joints, _comparable(limits, arm).tolist(), strict=True):
        if joint.name not in errors:
            continue
        error = errors[joint.name]
        level = _level(joint, error, limit, settings, joint.name in with_friction)
        reason = ""
        if level != settings.level(joint, error.nrmse):
            reason = (
                f"{_milli(error.rmse, joint)} moves no joint"
                if error.rmse <= settings.negligible * limit
                else f"{_milli(error.rmse, joint)} may be friction, which these poses do not show"
            )
        found[joint.name] = JointVerdict(level, reason)
    return found


def _comparable(limits: Array, arm: Arm) -> Array:
    """Return effort limits that errors compare with: none where their size is not known."""
    return 0.0 * limits if arm.read_in and arm.effort_size == 1.0 else limits


def _level(
    joint: Joint, error: JointError, limit: float, settings: VerdictSettings, with_friction: bool
) -> str:
    """Return the verdict on an error alone, whose joint or motor has an effort limit."""
    if not error.beats_constant:
        return POOR
    if error.rmse <= settings.negligible * limit:
        return GOOD
    level = settings.level(joint, error.nrmse)
    may_rub = with_friction and error.rmse <= settings.friction * limit
    return USABLE if may_rub and level == POOR else level


def _of_error(
    joint: Joint,
    error: JointError,
    training: JointError,
    settings: VerdictSettings,
    limit: float,
    static: bool,
    with_friction: bool,
) -> JointVerdict:
    reason = f"held-out error {_percent(error.nrmse)} of its torque ({_milli(error.rmse, joint)})"
    if not error.beats_constant:
        reason += ", no less than a constant's: of its effort nothing is predicted"
        return JointVerdict(POOR, reason, CLEAN[static])
    if error.rmse <= settings.negligible * limit:
        return JointVerdict(GOOD, f"{reason}, which moves no joint")
    level = _level(joint, error, limit, settings, with_friction=False)
    if level == GOOD:
        return JointVerdict(GOOD, reason)
    fitted = _percent(training.nrmse)
    if with_friction and error.rmse <= settings.friction * limit:
        # Friction is in both errors alike; what is held out adds what the fit does not know.
        added = sqrt(max(1.0 - (training.nrmse / error.nrmse) ** 2, 0.0))
        unknown = JointError(added * error.rmse, added * error.nrmse, error.r2)
        if _level(joint, unknown, limit, settings, with_friction=False) == POOR:
            reason += f", {fitted} on what was fitted, both with friction: too little was recorded"
            return JointVerdict(POOR, reason, MORE[static])
        reason += f", hardly less on what was fitted ({fitted}): friction, which poses approached "
        reason += "from unknown directions do not tell apart, or what else acts"
        return JointVerdict(USABLE, reason, BOTH_WAYS)
    if VERDICTS.index(settings.level(joint, training.nrmse)) >= VERDICTS.index(level):
        reason += f", hardly less on what was fitted ({fitted}): something acts that no term is for"
        return JointVerdict(level, reason, CLEAN[static])
    reason += f", {fitted} on what was fitted: too little was recorded for what acts"
    return JointVerdict(level, reason, MORE[static])


def _of_holding(
    joint: Joint, holding: Holding, settings: VerdictSettings, static: bool, limit: float
) -> Iterator[JointVerdict]:
    here, anywhere = (
        GOOD
        if error <= settings.negligible * limit
        else settings.level(joint, error / max(torque, TINY))
        for error, torque in (
            (holding.error, holding.torque),
            (holding.error_anywhere, holding.torque_anywhere),
        )
    )
    if here != GOOD:
        reason = "the torque that holds the arm still is known poorly"
        yield JointVerdict(
            here,
            f"{reason}: {_milli(holding.torque, joint)}, of which "
            f"{_milli(holding.error, joint)} are uncertain",
            MORE[static],
        )
    elif anywhere == POOR:
        error = _milli(holding.error_anywhere, joint)
        reason = "beyond what was recorded, the torque that holds the arm still is known poorly"
        yield JointVerdict(USABLE, f"{reason} (to {error})", FURTHER[static])
    span = holding.upper - holding.lower
    if span < HoldingSettings().narrow * SCALES[joint.kind]:
        reason = "what depends on its position is not known"
        yield JointVerdict(
            USABLE,
            f"hardly moved (by {joint.shown(span, 1)}): {reason}",
            THIS_JOINT[static].format(joint=joint.name),
        )


def _milli(torque: float, joint: Joint) -> str:
    """Return a torque in mN·m or mN, with two digits or more."""
    number = f"{1e3 * torque:.2g}" if abs(torque) < 0.01 else f"{1e3 * torque:.0f}"
    return f"{number} {thousandth(joint.effort_unit)}"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"
