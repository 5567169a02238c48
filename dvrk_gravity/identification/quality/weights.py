"""Does a model hold what the arm's masses weigh? Only they show a wrong scale of the readings.

A model fitted to efforts in another unit, with a wrong torque constant, or without gravity,
predicts such efforts well, held out or not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from dvrk_gravity.arms import (
    ANY_UNIT,
    EFFORT_UNITS,
    PLANTS,
    PLATFORM,
    PLATFORM_BETA,
    SCALES,
    Arm,
    platform_fault,
    plausible_plant,
    rigid_body,
)
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.effects import State, last_link, stated_weight, weight_directions
from dvrk_gravity.files import yaml_file
from dvrk_gravity.files.resources import config_path
from dvrk_gravity.gravity import BETA_NAMES
from dvrk_gravity.identification.quality.uncertainty import NARROW
from dvrk_gravity.identification.result import (
    Contradiction,
    FittedParameter,
    HeldWeight,
    Holding,
)
from dvrk_gravity.model import ARM_PARAMETER, VERDICTS, WEIGHT, TorqueModel
from dvrk_gravity.observation import OTHER_ARM, OTHER_SIDE
from dvrk_gravity.parameters import flatten
from dvrk_gravity.recording import Note

_, USABLE, POOR = VERDICTS
_INSTEAD = "(if its masses are wrong: --effort-unit N·m, or effort_unit in the arm's file)"
READ_WITHOUT = "effort_has_gravity: {read: false} in the arm's file"


POSES = 500  # recorded poses that are looked at. Chosen: ratios are then known to 3 %
# Part of a joint's effort limit, or of the heaviest joint's weight, from which on weight counts.
# Chosen: of a UR10e's wrists .035 and .002 of the limit; the second is of centres of mass that are
# known to a millimetre, and a load is thirty times as much.
SEEN = 0.02
DEVIATIONS = 2.0  # standard errors by which a ratio is beyond a bound. Chosen
# Less than this part of the weight is none. Chosen: a driver's own masses, by which it subtracts
# gravity, are right to some per cent; and a real PSM, whose pitch is balanced otherwise than the
# shipped plant's, holds .2 to .4 of what that weighs, joints of an MTMR .2 to 1.6
# (test/test_weights.py).
GONE = 0.1
WEIGH = "weigh something of known mass (`diagnose --payload-at`)"
UNKNOWN_SCALE = f"the scale is the recording's: {WEIGH}"
SAME = 1.25  # factor within which ratios of several joints are one. Chosen
# Part of what efforts are off their own joints' weights that they are off each other's, squared,
# where two are exchanged. Chosen.
EXCHANGED = 0.25
# Greatest load, as a part of the arm's mass. Chosen: robots carry less (UR10e .37, Panda .17, iiwa
# .47).
LOAD = 0.5
REACH = 0.5  # m, from its link's frame to its centre. Chosen: a long tool


def held_weights(
    model: TorqueModel,
    q: Array,
    holding: Mapping[str, Holding],
) -> tuple[HeldWeight, ...]:
    """Return a model's torque at rest beside the weight of the arm's masses, where they weigh.

    Args:
        model: The model.
        q: (N, n) recorded positions, rad or m.
        holding: Gravity torque and its uncertainty, by joint.
    """
    arm = model.arm
    q = q[:: max(1, len(q) // POSES)]
    weight, stated = _weight(arm, q)
    if weight is None:
        return ()
    held = _at_rest(model, q)
    size, found = np.sqrt(np.mean(weight**2, axis=0)), np.sqrt(np.mean(held**2, axis=0))
    counts = bears_weight(size, arm)
    scale = arm.effort_size if arm.read_in == ANY_UNIT else 1.0
    known = arm.newtons_stated or arm.read_in not in ("", ANY_UNIT)
    loaded = np.zeros(arm.n, dtype=bool)
    if stated and scale == 1.0:  # no load makes four times the weight of all joints
        loaded = _by_load(arm, q, held, weight)
    ratio = np.divide((held * weight).mean(axis=0), size**2, where=counts, out=np.zeros(arm.n))
    if not stated:
        ratio = np.divide(found, size, where=counts, out=np.zeros(arm.n))
    return tuple(
        HeldWeight(
            name, scale * float(ratio[j]), scale * holding[name].error / float(size[j]),
            float(size[j]) / scale, stated, not known, bool(loaded[j]), scale,
        )
        for j, name in enumerate(arm.joint_names)
        if counts[j]
    )  # fmt: skip


def idle(arm: Arm, q: Array, static: bool) -> Mask:
    """Return (n,) joints at whose (N, n) positions there is nothing to predict.

    Such a joint bears no weight there, and rests or has no friction; or poses did not move it.
    """
    q = q[:: max(1, len(q) // POSES)]
    weight, _ = _weight(arm, q)
    if weight is None:  # what links of such sizes may weigh
        each = rigid_body.weight_regressor(arm, q, arm.gravity) @ weight_directions(arm)
        weight = np.sqrt((each**2).sum(axis=2))
    light = ~bears_weight(np.sqrt(np.mean(weight**2, axis=0)), arm)
    if not static:
        return np.asarray(light & ~arm.has_friction)
    return np.asarray(light | (np.ptp(q, axis=0) < NARROW * arm.scale))


def bears_weight(size: Array, arm: Arm) -> Mask:
    """Return (n,) joints at which a weight of some (n,) RMS size counts."""
    limit = np.where(arm.effort_limit > 0.0, arm.effort_limit, np.inf)
    return np.asarray(size > SEEN * np.minimum(limit, size.max()))


def _weight(arm: Arm, q: Array) -> tuple[Array | None, bool]:
    """Return (N, n) efforts that hold an arm's masses, and whether its file states them."""
    stated = stated_weight(arm, q)
    return (_plausible_weight(arm, q), False) if stated is None else (stated, True)


def _at_rest(model: TorqueModel, q: Array) -> Array:
    """Return (N, n) torques that a compensator sends to an arm at rest, N·m or N."""
    held = tuple(term for term in model.terms if term.COMPENSATED)
    return replace(model, terms=held).torque(q)


def _plausible_weight(arm: Arm, q: Array) -> Array | None:
    """Return (N, n) efforts that hold the shipped plant of an arm, if there is one."""
    whole = Arm.load(arm.source) if arm.held and arm.source else arm
    name = plausible_plant(whole)
    if not name:
        return None
    content = yaml_file.load(config_path(f"{PLANTS}/{name}.yaml"))
    values = flatten(content["parameters"]) | {ARM_PARAMETER.name: whole.source or whole.name}
    weights = [
        term for term in TorqueModel.from_parameters(values, whole).terms if term.WEIGHT_OF_ARM
    ]
    moving = [whole.joint_names.index(joint) for joint in arm.joint_names]
    full = np.tile([arm.held.get(joint, 0.0) for joint in whole.joint_names], (len(q), 1))
    full[:, moving] = q
    return np.asarray(sum(term.torque(State.of(full)) for term in weights))[:, moving]


def _by_load(arm: Arm, q: Array, held: Array, weight: Array) -> Mask:
    """Return (n,) where a load on the last link explains what is held better than a wrong scale."""
    from scipy.optimize import lsq_linear  # slow to load

    assert arm.inertial_parameters is not None
    first = rigid_body.OF_WEIGHT * arm.body_names.index(last_link(arm))
    columns = rigid_body.weight_regressor(arm, q, arm.gravity)
    columns = columns[:, :, first : first + rigid_body.OF_WEIGHT]
    most = LOAD * float(arm.inertial_parameters[:, 0].sum())
    bound = most * np.array([1.0, *[REACH] * 3])
    error = held - weight
    size = np.sqrt(np.mean(weight**2, axis=0))
    unit = np.maximum(size, SEEN * size.max(initial=0.0))
    rows = (columns / unit[:, None]).reshape(-1, len(bound))
    lower = np.array([0.0, *-bound[1:]])
    load = lsq_linear(rows * bound, (error / unit).ravel(), (lower / bound, 1.0)).x * bound
    scaled = (held * weight).sum(axis=0) / np.maximum((weight**2).sum(axis=0), 1e-300)
    by_load, by_scale = (
        (left**2).sum(axis=0) for left in (error - columns @ load, held - scaled * weight)
    )
    return np.asarray(by_load < by_scale)


def contradictions(
    model: TorqueModel, q: Array, effort: Array, holding: Mapping[str, Holding]
) -> tuple[Contradiction, ...]:
    """Return the contradictions between a model and the arm's masses, worst first.

    Args:
        model: The model.
        q: (N, n) recorded positions, rad or m.
        effort: (N, n) measured efforts in joint space, which show exchanged joints.
        holding: Gravity torque and its uncertainty, by joint.
    """
    arm = model.arm
    weights = held_weights(model, q, holding)
    exchanged = [*_exchanged(weights, arm, q, effort)]
    named = {joint for each in exchanged for joint in each.joints}
    others = [each for each in weights if each.joint not in named]
    found = [
        *exchanged,
        *missing_weights(others, arm),
        *_of_another_size(others),
        *_unmeasured(weights, arm),
    ]
    return tuple(sorted(found, key=lambda each: -VERDICTS.index(each.level)))


def _unmeasured(weights: Sequence[HeldWeight], arm: Arm) -> Iterator[Contradiction]:
    """Report gravity that was not measured."""
    if arm.gravity_in_reading:
        return
    yield Contradiction(
        tuple(each.joint for each in weights),
        USABLE,
        "its weight is what the arm's file states, and was not measured",
        "gravity is that of the masses in the arm's file, and was not measured: efforts are read "
        "without it (effort_has_gravity)",
    )


def _exchanged(
    weights: Sequence[HeldWeight], arm: Arm, q: Array, effort: Array
) -> Iterator[Contradiction]:
    """Report pairs of joints whose efforts are each other's weights."""
    weight = stated_weight(arm, q)
    names = [each.joint for each in weights if each.believed]
    if weight is None:
        return
    index = [arm.joint_names.index(name) for name in names]
    off = np.array([[np.sum((effort[:, j] - weight[:, k]) ** 2) for k in index] for j in index])
    for a, first in enumerate(names):
        for b, second in enumerate(names[:a]):
            if off[a, b] + off[b, a] < EXCHANGED * (off[a, a] + off[b, b]):
                yield Contradiction(
                    (second, first), POOR,
                    f"the efforts of {second} and {first} look exchanged",
                    f"the efforts of {second} and {first} look exchanged: each is what the masses "
                    "in the arm's file weigh at the other joint",
                )  # fmt: skip


def missing_weights(weights: Sequence[HeldWeight], arm: Arm) -> Iterator[Contradiction]:
    """Report joints whose efforts lack the masses' weight."""
    none = [each for each in weights if _is_gone(each)]
    if not none:
        return
    if none[0].stated:  # of wrong masses only what is nothing at all is reported
        sure = any(e.believed or abs(e.ratio) < DEVIATIONS * e.error for e in none)
    else:  # plausible ones do not know how a single joint is balanced: most of the weight counts
        sure = 2.0 * _together(none, arm) > _together(weights, arm)
    shown = ", ".join(
        f"{each.joint} ({each.ratio:.2g} of {each.weight:.3g} {_unit(each, arm)})" for each in none
    )
    masses = "the masses in the arm's file weigh" if none[0].stated else "such an arm weighs"
    yield Contradiction(
        tuple(each.joint for each in none),
        POOR if sure else USABLE,
        f"gravity is not in its efforts: {masses} more there",
        f"gravity is not in the efforts of {shown}, RMS, that {masses} there: another unit "
        f"(--effort-unit A, --drive-gains), or does the driver subtract it? {READ_WITHOUT} states "
        "that",
    )


def _together(weights: Sequence[HeldWeight], arm: Arm) -> float:
    """Return the sum of the weights at these joints, N·m; forces at the lever of ``SCALES``."""
    kinds = {joint.name: joint.kind for joint in arm.joints}
    return sum(each.weight * SCALES[kinds[each.joint]] for each in weights)


def _is_gone(each: HeldWeight) -> bool:
    least = GONE * min(each.scale, 1.0)  # nor is it there in another unit
    return abs(each.ratio) + DEVIATIONS * each.error < least


def _of_another_size(weights: Sequence[HeldWeight]) -> Iterator[Contradiction]:
    """Report joints whose efforts are too small or too large for the masses, by what factor."""
    off = [each for each in weights if _is_off(each)]
    while off:
        first = off[0]
        similar = [
            each
            for each in off
            if first.ratio / SAME <= each.ratio <= first.ratio * SAME or each is first
        ]
        off = [each for each in off if each not in similar]
        ratio = float(np.mean([each.ratio for each in similar]))
        error = max(each.error for each in similar)
        names = ", ".join(each.joint for each in similar)
        times = f"{ratio:.2g} times what the masses in the arm's file weigh there (± {error:.1g})"
        cause = (
            f"a wrong unit, or torque constant? Pass --drive-gains or --effort-unit A {_INSTEAD}"
        )
        if ratio < 0.0:
            cause = f"a wrong sign, or another mounting? Set base_rpy in a .yaml {_INSTEAD}"
        yield Contradiction(
            tuple(each.joint for each in similar),
            POOR,
            f"its efforts are {times}",
            f"efforts of {names} are {times}: {cause}",
        )


def _is_off(each: HeldWeight) -> bool:
    """Whether the efforts of a joint are of another size than the masses' weight."""
    wide = DEVIATIONS * each.error
    if not (each.stated and each.believed) or _is_gone(each):
        return False
    much = each.ratio - wide > WEIGHT.most and not each.loaded
    return each.ratio + wide < WEIGHT.least or much


def scale_in_words(weights: Sequence[HeldWeight]) -> str:
    """Return what is known of a model's scale; ``""``: stated masses weigh what was found.

    Errors do not show it: a model of efforts of another scale predicts such efforts as well.
    """
    stated = [each for each in weights if each.stated and each.scale == 1.0]
    if not stated:
        return UNKNOWN_SCALE
    off = [each for each in stated if not 1.0 / SAME <= each.ratio <= SAME]
    shown = ", ".join(f"{each.joint} {each.ratio:.2g}" for each in off)
    return f"weight found, of that of the masses in the arm's file: {shown}; {WEIGH}" if off else ""


def _unit(each: HeldWeight, arm: Arm) -> str:
    joint = arm.joints[arm.joint_names.index(each.joint)]
    return joint.effort_unit if each.scale == 1.0 else EFFORT_UNITS[joint.kind]


def by_weight(parameters: tuple[FittedParameter, ...], arm: Arm) -> list[Note]:
    """Return a warning if the platform's moment clearly has another size or the other sign."""
    index, name = PLATFORM_BETA, BETA_NAMES[PLATFORM_BETA]
    found = next((p for p in parameters if p.name.startswith("beta") and name in p.name), None)
    fault = "" if found is None else platform_fault(arm.name, found.value, *found.ci95)
    if found is None or not fault:
        return []
    beta, expected, numbers = f"beta{1 + index}", PLATFORM[arm.name], {"beta6_Nm": found.value}
    if fault == "unit":
        text = (
            f"{beta} is {found.value:+.2g} N·m, about {expected:+.2g} on any {arm.name}: efforts "
            "in another unit than N·m?"
        )
        return [Note("effort_unit", None, numbers, text)]
    text = (
        f"looks like a recording of {OTHER_SIDE[arm.name]}, not {arm.name}: {beta} is "
        f"{found.value:+.2f} N·m, about {expected:+.2f} on {arm.name}"
    )
    return [Note(OTHER_ARM, None, numbers, text)]
