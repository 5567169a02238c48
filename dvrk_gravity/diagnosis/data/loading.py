"""Recordings beside the model under test: what a diagnosis is made of, unless none can be made.

Noise, efforts of another motion, and those without gravity are refused: no model can be judged by
them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.motion import BAND, MeasuredMotion
from dvrk_gravity.effects import State
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.estimation import beats
from dvrk_gravity.identification import READ_WITHOUT, bears_weight
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.observation import (
    Observation,
    held_beyond,
    observe,
    predictable,
    require_all,
    require_measured,
)
from dvrk_gravity.recording import Bands, Recording
from dvrk_gravity.units import quantity

_BEGINNING = 60.0  # s of a recording that are looked at. Chosen: a stretch of a long one
# Standard errors by which a prediction must beat a constant. Chosen: of two predictions at each of
# seven joints one in fifty does by chance.
_DEVIATIONS = 3.0
# Part of what inertia and friction leave of a joint's effort, and of its weight, squared, that the
# weights of all joints explain, below which they are not in it. Chosen: smooth functions of the
# positions explain some of any error. A weight that would be a smaller part cannot be judged.
# `identify` has a fit and its standard errors, and another question: the part of the masses' weight
# that is left (`GONE`), where another unit counts as none. Here efforts may have any scale.
_EXPLAINED = 0.25
_CONSTANT = 0.01  # of a weight's RMS: what varies less is not distinguished from a bias. Chosen
_SAMPLES = 4000  # that are looked at: a bound on time


@dataclass(frozen=True)
class LoadSettings:
    """Which part of a recording is used.

    Attributes:
        band: Hz, of the kinematics that non-linear columns are computed from. Chosen: more than
            twice that of the torques that are compared.
        rate: Hz; faster recordings are thinned to about this. Chosen: four times the Nyquist rate
            of that band.
        shortest: s of motion, below which no choice among hypotheses can be judged: five blocks of
            half a second are held out of it (``BlockSettings``). Chosen.
        fewest: Static poses, likewise. Chosen.
        longest: s of motion that hypotheses are built for: they then take less than 2 GiB
            (benchmark/diagnose.py).
        stretch: s; of more, stretches that long are used: enough to find a period of the motion.
    """

    band: float = 20.0
    rate: float = 160.0
    shortest: float = 8.0
    fewest: int = 40
    longest: float = 600.0
    stretch: float = 60.0

    @property
    def bands(self) -> Bands:
        """How recordings are filtered."""
        return Bands(self.band, self.band, BAND, self.rate, 1.5 * self.band, for_fit=False)


def load(
    recordings: Sequence[Recording],
    model: TorqueModel,
    fixed_positions: Mapping[str, float] | None = None,
    settings: LoadSettings | None = None,
) -> MeasuredMotion:
    """Return what recordings show beside a model.

    Args:
        recordings: Trajectories, or static poses, not both; joint or actuator coordinates. Of
            trajectories longer than ``settings.longest`` together, stretches are used.
        model: The model under test.
        fixed_positions: Positions of joints that were not recorded, rad.
        settings: Which part of the recordings is used.

    Raises:
        RecordingError: Names what is missing: effort, samples, motion.
    """
    settings = settings or LoadSettings()
    if not recordings:
        raise RecordingError("recordings", "there are none, expected at least one")
    first = recordings[0].source
    kinds = {recording.time is None for recording in recordings}
    if len(kinds) > 1:
        raise RecordingError(first, "static poses and trajectories cannot be diagnosed together")
    static = kinds.pop()
    fixed_positions, held = held_beyond(recordings, model.arm, fixed_positions or {})
    for recording in recordings:
        require_all(recording, model.arm, fixed_positions)
    if len({recording.joints for recording in recordings}) > 1:
        raise RecordingError(first, "the recordings hold different joints")
    if len(recordings) == 1:
        _require_length(recordings[0], settings)
    observed = observe(
        recordings, model.arm, settings.bands, fixed_positions, longest=settings.longest,
        stretch=settings.stretch,
    )  # fmt: skip
    motion = MeasuredMotion.beside_model(model, Observation.joined(observed))
    motion = replace(motion, warnings=(*held, *motion.warnings))
    if model.arm.direct_drive and not static:
        names = np.array(model.arm.joint_names)[motion.present].tolist()
        require_measured(first, names, motion.effort[:, motion.present])
    if static:
        enough = len(motion) >= settings.fewest
        has, needs = f"{len(motion)} static poses", f"at least {settings.fewest}"
    else:
        total = len(motion) / (motion.rate or 1.0)
        enough = total >= settings.shortest
        has, needs = f"{total:.3g} s of usable motion", f"at least {settings.shortest:g} s"
    if not enough:
        raise RecordingError(first, f"holds {has}, a diagnosis needs {needs}")
    return motion


def _require_length(recording: Recording, settings: LoadSettings) -> None:
    if recording.time is None:
        return
    # Each sample stands for an interval, the last one too.
    count = len(recording)
    duration = float(recording.time[-1] - recording.time[0]) * count / max(count - 1, 1)
    if duration < settings.shortest * (1.0 - 1e-6):
        raise RecordingError(
            recording.source,
            f"lasts {duration:.3g} s, a diagnosis needs at least {settings.shortest:g} s of motion",
        )


def beginning(recording: Recording) -> Recording:
    """Return the part of a recording that is looked at."""
    time = recording.time
    return recording if time is None else recording.rows(time <= time[0] + _BEGINNING)


def require_predictable(motion: MeasuredMotion, recordings: Sequence[Recording]) -> None:
    """Refuse efforts that neither the model predicts, nor a plain one fitted to them.

    Args:
        motion: The motion, with the model under test.
        recordings: Its recordings, corrected.

    Raises:
        RecordingError: Efforts of which those of no joint are predicted better than by a constant.
    """
    if motion.static or not motion.present.all():
        return  # no plain model is determined there
    usable = ~motion.silent
    error, off = (np.where(usable, each, 0.0) for each in (motion.residual, _centred(motion)))
    if beats(error**2, off**2, _DEVIATIONS).any():
        return
    for recording in recordings:
        try:
            if predictable(beginning(recording), motion.arm, _DEVIATIONS):
                return
        except RecordingError:  # too short a one for a plain model
            return
    raise RecordingError(
        recordings[0].source,
        "efforts of no joint are predicted better than by a constant, by the model or by one that "
        "is fitted to them: noise, or those of another motion?",
    )


def _centred(motion: MeasuredMotion) -> Array:
    """Return (N, n) efforts less their means over usable samples."""
    usable = ~motion.silent
    count = np.maximum(usable.sum(axis=0), 1)
    return motion.effort - np.where(usable, motion.effort, 0.0).sum(axis=0) / count


def require_gravity(motion: MeasuredMotion, source: str) -> None:
    """Refuse efforts without the model's gravity.

    Most joints that bear weight must lack it; a single one may be balanced, or broken. A weight
    that stays the same, as on a vertical slide, cannot be distinguished from a bias. Efforts of
    another sign or scale, or exchanged, are explained by the weights of the joints.

    Raises:
        RecordingError: Naming the joints, and the option for efforts read without gravity.
    """
    arm = motion.arm
    if not arm.gravity_in_reading:
        return
    terms = tuple(term for term in motion.model.terms if term.WEIGHT_OF_ARM)
    rows = slice(None, None, max(1, len(motion.q) // _SAMPLES))
    weight = sum(
        (term.torque(State.of(motion.true_q[rows])) for term in terms),
        np.zeros_like(motion.q[rows]),
    )
    size = np.sqrt(np.mean(weight**2, axis=0))
    varies = weight.std(axis=0) > _CONSTANT * size
    bearing = np.flatnonzero(bears_weight(size, arm) & motion.moves & varies)
    lacks = {joint: _lacks(motion, rows, weight, joint) for joint in bearing.tolist()}
    gone = [joint for joint, lacking in lacks.items() if lacking]
    judged = [joint for joint, lacking in lacks.items() if lacking is not None]
    if 2 * len(gone) <= len(judged):
        return
    shown = ", ".join(
        f"{arm.joint_names[joint]} ({quantity(size[joint], arm.joints[joint].effort_unit)})"
        for joint in gone
    )
    raise RecordingError(
        source,
        f"gravity is not in the efforts of {shown}, RMS by the model: does the driver subtract it? "
        f"{READ_WITHOUT} says so",
    )


def _lacks(motion: MeasuredMotion, rows: slice, weight: Array, joint: int) -> bool | None:
    """Return whether a joint's effort lacks the (N, n) weights; None: the motion would not show it.

    It does not where they are in it as the model states them, which their mean shows, too. Else,
    beside a constant, friction, a rotor and the rest of the model, at its scale in the efforts.
    """

    def left(values: Array, columns: Array) -> Array:
        return np.asarray(values - columns @ np.linalg.lstsq(columns, values, rcond=1e-6)[0])

    used, effort = ~motion.silent[rows, joint], motion.effort[rows, joint]
    modelled, speed = motion.modelled[rows, joint], motion.qd[rows, joint]
    rest = modelled - weight[:, joint]
    stated, unweighted = (float(np.sum((effort - each)[used] ** 2)) for each in (modelled, rest))
    if stated <= (1.0 - _EXPLAINED) * unweighted:
        return False
    beside = np.ones_like(speed), np.sign(speed), speed, motion.qdd[rows, joint]
    every = np.column_stack([*beside, effort, rest, weight])[used]
    every = left(every[:, 4:], every[:, :4])
    effort, rest, weights = every[:, 0], every[:, 1:2], every[:, 2:]
    scale = float(np.linalg.lstsq(rest, effort, rcond=None)[0][0]) if rest.any() else 1.0
    own = float(np.sum((scale * left(weights, rest)[:, joint]) ** 2))
    without, by_all = (
        float(np.sum(left(effort, of) ** 2)) for of in (rest, np.hstack([rest, weights]))
    )
    if without - by_all >= _EXPLAINED * min(own, without):
        return False
    return True if own >= _EXPLAINED * without else None
