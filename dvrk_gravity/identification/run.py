"""Identification of whatever was recorded: trajectories or static poses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from dvrk_gravity.arm import Arm
from dvrk_gravity.errors import ConfigError, RecordingError
from dvrk_gravity.identification.coordinates import detect_coordinates
from dvrk_gravity.identification.dynamic_fit import fit_dynamic
from dvrk_gravity.identification.evaluation import evaluate
from dvrk_gravity.identification.motion import require_all
from dvrk_gravity.identification.result import Fit
from dvrk_gravity.recording import Recording
from dvrk_gravity.recording.data import Coordinates
from dvrk_gravity.terms import TERMS

Report = Callable[[str, float], None]


def identify(
    recordings: Sequence[Recording],
    arm: Arm,
    coordinates: Coordinates | None = None,
    effects: Sequence[str] | None = None,
    validate: Sequence[Recording] = (),
    physical: bool = False,
    report: Report = lambda stage, share: None,
) -> Fit:
    """Fit a torque model to recordings, choosing its terms by held-out error.

    Args:
        recordings: Trajectories, or static poses; all joints, with efforts.
        arm: The arm.
        coordinates: Of the recordings; ``None``: found out.
        effects: Effects that may be used besides the rigid body; ``None``: all.
        validate: Recordings kept out of fit and choice; the held-out errors are then theirs.
        physical: Ask for links that can exist: every pseudo-inertia positive definite.
        report: Called with the stage and the share of it that is done.

    Raises:
        RecordingError: No recording, one that cannot be used, or trajectories mixed with poses.
        ConfigError: An effect that no term has.
    """
    if not recordings:
        raise RecordingError("recordings", "none given, expected at least one")
    names = {term.NAME for term in TERMS}
    for effect in effects or ():
        if effect not in names:
            raise ConfigError("--terms", effect, f"some of {', '.join(sorted(names))}")
    for recording in (*recordings, *validate):
        require_all(recording, arm)
    static = [recording.time is None for recording in recordings]
    if any(static) != all(static):
        raise RecordingError(
            recordings[static.index(True)].source,
            "holds static poses, expected trajectories only or poses only",
        )
    if static[0]:
        from dvrk_gravity.identification.static_fit import fit_static

        fit = fit_static(recordings, arm, coordinates or "joint", report)
    else:
        reason: tuple[str, ...] = ()
        if coordinates is None:
            report("coordinates", 0.0)
            coordinates, found = detect_coordinates(recordings, arm)
            reason = (found,)
        fit = fit_dynamic(recordings, arm, coordinates, effects, physical=physical, report=report)
        fit = replace(fit, handling=(*reason, *fit.handling))
    return _validated(fit, validate) if validate else fit


def _validated(fit: Fit, recordings: Sequence[Recording]) -> Fit:
    """Return the fit with the errors on recordings that it never saw."""
    result = evaluate(fit.model, recordings, fit.coordinates)
    names = ", ".join(recording.source for recording in recordings)
    return replace(
        fit,
        held_out=result.joints,
        traces=result.traces,
        warnings=(*fit.warnings, *result.warnings),
        validation=f"recordings that neither fit nor choice of terms saw: {names}",
    )
