"""Does a model hold what the arm's masses weigh? A reading's wrong scale shows in nothing else.

A model that is fitted to efforts in another unit, of a wrong torque constant, or without gravity,
predicts such efforts well, held out or not. Only masses that are known otherwise tell.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import ANY_UNIT, EFFORT_UNITS, PLANTS, SCALES, Arm, plausible_plant
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State, last_link, weight_directions
from dvrk_gravity.effects.base import rigid_body
from dvrk_gravity.files import yaml_file
from dvrk_gravity.files.resources import config_path
from dvrk_gravity.identification.holding import HoldingSettings
from dvrk_gravity.identification.result import Contradiction, Holding
from dvrk_gravity.model import ARM_PARAMETER, VERDICTS, WEIGHT, TorqueModel, stated_weight
from dvrk_gravity.parameters import flatten

_, USABLE, POOR = VERDICTS
_INSTEAD = "says so, --effort-unit N·m (effort_unit in the arm's file) that its masses are wrong"
READ_WITHOUT = "effort_has_gravity: {read: false} in the arm's file"


@dataclass(frozen=True)
class HeldWeightSettings:
    """When a model and the arm's masses contradict each other.

    Attributes:
        poses: Recorded poses that are looked at. Chosen: ratios are then known to 3 %.
        seen: Part of a joint's effort limit, or of the heaviest joint's weight, from which on its
            weight counts. Chosen: of a UR10e's wrists .035 and .002 of the limit; the second is of
            centres of mass that are known to a millimetre, and a load is thirty times as much.
        deviations: Standard errors by which a ratio is beyond a bound. Chosen.
        gone: Less than this part of the weight is none. Chosen: a driver's own masses, by which it
            takes gravity out, are right to some per cent; and a real PSM, whose pitch is balanced
            otherwise than the shipped plant's, holds .2 to .4 of what that weighs, joints of an
            MTMR .2 to 1.6 (test/test_weights.py).
        alike: Factor within which ratios of several joints are one. Chosen.
        exchanged: Part of what efforts are off their own joints' weights that they are off each
            other's, squared, where two are exchanged. Chosen.
        load: Greatest load, as a part of the arm's mass. Chosen: robots carry less (UR10e .37,
            Panda .17, iiwa .47).
        reach: m, how far from its link's frame its centre may be. Chosen: a long tool.
    """

    poses: int = 500
    seen: float = 0.02
    deviations: float = 2.0
    gone: float = 0.1
    alike: float = 1.25
    exchanged: float = 0.25
    load: float = 0.5
    reach: float = 0.5


@dataclass(frozen=True)
class HeldWeight:
    """What a model holds at rest at one joint, beside what masses weigh there.

    Attributes:
        joint: Name.
        ratio: Of the two, over the recorded poses: of stated masses the projection on their weight,
            of plausible ones only the size.
        error: Its standard error.
        weight: RMS of what the masses weigh, N·m or N.
        stated: Whether the arm's file states them; else they are those of its shipped plant.
        believed: Whether efforts are to be in N·m and the masses right: neither is another unit of
            the efforts stated, nor that they are in N·m whatever the masses say.
        loaded: A load on the last link, within reason, explains it better than a wrong scale.
        scale: How much 1 N·m is in the unit of the efforts, where that was found out by the masses.
    """

    joint: str
    ratio: float
    error: float
    weight: float
    stated: bool
    believed: bool
    loaded: bool = False
    scale: float = 1.0


def held_weights(
    model: TorqueModel,
    q: Array,
    holding: Mapping[str, Holding],
    settings: HeldWeightSettings | None = None,
) -> tuple[HeldWeight, ...]:
    """Return what a model holds beside the arm's masses, of joints where these weigh something.

    Args:
        model: The model.
        q: (N, n) recorded positions, rad or m.
        holding: How certain the torque is that it holds the arm with, by joint.
        settings: Which joints count.
    """
    settings, arm = settings or HeldWeightSettings(), model.arm
    q = q[:: max(1, len(q) // settings.poses)]
    weight, stated = _weight(arm, q)
    if weight is None:
        return ()
    held = _at_rest(model, q)
    size, found = np.sqrt(np.mean(weight**2, axis=0)), np.sqrt(np.mean(held**2, axis=0))
    counts = bears_weight(size, arm, settings)
    scale = arm.effort_size if arm.read_in == ANY_UNIT else 1.0
    known = arm.newtons_said or arm.read_in not in ("", ANY_UNIT)
    loaded = np.zeros(arm.n, dtype=bool)
    if stated and scale == 1.0:  # no load makes four times the weight of all joints
        loaded = _by_load(arm, q, held, weight, settings)
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


def idle(arm: Arm, q: Array, static: bool) -> NDArray[np.bool_]:
    """Return (n,) joints at whose (N, n) positions nothing acts that a prediction could show.

    A joint bears no weight there, and rests or has no friction; or poses did not move it.
    """
    settings = HeldWeightSettings()
    q = q[:: max(1, len(q) // settings.poses)]
    weight, _ = _weight(arm, q)
    if weight is None:  # of whatever links of such sizes may weigh
        each = rigid_body.weight_regressor(arm, q, arm.gravity) @ weight_directions(arm)
        weight = np.sqrt((each**2).sum(axis=2))
    light = ~bears_weight(np.sqrt(np.mean(weight**2, axis=0)), arm, settings)
    if not static:
        return np.asarray(light & ~arm.rubs)
    return np.asarray(light | (np.ptp(q, axis=0) < HoldingSettings().narrow * arm.scale))


def bears_weight(size: Array, arm: Arm, settings: HeldWeightSettings) -> NDArray[np.bool_]:
    """Return (n,) joints at which a weight of some (n,) RMS size counts."""
    limit = np.where(arm.effort_limit > 0.0, arm.effort_limit, np.inf)
    return np.asarray(size > settings.seen * np.minimum(limit, size.max()))


def _weight(arm: Arm, q: Array) -> tuple[Array | None, bool]:
    """Return (N, n) efforts that hold an arm's masses, and whether its own file states these."""
    stated = stated_weight(arm, q)
    return (_plausible_weight(arm, q), False) if stated is None else (stated, True)


def _at_rest(model: TorqueModel, q: Array) -> Array:
    """Return (N, n) torques that a compensator holds an arm still with, N·m or N."""
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


def _by_load(
    arm: Arm, q: Array, held: Array, weight: Array, settings: HeldWeightSettings
) -> NDArray[np.bool_]:
    """Return (n,) where a load on the last link explains what is held better than a wrong scale."""
    from scipy.optimize import lsq_linear  # slow to load

    assert arm.inertial_parameters is not None
    first = rigid_body.OF_WEIGHT * arm.body_names.index(last_link(arm))
    columns = rigid_body.weight_regressor(arm, q, arm.gravity)
    columns = columns[:, :, first : first + rigid_body.OF_WEIGHT]
    most = settings.load * float(arm.inertial_parameters[:, 0].sum())
    bound = most * np.array([1.0, *[settings.reach] * 3])
    error = held - weight
    size = np.sqrt(np.mean(weight**2, axis=0))
    unit = np.maximum(size, settings.seen * size.max(initial=0.0))
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
    """Return what the arm's masses say against a model, worst first.

    Args:
        model: The model.
        q: (N, n) recorded positions, rad or m.
        effort: (N, n) measured efforts in joint space: they show which joints' are exchanged.
        holding: How certain the torque is that it holds the arm with, by joint.
    """
    settings, arm = HeldWeightSettings(), model.arm
    weights = held_weights(model, q, holding, settings)
    exchanged = [*_exchanged(weights, arm, q, effort, settings)]
    named = {joint for each in exchanged for joint in each.joints}
    others = [each for each in weights if each.joint not in named]
    found = [
        *exchanged,
        *missing_weights(others, arm, settings),
        *_of_another_size(others, settings),
        *_unmeasured(weights, arm),
    ]
    return tuple(sorted(found, key=lambda each: -VERDICTS.index(each.level)))


def _unmeasured(weights: Sequence[HeldWeight], arm: Arm) -> Iterator[Contradiction]:
    """Say that gravity is not measured."""
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
    weights: Sequence[HeldWeight], arm: Arm, q: Array, effort: Array, settings: HeldWeightSettings
) -> Iterator[Contradiction]:
    """Say which joints' efforts are each other's weights, and not their own."""
    weight = stated_weight(arm, q)
    names = [each.joint for each in weights if each.believed]
    if weight is None:
        return
    index = [arm.joint_names.index(name) for name in names]
    off = np.array([[np.sum((effort[:, j] - weight[:, k]) ** 2) for k in index] for j in index])
    for a, first in enumerate(names):
        for b, second in enumerate(names[:a]):
            if off[a, b] + off[b, a] < settings.exchanged * (off[a, a] + off[b, b]):
                yield Contradiction(
                    (second, first), POOR,
                    f"the efforts of {second} and {first} look exchanged",
                    f"the efforts of {second} and {first} look exchanged: each is what the masses "
                    "in the arm's file weigh at the other joint",
                )  # fmt: skip


def missing_weights(
    weights: Sequence[HeldWeight], arm: Arm, settings: HeldWeightSettings
) -> Iterator[Contradiction]:
    """Say where the masses' weight is not in the efforts."""
    none = [each for each in weights if _is_gone(each, settings)]
    if not none:
        return
    if none[0].stated:  # of wrong masses only what is nothing at all is reported
        sure = any(e.believed or abs(e.ratio) < settings.deviations * e.error for e in none)
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
        f"gravity is not in the efforts of {shown}, RMS, that {masses} there: another unit, or "
        f"does the driver take it out? {READ_WITHOUT} says so",
    )


def _together(weights: Sequence[HeldWeight], arm: Arm) -> float:
    """Return what masses weigh at all of these joints, N·m; forces at the lever of ``SCALES``."""
    kinds = {joint.name: joint.kind for joint in arm.joints}
    return sum(each.weight * SCALES[kinds[each.joint]] for each in weights)


def _is_gone(each: HeldWeight, settings: HeldWeightSettings) -> bool:
    least = settings.gone * min(each.scale, 1.0)  # nor is it there in another unit
    return abs(each.ratio) + settings.deviations * each.error < least


def _of_another_size(
    weights: Sequence[HeldWeight], settings: HeldWeightSettings
) -> Iterator[Contradiction]:
    """Say where efforts are too small or too large for the masses, by what factor."""
    off = [each for each in weights if _is_off(each, settings)]
    while off:
        first = off[0]
        alike = [
            each
            for each in off
            if first.ratio / settings.alike <= each.ratio <= first.ratio * settings.alike
            or each is first
        ]
        off = [each for each in off if each not in alike]
        ratio = float(np.mean([each.ratio for each in alike]))
        error = max(each.error for each in alike)
        names = ", ".join(each.joint for each in alike)
        times = f"{ratio:.2g} times what the masses in the arm's file weigh there (± {error:.1g})"
        cause = f"a wrong unit, or torque constant? --drive-gains or --effort-unit A {_INSTEAD}"
        if ratio < 0.0:
            cause = f"a wrong sign, or another way of mounting? base_rpy in a .yaml {_INSTEAD}"
        yield Contradiction(
            tuple(each.joint for each in alike),
            POOR,
            f"its efforts are {times}",
            f"efforts of {names} are {times}: {cause}",
        )


def _is_off(each: HeldWeight, settings: HeldWeightSettings) -> bool:
    """Tell whether the efforts of a joint are of another size than the masses' weight."""
    wide = settings.deviations * each.error
    if not (each.stated and each.believed) or _is_gone(each, settings):
        return False
    much = each.ratio - wide > WEIGHT.most and not each.loaded
    return each.ratio + wide < WEIGHT.least or much


def _unit(each: HeldWeight, arm: Arm) -> str:
    joint = arm.joints[arm.joint_names.index(each.joint)]
    return joint.effort_unit if each.scale == 1.0 else EFFORT_UNITS[joint.kind]
