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


class StartRefusedError(DvrkGravityError):
    """The arm must not be commanded under these conditions."""


class Start:
    """Collects samples of an arm that holds itself, and returns the first command.

    Attributes:
        begin: Monotonic time of the first sample, s.
    """

    def __init__(self, now: float, arm: Arm) -> None:
        self.begin = now
        self._rest = REST_SPEED * DURATION * arm.scale
        self._efforts: list[Array] = []
        self._models: list[Array] = []
        self._at: Array | None = None

    def add(self, sample: Sample, torque: Array, now: float) -> None:
        """Add a sample and the model's (n,) torque at it, N·m; an arm that moves begins again."""
        if self._at is None:
            self._at = sample.position
        elif (np.abs(sample.position - self._at) > self._rest).any():
            self.begin, self._efforts, self._models = now, [], []
            self._at = sample.position
        if sample.effort is not None:
            self._efforts.append(sample.effort)
        self._models.append(torque)

    def complete(self, now: float) -> bool:
        """Return whether there is enough to begin with."""
        return now - self.begin >= DURATION and len(self._models) >= LEAST_SAMPLES

    def has_efforts(self) -> bool:
        """Return whether half of the samples have efforts that are not all exactly zero."""
        enough = len(self._efforts) >= USABLE * len(self._models)
        return enough and bool(np.any(self._efforts))

    @property
    def _position(self) -> Array:
        assert self._at is not None  # there is a sample
        return self._at

    def _mean(self, settings: Settings) -> Array:
        """Return the (n,) mean of what holds the arm, with the weight that it does not read."""
        return np.asarray(np.mean(self._efforts, axis=0) + _unread_weight(settings, self._position))

    def origin(self, settings: Settings, tolerance: float) -> tuple[Array, str]:
        """Return the (n,) first effort, N·m, and its source in words.

        It is the model's torque plus the difference to the mean measured effort, up to what dry
        friction can hold: more than that is a wrong reading or a wrong model, and with a right
        model would throw the joint. Where gravity is left out on purpose, it is the whole measured
        effort. An arm that does not measure its efforts (none in half of the samples, or all of
        them exactly zero) begins with the model's torque.

        Raises:
            StartRefusedError: The arm is where this one cannot be, measured and modelled efforts
                differ by more than ``tolerance``, a part of the effort limits, the model holds next
                to nothing of the weight, or another weight than the masses in the arm's file have,
                or the limits cut the holding effort.
        """
        model = np.mean(self._models, axis=0)
        arm, position = settings.model.arm, self._position
        require_within(arm, position)
        weight = settings.weight(position)
        if not settings.weightless:
            _compare_with_masses(settings, position)
        if not self.has_efforts():
            origin, source = model, "the model's torque: measured_js has no usable effort"
        elif settings.weightless and not arm.gravity_in_command:
            origin, source = model, "the model's torque: the arm holds its own weight"
        else:
            mean = self._mean(settings)
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
            raise StartRefusedError(
                f"{joint.name} takes {origin[worst]:.4g} {joint.effort_unit} to hold, beyond its "
                "effort limits: it would fall"
            )
        return settings.limits.clip(origin), source

    def confirmed_origin(
        self, settings: Settings, before: Settings, tolerance: float, measurable: bool
    ) -> tuple[Array, str]:
        """Return :meth:`origin` where the measured efforts support changed parameters.

        Nobody has asked for this start: the arm was held for some reason, perhaps for the change
        since the last start accepted ``before``; ``measurable``: it acts on an arm at rest.

        Raises:
            StartRefusedError: As :meth:`origin`, or no measurement supports the change.
        """
        why = ""
        if settings.weightless:  # a wish with a flag of its own, which no measurement can support
            return self.origin(settings, tolerance)
        if not measurable:
            why = "no measurement at rest supports them"
        elif not self.has_efforts():
            why = "measured_js has no usable effort to compare them with"
        else:
            limit, mean = settings.model.arm.effort_limit, self._mean(settings)
            was, now = (
                np.linalg.norm((mean - each.holding_effort(self._position)) / limit)
                for each in (before, settings)
            )
            if now > was:
                why = "the measured effort agrees better with those of the last start"
        if why:
            raise StartRefusedError(f"parameters have changed, and {why}: ~/enable accepts them")
        return self.origin(settings, tolerance)


def require_within(arm: Arm, position: Array) -> None:
    """Refuse to command an arm at (n,) positions that this arm cannot reach, rad or m.

    Raises:
        StartRefusedError: Further than 20 deg (35 mm) outside the arm's limits.
    """
    beyond = np.maximum(arm.lower - position, position - arm.upper)
    worst = int(np.argmax(beyond / arm.scale))
    if not beyond[worst] <= OUTSIDE * arm.scale[worst]:
        joint = arm.joints[worst]
        raise StartRefusedError(
            f"{joint.name} is at {joint.shown(position[worst])}, {joint.shown(beyond[worst])} "
            f"outside the limits of {arm.name}: the arm of the other side?"
        )


def _unread_weight(settings: Settings, position: Array) -> Array:
    """Return the (n,) holding efforts that the arm's readings leave out, N·m.

    Raises:
        StartRefusedError: They leave out its weight, which nothing states.
    """
    arm = settings.model.arm
    if arm.gravity_in_reading:
        return np.zeros(arm.n)
    stated = stated_weight(arm, position)
    if stated is None and settings.weightless:
        raise StartRefusedError(
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
            raise StartRefusedError(
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
    raise StartRefusedError(
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
        raise StartRefusedError(
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
        raise StartRefusedError(
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


class AcceptedParameters:
    """The parameters of the last accepted start, beside those in force.

    Parameters that change after a start are compared with those it accepted, at the arm's present
    position.

    Attributes:
        settings: Those that the last start accepted.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings

    def _tolerance(self, settings: Settings) -> float:
        # A tolerance that is raised waits for a person, as all else does.
        return min(self.settings.start_tolerance, settings.start_tolerance)

    def origin(
        self, start: Start, settings: Settings, position: Array, asked: bool
    ) -> tuple[Array, str]:
        """Return :meth:`Start.origin`; of settings not yet accepted :meth:`Start.confirmed_origin`.

        ``asked``: a person has asked for this start, with the present parameters. ``position`` is
        (n,), rad or m.

        Raises:
            StartRefusedError: As these.
        """
        unconfirmed = None if asked else self.deviation(settings, position)
        if unconfirmed is None:
            return start.origin(settings, settings.start_tolerance)
        return start.confirmed_origin(
            settings, self.settings, self._tolerance(settings), unconfirmed.measurable
        )

    @np.errstate(over="ignore", invalid="ignore")
    def deviation(self, settings: Settings, position: Array) -> Deviation | None:
        """Return torque of settings at (n,) positions beyond what was accepted, ``None``: none.

        Compared are the torque at rest, and the friction that is compensated at a speed at which
        it is whole.
        """
        before = self.settings
        if settings.commands_like(before):
            return None
        tolerance = self._tolerance(settings)
        worst, held, asked = self._furthest(
            before.static_torque(position), settings.static_torque(position)
        )
        joint = settings.model.arm.joints[worst]
        if not abs(asked - held) <= tolerance * joint.effort_limit:
            return Deviation(
                f"changed parameters command {asked:.3g} {joint.effort_unit} at {joint.name}, "
                f"those of the last start {held:.3g}: more than start_tolerance apart",
                measurable=True,
            )
        left_out = settings.clipped_share(position)
        worst = int(np.argmax(left_out))
        # As at a start; where the limits of before leave out as much, nothing has changed.
        if left_out[worst] > max(CONSIDERABLE, before.clipped_share(position)[worst]):
            joint = settings.model.arm.joints[worst]
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
            old, new = (way * each.parts(position, speed)[1] for each in (before, settings))
            # Less of it leaves the arm with more friction, which moves nothing.
            worst, less, more = self._furthest(old, np.maximum(new, old))
            joint = settings.model.arm.joints[worst]
            if not more - less <= tolerance * joint.effort_limit:
                return Deviation(
                    f"changed parameters compensate {more:.3g} {joint.effort_unit} of friction at "
                    f"{joint.name}, those of the last start {less:.3g}: more than start_tolerance "
                    "apart, and friction cannot be measured at rest",
                    measurable=False,
                )
        return None

    def change(self, settings: Settings, position: Array) -> str:
        """Return in words how settings change the support of the arm at (n,) positions."""
        before, after = self.settings.static_torque(position), settings.static_torque(position)
        worst, old, new = self._furthest(before, after)
        joint = settings.model.arm.joints[worst]
        if not abs(new - old) > CONSIDERABLE * joint.effort_limit:
            return ""
        return (
            f"parameters have changed: {joint.name} is held with {new:.3g} {joint.effort_unit} "
            f"instead of {old:.3g}"
        )

    def _furthest(self, old: Array, new: Array) -> tuple[int, float, float]:
        """Return the joint at which (n,) torques differ most, by their limits, and both there."""
        worst = int(np.argmax(np.abs(new - old) / self.settings.model.arm.effort_limit))
        return worst, float(old[worst]), float(new[worst])
