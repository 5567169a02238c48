"""Are the columns of a recording those of the joints or those of the motors?"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import get_args

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array, Mask
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.estimation import Folds, FoldSums, beats, fit, make_folds, student
from dvrk_gravity.model import Columns, start_columns
from dvrk_gravity.observation.design import build_design
from dvrk_gravity.observation.joint_space import in_joint_space
from dvrk_gravity.observation.observation import Observation
from dvrk_gravity.recording import Coordinates, Note, Prepared, Recording, prepare

# s of a recording that are looked at. Chosen: some periods of the slowest sine of an exciting
# motion, 0.07 Hz.
LOOKED_AT = 40.0
# Ratio of the two held-out errors above which neither is clearly better. Chosen.
CLEAR = 0.97
# Greatest p-value of Student's test over the folds: that of a wrong correction in a diagnosis. A
# plain model predicts little of a narrow motion: there either may be better by chance.
ALPHA = 0.001
# Ratio of the two errors of the model at hand below which a plain one is not believed against it.
# Chosen: of a narrow motion with Stribeck friction at its elbow a plain model has .75 of the error
# in the wrong coordinates, the model that was identified of the arm four times the error.
_TWICE = 0.5


# What can be looked at: as recorded, or filtered for a fit already.
Source = Recording | Prepared


def recorded_as(source: Source) -> Recording:
    """Return what was recorded."""
    return source.recording if isinstance(source, Prepared) else source


def filtered(source: Source) -> Prepared:
    """Return it filtered for a fit.

    Raises:
        RecordingError: Whatever ``prepare`` refuses.
    """
    return source if isinstance(source, Prepared) else prepare(source)


@dataclass(frozen=True, eq=False)
class CoordinateErrors:
    """Held-out errors of a plain model in both coordinates, relative to the torque.

    Attributes:
        whole: Of all held-out blocks together.
        blocks: (F,) of each fold.
    """

    whole: Mapping[Coordinates, float]
    blocks: Mapping[Coordinates, Array]

    @property
    def best(self) -> Coordinates:
        """The coordinates of the smaller error."""
        return min(self.whole, key=lambda system: self.whole[system])

    def clearly_not(self, system: Coordinates) -> bool:
        """Whether the other coordinates fit clearly better, in all folds together and in each."""
        best = self.best
        if best == system or self.whole[best] > CLEAR * self.whole[system]:
            return False
        steps = (np.log(np.maximum(self.blocks[each], 1e-12)) for each in (system, best))
        p_value = student(np.subtract(*steps))
        return p_value is None or p_value < ALPHA  # none of few folds


@dataclass(frozen=True, eq=False)
class Decision:
    """Coordinates of a recording, and how they were determined.

    Attributes:
        coordinates: Joint, as ``measured_js`` publishes them, or actuator, the motors'.
        reason: How they were determined, one sentence; ``""``: given, or the same either way.
        warnings: That the given ones look wrong.
        errors: What was compared; ``None`` where nothing was.
    """

    coordinates: Coordinates
    reason: str = ""
    warnings: tuple[Note, ...] = ()
    errors: CoordinateErrors | None = None


def decide_coordinates(
    recording: Source,
    arm: Arm,
    given: Coordinates | None,
    misfit: Callable[[Coordinates], float] | None = None,
) -> Decision:
    """Return the coordinates of a recording: the one rule of all verbs.

    A plain model of the arm is fitted in both; the one in which it predicts held-out blocks better
    is taken, or joint coordinates where neither is clearly better. Where not all folds agree, the
    model at hand, if there is one, must do so. Given ones are taken, with a warning if the others
    fit clearly better. Static poses, and recordings of some joints, determine no plain model: there
    the model at hand decides, if there is one.

    Args:
        recording: Trajectory or static poses.
        arm: The arm. Where each motor turns one joint, by as much, both are the same.
        given: As stated by the user; ``None``: not stated.
        misfit: Error of the model at hand, if there is one, in either coordinates.
    """
    if arm.direct_drive:
        return Decision(given or "joint")
    errors = _errors(recording, arm)
    if errors is None:
        decided = Decision("joint") if misfit is None else _by_misfit(_misfits(misfit))
        return decided if given is None else Decision(given)
    shown = _shown(errors, misfit)
    if given is not None:
        warnings = (
            () if shown in (None, given) else _doubt(recorded_as(recording).source, errors, given)
        )
        return Decision(given, "", warnings, errors)
    joint, actuator = (errors.whole[system] for system in get_args(Coordinates))
    if shown is None:
        reason = (
            "read as joint coordinates; actuator ones fit neither clearly better nor clearly worse "
            f"(held-out error over torque {joint:.3f} and {actuator:.3f})"
        )
        return Decision("joint", reason, (), errors)
    reason = (
        f"read as {shown} coordinates: held-out error over torque of a plain model "
        f"{min(joint, actuator):.3f}, in the other coordinates {max(joint, actuator):.3f}"
    )
    return Decision(shown, reason, (), errors)


def _shown(
    errors: CoordinateErrors, misfit: Callable[[Coordinates], float] | None
) -> Coordinates | None:
    """Return the coordinates that fit clearly better; ``None``: neither do.

    Of a PSM's motion of half a minute not all folds agree. A narrow motion with more friction than
    a plain model has looks no different: there the model at hand must agree. Nowhere may it
    have twice the error.
    """
    best = errors.best
    other: Coordinates = "actuator" if best == "joint" else "joint"
    if errors.whole[best] > CLEAR * errors.whole[other]:
        return None
    clear = errors.clearly_not(other)
    if misfit is None or (clear and best == "joint"):  # which is taken anyway
        return best
    sizes = _misfits(misfit)
    if sizes is not None and sizes[other] <= _TWICE * sizes[best]:
        return None
    return best if clear or _by_misfit(sizes).coordinates == best else None


def _errors(recording: Source, arm: Arm) -> CoordinateErrors | None:
    """Return how a plain model does in both coordinates; ``None`` where it cannot be fitted."""
    raw = recorded_as(recording)
    if raw.time is None or raw.effort is None or set(arm.joint_names) - set(raw.joints):
        return None
    try:
        return _coordinate_errors(recording, arm)
    except RecordingError:  # whoever reads it next says why
        return None


def _misfits(misfit: Callable[[Coordinates], float]) -> dict[Coordinates, float] | None:
    try:
        return {system: misfit(system) for system in get_args(Coordinates)}
    except RecordingError:  # whoever reads it next says why
        return None


def _by_misfit(sizes: Mapping[Coordinates, float] | None) -> Decision:
    if sizes is None:
        return Decision("joint")
    clearly = sizes["actuator"] <= CLEAR * sizes["joint"]
    best: Coordinates = "actuator" if clearly else "joint"
    reason = (
        f"read as {best} coordinates: mean |e|/|tau| of the model {sizes[best]:.3f}, "
        f"{sizes['joint' if clearly else 'actuator']:.3f} in the others"
    )
    return Decision(best, reason)


def _coordinate_errors(recording: Source, arm: Arm) -> CoordinateErrors:
    """Return the held-out error of a plain model in both coordinates, relative to the torque.

    Errors are those of the recorded efforts, comparable in both; their size is the 2n-th root of
    the determinant of their covariance, which gives the likelihood of Gaussian errors whether they
    are independent at the motors or at the joints.
    """
    prepared = filtered(recording)
    systems = get_args(Coordinates)
    errors, informative, folds, _ = zip(
        *(_held_out_errors(prepared.read_as(system), arm) for system in systems), strict=True
    )
    # The same samples in both: friction that holds a joint in one need not in the other.
    counted = np.logical_and(*informative)
    seen = counted.any(axis=0)
    scaled = {
        system: np.where(counted, error, 0.0)[:, seen] / np.sqrt(counted.sum(axis=0)[seen])
        for system, error in zip(systems, errors, strict=True)
    }
    return CoordinateErrors(
        {system: _size(error) for system, error in scaled.items()},
        {
            system: np.array([_size(error[rows]) for rows in folds[0].tested])
            for system, error in scaled.items()
        },
    )


def predictable(recording: Recording, arm: Arm, deviations: float) -> bool:
    """Return whether a plain model predicts any joint's effort better than a constant does.

    Args:
        recording: A trajectory of all joints.
        arm: The arm.
        deviations: Standard errors by which it must be better.

    Raises:
        RecordingError: Whatever ``prepare`` refuses.
    """
    error, informative, _, off = _held_out_errors(filtered(recording), arm)
    error, off = (np.where(informative, each, 0.0) for each in (error, off))
    return bool(beats(error**2, off**2, deviations).any())


def _doubt(source: str, errors: CoordinateErrors, given: Coordinates) -> tuple[Note, ...]:
    """Return the warning that the other coordinates than those given fit clearly better."""
    best, whole = errors.best, errors.whole
    return (
        Note(
            "coordinates",
            None,
            {"given": whole[given], "other": whole[best]},
            f"{source} was given as {given} coordinates, but looks like {best} "
            f"ones: held-out error over torque of a plain model {whole[given]:.3f}, as {best} ones "
            f"{whole[best]:.3f}",
        ),
    )


def _held_out_errors(prepared: Prepared, arm: Arm) -> tuple[Array, Mask, Folds, Array]:
    """Return a plain model's held-out errors, which are informative, folds, a constant's errors.

    Errors are (N, n), of the efforts as recorded, over the RMS of each.
    """
    observed = _head(in_joint_space(prepared, arm))
    columns = Columns(arm, observed.q.min(axis=0), observed.q.max(axis=0))
    chosen = start_columns(columns)
    design = build_design(columns, [observed], chosen=chosen)
    folds = make_folds(design.time, design.part, design.state.q, design.rate)
    sums = FoldSums(design.x, design.y, folds, np.ones_like(design.y))
    # A tenth of the torque is what such a model leaves, correlated over half a second.
    weight = 1.0 / (np.maximum(0.1 * design.y.std(axis=0), 1e-6) ** 2 * 0.5 * design.rate)
    scale, positive = columns.scale[chosen], columns.positive[chosen]
    error = design.y - sums.predicted(lambda seen: fit(seen, weight, scale, positive).theta)
    effort, informative = design.y, design.informative
    if prepared.recording.coordinates == "joint":
        error, effort = arm.joint_effort(error), arm.joint_effort(effort)
        informative = ~arm.joints_of(~informative)
    rms = np.maximum(np.sqrt(np.mean(effort**2, axis=0)), 1e-6)
    # Of a joint whose efforts are no readings anywhere, the mean is of what nobody compares.
    off = effort - effort.mean(axis=0, where=informative | ~informative.any(axis=0))
    return error / rms, informative, folds, off / rms


def _size(error: Array) -> float:
    """Return the 2n-th root of the determinant of E' E of (N, n) errors E."""
    count = error.shape[1]
    floor = 1e-12 * np.eye(count)
    return float(np.exp(0.5 * np.linalg.slogdet(error.T @ error + floor)[1] / max(count, 1)))


def _head(observed: Observation) -> Observation:
    """Return the beginning of the first part."""
    first, low = observed.parts[0], observed.filter
    assert low is not None
    rows = max(int(LOOKED_AT * low.rate), 6 * low.edge)
    return observed.at(slice(first.start, min(first.stop, first.start + rows)))
