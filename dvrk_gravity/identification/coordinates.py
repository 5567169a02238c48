"""Are the columns of a recording those of the joints or those of the motors?"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import State
from dvrk_gravity.errors import RecordingError
from dvrk_gravity.estimation import Folds, fit, make_folds
from dvrk_gravity.identification.columns import Columns
from dvrk_gravity.identification.design import build_design
from dvrk_gravity.identification.errors import ConstantSettings, beats
from dvrk_gravity.identification.motion import CalibrationMotion, Source, read, read_motions
from dvrk_gravity.identification.moves import start_columns
from dvrk_gravity.identification.selection import training_equations
from dvrk_gravity.recording import Coordinates, DataWarning, Recording


@dataclass(frozen=True)
class CoordinateSettings:
    """When the coordinates of a recording count as known.

    Attributes:
        duration: s of a recording that are looked at. Chosen: some periods of the slowest sine of
            an exciting motion, 0.07 Hz.
        clear: Ratio of the two held-out errors above which it does not matter, or cannot be told.
            Chosen.
    """

    duration: float = 40.0
    clear: float = 0.97


@dataclass(frozen=True, eq=False)
class CoordinateErrors:
    """Held-out errors of a plain model in both readings of a recording, over the torque.

    Attributes:
        whole: Of all held-out blocks together.
        blocks: (F,) of each fold's.
    """

    whole: Mapping[Coordinates, float]
    blocks: Mapping[Coordinates, Array]

    @property
    def best(self) -> Coordinates:
        """The reading of the lesser error."""
        return min(self.whole, key=lambda system: self.whole[system])

    def clearly_not(self, system: Coordinates) -> bool:
        """Whether the other reading is clearly the better one."""
        best = self.best
        clear = CoordinateSettings().clear * self.whole[system]
        return best != system and self.whole[best] <= clear


@dataclass(frozen=True, eq=False)
class Decision:
    """What the columns of a recording are, and how that is known.

    Attributes:
        coordinates: Joint, what ``measured_js`` publishes, or actuator, the motors'.
        reason: How it was found out, one sentence; ``""``: it was given, or is the same either way.
        warnings: That what was given looks like the other.
        errors: By which it was decided; ``None`` where nothing was compared.
    """

    coordinates: Coordinates
    reason: str = ""
    warnings: tuple[DataWarning, ...] = ()
    errors: CoordinateErrors | None = None


def decide_coordinates(
    recording: Source,
    arm: Arm,
    given: Coordinates | None,
    misfit: Callable[[Coordinates], float] | None = None,
) -> Decision:
    """Return what the columns of a recording are: what every verb goes by.

    A plain model of the arm is fitted to both readings, and the one in which it predicts held-out
    blocks better is taken; where neither is clearly better, joint coordinates. What was given is
    taken, with a warning if the other reading is clearly better. Static poses, and recordings of
    some joints, determine no plain model: there the model at hand decides, if there is one.

    Args:
        recording: Trajectory or static poses.
        arm: The arm. Where its motors each turn one joint, by as much, both readings are the same.
        given: What somebody said they are; ``None``: nobody did.
        misfit: Error of the model at hand, if there is one, in either reading of the recording.
    """
    if arm.direct_drive:
        return Decision(given or "joint")
    errors = _errors(recording, arm)
    if given is not None:
        warnings = () if errors is None else _doubt(recording.head.source, errors, given)
        return Decision(given, "", warnings, errors)
    if errors is None:
        return Decision("joint") if misfit is None else _by_misfit(misfit)
    joint, actuator = (errors.whole[system] for system in get_args(Coordinates))
    best = errors.best
    other = errors.whole["actuator" if best == "joint" else "joint"]
    if errors.whole[best] > CoordinateSettings().clear * other:
        reason = (
            "taken as joint coordinates; actuator coordinates would fit about equally well "
            f"(held-out error over torque {joint:.3f} and {actuator:.3f})"
        )
        return Decision("joint", reason, (), errors)
    reason = (
        f"taken as {best} coordinates: a plain model leaves a held-out error of "
        f"{errors.whole[best]:.3f} of the torque, {other:.3f} in the others"
    )
    return Decision(best, reason, (), errors)


def _errors(recording: Source, arm: Arm) -> CoordinateErrors | None:
    """Return how a plain model does in both readings; ``None`` where it cannot be fitted."""
    head = recording.head
    static = isinstance(head, Recording) and (head.time is None or head.effort is None)
    if static or set(arm.joint_names) - set(head.joints):
        return None
    try:
        return coordinate_errors(recording, arm)
    except RecordingError:  # whoever reads it next says why
        return None


def _by_misfit(misfit: Callable[[Coordinates], float]) -> Decision:
    sizes = {system: misfit(system) for system in get_args(Coordinates)}
    best: Coordinates = "joint" if sizes["joint"] <= sizes["actuator"] else "actuator"
    reason = (
        f"taken as {best} coordinates: mean |e|/|tau| of the model {sizes[best]:.3f}, "
        f"{max(sizes.values()):.3f} in the others"
    )
    return Decision(best, reason)


def coordinate_errors(recording: Source, arm: Arm) -> CoordinateErrors:
    """Return the held-out error of a plain model in either reading of a recording, over the torque.

    Of the efforts as they were recorded, for those of the motors are others in either reading; and
    by the determinant of the errors' covariance, the 2n-th root of it, which tells the likelihood
    of Gaussian errors that are independent at the motors or at the joints, whichever they are.

    Raises:
        RecordingError: Whatever ``read_motions`` refuses.
    """
    trajectory = replace(read(recording), coordinates=None)
    systems = get_args(Coordinates)
    errors, told, folds, _ = zip(
        *(_held_out_errors(trajectory, arm, system) for system in systems), strict=True
    )
    # The same samples in both: friction that holds a joint in one reading need not in the other.
    counted = np.logical_and(*told)
    seen = counted.any(axis=0)
    shown = {
        system: np.where(counted, error, 0.0)[:, seen] / np.sqrt(counted.sum(axis=0)[seen])
        for system, error in zip(systems, errors, strict=True)
    }
    tested = folds[0].tested
    return CoordinateErrors(
        {system: _size(error) for system, error in shown.items()},
        {
            system: np.array([_size(error[rows]) for rows in tested])
            for system, error in shown.items()
        },
    )


def predictable(recording: Recording, arm: Arm, settings: ConstantSettings) -> bool:
    """Return whether a plain model predicts any joint's effort better than a constant does.

    Raises:
        RecordingError: Whatever ``read_motions`` refuses.
    """
    system = recording.coordinates
    plain = replace(read(recording), coordinates=None)
    error, told, _, off = _held_out_errors(plain, arm, system or "joint")
    error, off = (np.where(told, each, 0.0) for each in (error, off))
    return bool(beats(error**2, off**2, settings).any())


def _doubt(source: str, errors: CoordinateErrors, given: Coordinates) -> tuple[DataWarning, ...]:
    """Return a warning if the other coordinates than those given clearly fit better."""
    if not errors.clearly_not(given):
        return ()
    best, whole = errors.best, errors.whole
    return (
        DataWarning(
            "coordinates",
            None,
            {"given": whole[given], "other": whole[best]},
            f"{source} was given as {given} coordinates, but looks like {best} "
            f"ones: a plain model leaves a held-out error of {whole[given]:.3f} of the torque, as "
            f"{best} ones {whole[best]:.3f}",
        ),
    )


def _held_out_errors(
    recording: Source, arm: Arm, coordinates: Coordinates
) -> tuple[Array, NDArray[np.bool_], Folds, Array]:
    """Return (N, n) held-out errors of a plain model, which say something, folds, and a constant's.

    Of the efforts as they were recorded, over the RMS of each.
    """
    motions = [_head(motion) for motion in read_motions([recording], arm, coordinates).parts[:1]]
    q = motions[0].state.q
    columns = Columns(arm, q.min(axis=0), q.max(axis=0))
    design, chosen = build_design(columns, motions), start_columns(columns)
    folds = make_folds(design.time, design.part, design.state.q, design.rate)
    plain = replace(design, x=design.x[:, :, chosen])
    _, train = training_equations(plain, folds, np.ones_like(design.y))
    # A tenth of the torque is what such a model leaves; half a second is how long it stays.
    weight = 1.0 / (np.maximum(0.1 * design.y.std(axis=0), 1e-6) ** 2 * 0.5 * design.rate)
    scale, positive = columns.scale[chosen], columns.positive[chosen]
    error = np.zeros_like(design.y)
    for seen, tested in zip(train, folds.tested, strict=True):
        theta = fit(seen, weight, scale, positive).theta
        error[tested] = design.y[tested] - plain.x[tested] @ theta
    effort, told = design.y, design.told
    if coordinates == "joint":
        error, effort = arm.joint_effort(error), arm.joint_effort(effort)
        told = ~arm.joints_of(~told)
    rms = np.maximum(np.sqrt(np.mean(effort**2, axis=0)), 1e-6)
    off = effort - effort.mean(axis=0, where=told)
    return error / rms, told, folds, off / rms


def _size(error: Array) -> float:
    """Return the 2n-th root of the determinant of E' E of (N, n) errors E."""
    count = error.shape[1]
    floor = 1e-12 * np.eye(count)
    return float(np.exp(0.5 * np.linalg.slogdet(error.T @ error + floor)[1] / max(count, 1)))


def _head(motion: CalibrationMotion) -> CalibrationMotion:
    samples = int(CoordinateSettings().duration * motion.filter.rate)
    rows = slice(0, max(samples, 6 * motion.filter.edge))
    state = motion.state
    assert state.qd is not None
    assert state.qdd is not None
    told = np.broadcast_to(motion.told, motion.effort.shape)
    return replace(
        motion,
        time=motion.time[rows],
        told=told[rows],
        state=State(state.q[rows], state.qd[rows], state.qdd[rows]),
        effort=motion.effort[rows],
    )
