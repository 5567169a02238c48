"""What to begin with: the effort that holds the arm, measured before the first command."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dvrk_gravity.arms import ANY_UNIT, EFFORT_UNITS, Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.compensate.sample import Sample
from dvrk_gravity.compensate.settings import CHANGE, Settings
from dvrk_gravity.errors import DvrkGravityError
from dvrk_gravity.model import WEIGHT, stated_weight


@dataclass(frozen=True)
class StartSettings:
    """What is measured before the first command; speeds are rad/s (``Arm.scale``).

    Attributes:
        duration: Efforts are averaged over at least so long, s…
        least_samples: … and so many samples: their mean has less than a third of one's noise.
        rest: Faster than this the arm is not at rest: the drift that the dVRK console's own test
            of its compensation allows.
        dry: At this speed dry friction is whole: above all saturation velocities of real files.
        usable: Part of the samples that need to have an effort for it to count. Chosen.
        felt: Part of the effort limits, over all joints, from which on it is weight that is held,
            and not friction alone: dry friction of a real MTM's joints is 0.01 to 0.09 of them.
        least_part: Part of that weight that the model must hold: less is another unit, and lets the
            arm fall. Chosen: of MTMR-28002's 6250 static poses all but two, near balance, have
            more.
        poses: Drawn within the arm's range to know what its joints usually bear: to 5 %.
        least_weight: Part of what the arm usually bears, over all joints, from which on its weight
            here is compared with its masses'. Chosen: nearer to balance, centres of mass that are
            off by a tenth of a link's length matter as much.
        negligible: Part of an effort limit that moves no joint (``verdict.VerdictSettings``).
        outside: Further outside the arm's limits, rad, 20 deg (``Arm.scale``), it is another arm:
            what a zero is off by is less, and a right master's stops differ from a left one's by
            110 deg.
    """

    duration: float = 0.1
    least_samples: int = 10
    rest: float = 0.2
    dry: float = 0.3
    usable: float = 0.5
    felt: float = 0.1
    least_part: float = 0.1
    poses: int = 200
    least_weight: float = 0.3
    negligible: float = 0.01
    outside: float = 0.35


SETTINGS = StartSettings()


class StartRefusedError(DvrkGravityError):
    """The arm must not be commanded as things are."""


class Start:
    """Collects samples of an arm that holds itself, and tells what the first command is.

    Attributes:
        begin: Monotonic time of the first sample, s.
    """

    def __init__(self, now: float, arm: Arm) -> None:
        """Begin to collect samples of an arm."""
        self.begin = now
        self._rest = SETTINGS.rest * SETTINGS.duration * arm.scale
        self._efforts: list[Array] = []
        self._models: list[Array] = []
        self._position: Array | None = None

    def add(self, sample: Sample, torque: Array, now: float) -> None:
        """Take a sample and the model's (n,) torque at it, N·m; an arm that moves begins anew."""
        if self._position is None:
            self._position = sample.position
        elif (np.abs(sample.position - self._position) > self._rest).any():
            self.begin, self._efforts, self._models = now, [], []
            self._position = sample.position
        if sample.effort is not None:
            self._efforts.append(sample.effort)
        self._models.append(torque)

    def complete(self, now: float) -> bool:
        """Tell whether there is enough to begin with."""
        return now - self.begin >= SETTINGS.duration and (
            len(self._models) >= SETTINGS.least_samples
        )

    def origin(self, settings: Settings, tolerance: float) -> tuple[Array, str]:
        """Return the (n,) first effort, N·m, and in words where it is from.

        The model's torque, and of the difference to the mean effort that was measured no more than
        dry friction can hold: what is beyond is a wrong reading or a wrong model, and with a right
        model the joint would be thrown. Where gravity is left out on purpose, all of the measured
        effort. An arm that does not measure its efforts (none in half of the samples, or all of
        them exactly zero) begins with the model's torque.

        Args:
            settings: What is to be commanded.
            tolerance: Part of the effort limits by which measured and modelled effort may differ.

        Raises:
            StartRefusedError: The arm is where this one cannot be, measured and modelled efforts
                differ by more than ``tolerance``, the model holds next to nothing of
                the weight, another one than the masses in the arm's file have, or the limits cut
                what holds the arm.
        """
        model = np.mean(self._models, axis=0)
        arm, position = settings.model.arm, self._position
        joints = arm.joints
        assert position is not None  # there is a sample
        require_within(arm, position)
        weight = settings.weight(position)
        if not settings.weightless:
            _compare_with_masses(settings, position)
        if not self.measures():
            origin, source = model, "the model's torque, as measured_js has no usable effort"
        elif settings.weightless and not arm.gravity_in_command:
            origin, source = model, "the model's torque, as the arm holds its weight itself"
        else:
            mean = np.mean(self._efforts, axis=0) + _unread(settings, position)
            whole = model if arm.gravity_in_command else model + weight
            difference = mean - whole
            if not settings.weightless:
                _compare(mean, whole, settings, tolerance)
                held = _dry_friction(settings, position)
                difference = np.minimum(np.maximum(difference, -held), held)
            origin, source = model + difference, "the measured effort"
        cut = np.abs(settings.limits.clip(origin) - origin) / arm.effort_limit
        worst = int(np.argmax(cut))
        if not cut[worst] <= CHANGE.considerable:
            raise StartRefusedError(
                f"{joints[worst].name} takes {origin[worst]:.4g} {joints[worst].effort_unit} to "
                "hold, more than its effort limits leave: it would fall"
            )
        return settings.limits.clip(origin), source

    def confirmed(
        self, settings: Settings, before: Settings, tolerance: float, measurable: bool
    ) -> tuple[Array, str]:
        """Return :meth:`origin` where what is measured speaks for parameters that have changed.

        Nobody has asked for this start: the arm was held for some reason, for the change itself
        perhaps.

        Args:
            settings: What is to be commanded.
            before: What the last start accepted.
            tolerance: Part of the effort limits by which measured and modelled effort may differ.
            measurable: What has changed acts on an arm at rest.

        Raises:
            StartRefusedError: As :meth:`origin`, or nothing is measured that speaks for the change.
        """
        why = ""
        if settings.weightless:  # a wish that has a flag of its own; nothing can speak for it
            return self.origin(settings, tolerance)
        if not measurable:
            why = "nothing that is measured at rest speaks for them"
        elif not self.measures():
            why = "measured_js has no usable effort to compare them with"
        else:
            assert self._position is not None  # there is a sample
            limit = settings.model.arm.effort_limit
            mean = np.mean(self._efforts, axis=0) + _unread(settings, self._position)
            was, now = (
                np.linalg.norm((mean - each.holding(self._position)) / limit)
                for each in (before, settings)
            )
            if now > was:
                why = "what is measured agrees better with those of the last start"
        if why:
            raise StartRefusedError(f"parameters have changed, and {why}: ~/enable takes them")
        return self.origin(settings, tolerance)

    def measures(self) -> bool:
        """Tell whether efforts were measured: in half of the samples, and not all exactly zero."""
        enough = len(self._efforts) >= SETTINGS.usable * len(self._models)
        return enough and bool(np.any(self._efforts))


def require_within(arm: Arm, position: Array) -> None:
    """Refuse to command an arm that is where the one that is meant cannot be.

    Args:
        arm: The arm that is meant.
        position: (n,) where the arm is, rad or m.

    Raises:
        StartRefusedError: Further than 20 deg (35 mm) outside the arm's limits.
    """
    beyond = np.maximum(arm.lower - position, position - arm.upper)
    worst = int(np.argmax(beyond / arm.scale))
    if not beyond[worst] <= SETTINGS.outside * arm.scale[worst]:
        joint = arm.joints[worst]
        raise StartRefusedError(
            f"{joint.name} is at {joint.shown(position[worst])}, {joint.shown(beyond[worst])} "
            f"outside the limits of {arm.name}: the other side's arm?"
        )


def _unread(settings: Settings, position: Array) -> Array:
    """Return (n,) efforts that the arm's readings lack of what holds it, N·m.

    Raises:
        StartRefusedError: They lack its weight, and nothing says what that is.
    """
    arm = settings.model.arm
    if arm.gravity_in_reading:
        return np.zeros(arm.n)
    stated = stated_weight(arm, position)
    if stated is None and settings.weightless:
        raise StartRefusedError(
            "efforts are read without gravity (effort_has_gravity), and neither the model nor the "
            "arm's file says what the arm weighs: it would fall"
        )
    return settings.weight(position) if stated is None else stated


def _compare_with_masses(settings: Settings, position: Array) -> None:
    """Refuse a model that holds the arm with another weight than the masses in its file have.

    What is measured does not show it: it may be read wrong as the model's recordings were.
    """
    arm = settings.model.arm
    weight = None if arm.newtons_said else stated_weight(arm, position)
    if weight is None:
        return
    unit = 1.0 / arm.effort_size if arm.read_in == ANY_UNIT else 1.0  # the unit was never stated
    weight = unit * weight
    poses = np.random.default_rng(0).uniform(*arm.range, (SETTINGS.poses, arm.n))
    drawn = stated_weight(arm, poses)
    assert drawn is not None
    drawn = unit * drawn
    usual = np.sqrt(np.mean(drawn**2, axis=0))
    held = settings.held(position)
    size = float(np.sum((arm.scale * weight) ** 2))
    if size < (SETTINGS.least_weight * np.linalg.norm(arm.scale * usual)) ** 2:
        _compare_elsewhere(arm, settings.weight(poses), drawn)
        return
    ratio = float(arm.scale * held @ (arm.scale * weight)) / size
    worst = int(np.argmax(np.abs(arm.scale * weight)))
    if WEIGHT.least <= ratio <= WEIGHT.most_loaded:
        # A joint alone: where it bears what it usually does, or more.
        bears = np.abs(weight) > np.maximum(usual, SETTINGS.negligible * arm.effort_limit)
        part = np.divide(held, weight, where=bears, out=np.ones(arm.n))
        worst = int(np.argmin(part))
        ratio = float(part[worst])
        if ratio >= WEIGHT.least:
            return
    joint = arm.joints[worst]
    raise StartRefusedError(
        f"the model holds {ratio:.2g} times what the masses in the arm's file weigh here "
        f"({joint.name}: {held[worst]:.3g} of {weight[worst]:.3g} {EFFORT_UNITS[joint.kind]}): "
        "were efforts in another unit when it was identified, or is it another arm's? effort_unit: "
        "N·m in the model's file says that those masses are wrong"
    )


def _compare_elsewhere(arm: Arm, by_model: Array, stated: Array) -> None:
    """Refuse a model whose weight is another one than the stated masses' over the arm's range.

    Near balance an arm shows neither; what it is moved to from there does.

    Args:
        arm: The arm.
        by_model: (N, n) torques that hold its weight by the model, N·m.
        stated: (N, n) the same by its masses.
    """
    ratio = float(np.sum(arm.scale**2 * by_model * stated) / np.sum((arm.scale * stated) ** 2))
    if not WEIGHT.least <= ratio <= WEIGHT.most_loaded:
        raise StartRefusedError(
            f"over the arm's range the model's weight is {ratio:.2g} times what the masses in its "
            "file weigh: were efforts in another unit when it was identified, or is it another "
            "arm's? effort_unit: N·m in the model's file says that those masses are wrong"
        )


def _compare(mean: Array, model: Array, settings: Settings, tolerance: float) -> None:
    """Refuse to start where (n,) measured and modelled efforts are too far apart."""
    excess = np.abs(mean - model) / settings.model.arm.effort_limit
    worst = int(np.argmax(excess))
    if not excess[worst] <= tolerance:
        joint = settings.model.arm.joints[worst]
        raise StartRefusedError(
            f"{joint.name} is held with {mean[worst]:.4g} {joint.effort_unit} as "
            f"measured, with {model[worst]:.4g} by the model: a wrong unit, another arm's model, "
            f"an arm that leans on something? Allowed are {tolerance:g} of the "
            "arm's effort_limit (start_tolerance)"
        )
    limit = settings.model.arm.effort_limit
    held, by_model = mean / limit, model / limit
    size = float(held @ held)
    part = float(held @ by_model) / size if size > 0.0 else 1.0
    if size > SETTINGS.felt**2 and part < SETTINGS.least_part:
        worst = int(np.argmax(np.abs(held)))
        joint = settings.model.arm.joints[worst]
        raise StartRefusedError(
            f"the model holds {100 * part:.1f} % of what the arm is held with as measured "
            f"({joint.name}: {model[worst]:.3g} of {mean[worst]:.3g} {joint.effort_unit}): a wrong "
            "unit, another arm's model, an arm that leans on something?"
        )


def _dry_friction(settings: Settings, position: Array | None) -> Array:
    """Return (n,) torques that friction holds at rest, as far as it is compensated, N·m."""
    assert position is not None  # there is a sample
    speed = SETTINGS.dry * settings.model.arm.scale
    up, down = (settings.parts(position, way)[1] for way in (speed, -speed))
    return np.maximum(np.minimum(up, -down), 0.0)
