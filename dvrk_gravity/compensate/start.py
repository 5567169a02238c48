"""What a start begins with, and what it accepts.

Before the first command the effort that holds the arm is measured and compared with the model's.
Parameters that change afterwards are compared with those that this start accepted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dvrk_gravity.arms import ANY_UNIT, EFFORT_UNITS, Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate.limits import CONSIDERABLE
from dvrk_gravity.compensate.sample import Sample
from dvrk_gravity.compensate.settings import Settings
from dvrk_gravity.effects import stated_weight
from dvrk_gravity.errors import DvrkGravityError
from dvrk_gravity.model import WEIGHT

# Efforts are averaged over at least so long, s, and so many samples: their mean has less than a
# third of one's noise.
DURATION, LEAST_SAMPLES = 0.1, 10
# Speeds, rad/s (Arm.scale). Faster than this the arm is not at rest: the drift that the dVRK
# console's own test of its compensation allows.
REST_SPEED = 0.2
# At this one dry friction is whole: above all saturation velocities of real files.
DRY_SPEED = 0.3
# Part of the samples that need to have an effort for it to count. Chosen.
USABLE = 0.5
# Part of the effort limits, over all joints, above which the effort bears weight, and not friction
# alone: dry friction of a real MTM's joints is 0.01 to 0.09 of them.
FELT = 0.1
# Part of that weight that the model must hold: less is another unit, and lets the arm fall. Chosen:
# of MTMR-28002's 6250 static poses all but two, near balance, have more.
LEAST_PART = 0.1
# Poses drawn within the arm's range for the usual load of its joints: to 5 %.
POSES = 200
# Part of that usual load, over all joints, above which the weight here is compared with the stated
# masses'. Chosen: nearer to balance, centres of mass that are off by a tenth of a link's length
# matter as much.
LEAST_WEIGHT = 0.3
# Part of an effort limit that moves no joint (verdict.VerdictSettings).
NEGLIGIBLE = 0.01
# Further outside the arm's limits, rad, 20 deg (Arm.scale), it is another arm: zeros are off by
# less, and a right master's stops differ from a left one's by 110 deg.
OUTSIDE = 0.35


class CommandRefusedError(DvrkGravityError):
    """The arm must not be commanded, or not any more."""


class Start:
    """Collects samples of an arm that holds itself, and returns the first command."""

    def __init__(self, settings: Settings, now: float) -> None:
        """Begin at monotonic time ``now``, s, with the parameters to start with."""
        self._settings, self._begin = settings, now
        self._rest = REST_SPEED * DURATION * settings.model.arm.scale
        self._efforts: list[Array] = []
        self._models: list[Array] = []
        self._at: Array | None = None

    def add(self, sample: Sample, now: float) -> None:
        """Add a sample; an arm that moves begins again.

        Raises:
            ArithmeticError: The model's torque at it is not finite.
        """
        torque = self._settings.finite(self._settings.torque(sample.position, None))
        if self._at is None:
            self._at = sample.position
        elif (np.abs(sample.position - self._at) > self._rest).any():
            self._begin, self._efforts, self._models = now, [], []
            self._at = sample.position
        if sample.effort is not None:
            self._efforts.append(sample.effort)
        self._models.append(torque)

    def complete(self, now: float) -> bool:
        """Return whether there is enough to begin with."""
        return now - self._begin >= DURATION and len(self._models) >= LEAST_SAMPLES

    def has_efforts(self) -> bool:
        """Return whether half of the samples have efforts that are not all exactly zero."""
        enough = len(self._efforts) >= USABLE * len(self._models)
        return enough and bool(np.any(self._efforts))

    @property
    def _position(self) -> Array:
        assert self._at is not None  # there is a sample
        return self._at

    def _mean(self) -> Array:
        """Return the (n,) mean of what holds the arm, with the weight that it does not read."""
        unread = _unread_weight(self._settings, self._position)
        return np.asarray(np.mean(self._efforts, axis=0) + unread)

    def origin(self, accepted: Settings | None) -> tuple[Array, str]:
        """Return the (n,) first effort, N·m, and its source in words.

        It is the model's torque plus the difference to the mean measured effort, up to what dry
        friction can hold: more than that is a wrong reading or a wrong model, and with a right
        model would throw the joint. Where gravity is left out on purpose, it is the whole measured
        effort. An arm that does not measure its efforts (none in half of the samples, or all of
        them exactly zero) begins with the model's torque.

        Where nobody has asked for this start (the arm was held for some reason, perhaps for changed
        parameters), ``accepted`` are the parameters of the last one: the measured effort has to
        support what has changed since. ``None``: a person has asked for it.

        Raises:
            CommandRefusedError: The arm is where this one cannot be, measured and modelled efforts
                differ by more than ``start_tolerance``, the model holds next to nothing of the
                weight, or another weight than the masses in the arm's file have, the limits cut the
                holding effort, or no measurement supports a change.
        """
        settings, position = self._settings, self._position
        tolerance = settings.start_tolerance
        changed = None if accepted is None else deviation(accepted, settings, position)
        if accepted is not None and changed is not None:
            tolerance = _tolerance(accepted, settings)
            if not settings.weightless:  # a wish with a flag of its own: no measurement supports it
                self._require_support(accepted, changed.measurable)
        model = np.mean(self._models, axis=0)
        arm = settings.model.arm
        require_within(arm, position)
        weight = settings.weight(position)
        if not settings.weightless:
            _compare_with_masses(settings, position)
        if not self.has_efforts():
            origin, source = model, "the model's torque: measured_js has no usable effort"
        elif settings.weightless and not arm.gravity_in_command:
            origin, source = model, "the model's torque: the arm holds its own weight"
        else:
            mean = self._mean()
            whole = model if arm.gravity_in_command else model + weight
            difference = mean - whole
            if not settings.weightless:
                _compare(mean, whole, settings, tolerance)
                held = _dry_friction(settings, position)
                difference = np.minimum(np.maximum(difference, -held), held)
            origin, source = model + difference, "the measured effort"
        cut = np.abs(settings.limits.clip(origin) - origin) / arm.effort_limit
        worst = int(np.argmax(cut))
        if not cut[worst] <= CONSIDERABLE:
            joint = arm.joints[worst]
            raise CommandRefusedError(
                f"{joint.name} takes {origin[worst]:.4g} {joint.effort_unit} to hold, beyond its "
                "effort limits: it would fall"
            )
        return settings.limits.clip(origin), source

    def _require_support(self, accepted: Settings, measurable: bool) -> None:
        """Refuse changed parameters that hold the arm less well than those accepted before.

        ``measurable``: the change acts on an arm at rest.
        """
        why = ""
        if not measurable:
            why = "no measurement at rest supports them"
        elif not self.has_efforts():
            why = "measured_js has no usable effort to compare them with"
        else:
            limit, mean = accepted.model.arm.effort_limit, self._mean()
            was, now = (
                np.linalg.norm((mean - each.holding_effort(self._position)) / limit)
                for each in (accepted, self._settings)
            )
            if now > was:
                why = "the measured effort agrees better with those of the last start"
        if why:
            raise CommandRefusedError(f"parameters have changed, and {why}: ~/enable accepts them")


def require_within(arm: Arm, position: Array) -> None:
    """Refuse to command an arm at (n,) positions that this arm cannot reach, rad or m.

    Raises:
        CommandRefusedError: Further than 20 deg (35 mm) outside the arm's limits.
    """
    beyond = np.maximum(arm.lower - position, position - arm.upper)
    worst = int(np.argmax(beyond / arm.scale))
    if not beyond[worst] <= OUTSIDE * arm.scale[worst]:
        joint = arm.joints[worst]
        raise CommandRefusedError(
            f"{joint.name} is at {joint.shown(position[worst])}, {joint.shown(beyond[worst])} "
            f"outside the limits of {arm.name}: the arm of the other side?"
        )


def _unread_weight(settings: Settings, position: Array) -> Array:
    """Return the (n,) holding efforts that the arm's readings leave out, N·m.

    Raises:
        CommandRefusedError: They leave out its weight, which nothing states.
    """
    arm = settings.model.arm
    if arm.gravity_in_reading:
        return np.zeros(arm.n)
    stated = stated_weight(arm, position)
    if stated is None and settings.weightless:
        raise CommandRefusedError(
            "efforts are read without gravity (effort_has_gravity), and neither the model nor the "
            "arm's file states the arm's weight: it would fall"
        )
    return settings.weight(position) if stated is None else stated


def _compare_with_masses(settings: Settings, position: Array) -> None:
    """Refuse a model that holds another weight than the masses in the arm's file have.

    Measured efforts do not show it: they may be read as wrongly as the model's recordings were.
    """
    arm = settings.model.arm
    weight = None if arm.newtons_stated else stated_weight(arm, position)
    if weight is None:
        return
    unit = 1.0 / arm.effort_size if arm.read_in == ANY_UNIT else 1.0  # the unit was never stated
    weight = unit * weight
    poses = np.random.default_rng(0).uniform(*arm.range, (POSES, arm.n))
    drawn = stated_weight(arm, poses)
    assert drawn is not None
    drawn = unit * drawn
    usual = np.sqrt(np.mean(drawn**2, axis=0))
    hint = (
        "were efforts in another unit when it was identified, or is it another arm's? effort_unit: "
        "N·m in the model's file overrides those masses"
    )
    size = float(np.sum((arm.scale * weight) ** 2))
    if size < (LEAST_WEIGHT * np.linalg.norm(arm.scale * usual)) ** 2:
        # Near balance an arm shows neither weight; where it is moved to from there does.
        ratio = float(
            np.sum(arm.scale**2 * settings.weight(poses) * drawn) / np.sum((arm.scale * drawn) ** 2)
        )
        if not WEIGHT.least <= ratio <= WEIGHT.most_loaded:
            raise CommandRefusedError(
                f"over the arm's range the model's weight is {ratio:.2g} times that of the masses "
                f"in its file: {hint}"
            )
        return
    held = settings.own_holding_effort(position)
    ratio = float(arm.scale * held @ (arm.scale * weight)) / size
    worst = int(np.argmax(np.abs(arm.scale * weight)))
    if WEIGHT.least <= ratio <= WEIGHT.most_loaded:
        # A joint alone: where it bears its usual load, or more.
        bears = np.abs(weight) > np.maximum(usual, NEGLIGIBLE * arm.effort_limit)
        part = np.divide(held, weight, where=bears, out=np.ones(arm.n))
        worst = int(np.argmin(part))
        ratio = float(part[worst])
        if ratio >= WEIGHT.least:
            return
    joint = arm.joints[worst]
    raise CommandRefusedError(
        f"the model holds {ratio:.2g} times what the masses in the arm's file weigh here "
        f"({joint.name}: {held[worst]:.3g} of {weight[worst]:.3g} {EFFORT_UNITS[joint.kind]}): "
        f"{hint}"
    )


def _compare(mean: Array, model: Array, settings: Settings, tolerance: float) -> None:
    """Refuse to start where (n,) measured and modelled efforts are too far apart."""
    arm = settings.model.arm
    limit = arm.effort_limit
    hint = "a wrong unit, another arm's model, or an arm that leans on something?"
    excess = np.abs(mean - model) / limit
    worst = int(np.argmax(excess))
    if not excess[worst] <= tolerance:
        joint = arm.joints[worst]
        raise CommandRefusedError(
            f"{joint.name} is held with {mean[worst]:.4g} {joint.effort_unit} as measured, "
            f"{model[worst]:.4g} by the model, more than {tolerance:g} of its effort_limit apart "
            f"(start_tolerance): {hint}"
        )
    held, by_model = mean / limit, model / limit
    size = float(held @ held)
    part = float(held @ by_model) / size if size > 0.0 else 1.0
    if size > FELT**2 and part < LEAST_PART:
        worst = int(np.argmax(np.abs(held)))
        joint = arm.joints[worst]
        raise CommandRefusedError(
            f"the model holds {100 * part:.1f} % of what the arm is held with as measured "
            f"({joint.name}: {model[worst]:.3g} of {mean[worst]:.3g} {joint.effort_unit}): {hint}"
        )


def _dry_friction(settings: Settings, position: Array) -> Array:
    """Return the (n,) dry friction that is compensated, at rest the same both ways, N·m."""
    speed = DRY_SPEED * settings.model.arm.scale
    up, down = (settings.parts(position, way)[1] for way in (speed, -speed))
    return np.maximum(np.minimum(up, -down), 0.0)


class Deviation(NamedTuple):
    """Torque that no start has compared with what holds the arm.

    Attributes:
        reason: Which, in words for a person.
        measurable: A new start can compare it: it acts on an arm at rest.
    """

    reason: str
    measurable: bool


def deviation(accepted: Settings, settings: Settings, position: Array) -> Deviation | None:
    """Return torque of settings at (n,) positions beyond what was accepted, ``None``: none.

    Compared with the parameters that the last start accepted are the torque at rest, and the
    friction that is compensated at a speed at which it is whole.
    """
    if settings.commands_like(accepted):
        return None
    tolerance = _tolerance(accepted, settings)
    joints = settings.model.arm.joints
    worst, held, asked = _furthest(accepted, settings, position)
    joint = joints[worst]
    if not abs(asked - held) <= tolerance * joint.effort_limit:
        return Deviation(
            f"changed parameters command {asked:.3g} {joint.effort_unit} at {joint.name}, "
            f"those of the last start {held:.3g}: more than start_tolerance apart",
            measurable=True,
        )
    left_out = settings.clipped_share(position)
    worst = int(np.argmax(left_out))
    # As at a start; where the accepted limits leave out as much, nothing has changed.
    if left_out[worst] > max(CONSIDERABLE, accepted.clipped_share(position)[worst]):
        joint = joints[worst]
        held, wanted = (
            settings.static_torque(position)[worst],
            settings.torque(position, None)[worst],
        )
        return Deviation(
            f"changed effort limits leave {held:.3g} of the {wanted:.3g} {joint.effort_unit} "
            f"that hold {joint.name}: it would fall",
            measurable=True,
        )
    for way in (1.0, -1.0):
        speed = way * DRY_SPEED * settings.model.arm.scale
        old, new = (way * each.parts(position, speed)[1] for each in (accepted, settings))
        # Less of it leaves the arm with more friction, which moves nothing.
        more = np.maximum(new - old, 0.0)
        worst = int(np.argmax(more / settings.model.arm.effort_limit))
        joint = joints[worst]
        if not more[worst] <= tolerance * joint.effort_limit:
            return Deviation(
                f"changed parameters compensate {new[worst]:.3g} {joint.effort_unit} of friction "
                f"at {joint.name}, those of the last start {old[worst]:.3g}: more than "
                "start_tolerance apart, and friction cannot be measured at rest",
                measurable=False,
            )
    return None


def changed_support(accepted: Settings, settings: Settings, position: Array) -> str:
    """Return in words how settings change the support of the arm at (n,) positions."""
    worst, old, new = _furthest(accepted, settings, position)
    joint = settings.model.arm.joints[worst]
    if not abs(new - old) > CONSIDERABLE * joint.effort_limit:
        return ""
    return (
        f"parameters have changed: {joint.name} is held with {new:.3g} {joint.effort_unit} "
        f"instead of {old:.3g}"
    )


def _tolerance(accepted: Settings, settings: Settings) -> float:
    """Return the lesser one: a tolerance that is raised waits for a person, as all else does."""
    return min(accepted.start_tolerance, settings.start_tolerance)


def _furthest(accepted: Settings, settings: Settings, position: Array) -> tuple[int, float, float]:
    """Return the joint at which two static torques differ most, by the limits, and both there."""
    old, new = accepted.static_torque(position), settings.static_torque(position)
    worst = int(np.argmax(np.abs(new - old) / accepted.model.arm.effort_limit))
    return worst, float(old[worst]), float(new[worst])
