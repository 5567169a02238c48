"""Identification of whatever was recorded: trajectories or static poses."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.effects import LinearTerm, State, from_other_packages, terms
from dvrk_gravity.errors import ArgumentError, ConfigError, EffectError, RecordingError
from dvrk_gravity.identification.evaluation import errors_of, evaluate
from dvrk_gravity.identification.file_forms import FORMS, ForFile, require_form
from dvrk_gravity.identification.quality.constant import (
    constants,
    recorded_range,
    settle,
    stated_bias,
)
from dvrk_gravity.identification.quality.physical import require_solver
from dvrk_gravity.identification.quality.verdict import POOR, judge, of_misread, with_constants
from dvrk_gravity.identification.quality.weights import by_weight, held_weights
from dvrk_gravity.identification.result import Fit
from dvrk_gravity.identification.trajectories.fit import fit_dynamic
from dvrk_gravity.identification.trajectories.problem import LEAST_GAIN
from dvrk_gravity.model import Columns, TorqueModel, fitted_effects
from dvrk_gravity.observation import (
    OTHER_SIDE,
    KnownPayload,
    all_static,
    contradiction,
    decide_coordinates,
    drive_gains,
    known_fixed_positions,
    observe,
    require_all,
    their_unit,
    with_held,
)
from dvrk_gravity.recording import (
    Coordinates,
    Given,
    Note,
    Prepared,
    Recording,
    about_arm,
    is_duplicate,
    known_coordinates,
    opened,
)

Report = Callable[[str, float], None]
Recordings = Sequence[Recording]
_SAME_TORQUE = 1e-9  # of the largest: two sums of the same products


def identify(
    recordings: Given | Iterable[Given],
    arm: Arm | str | Path,
    coordinates: Coordinates | Sequence[Coordinates] | None = None,
    effects: str | Sequence[str] | None = None,
    validate: Given | Iterable[Given] = (),
    physical: bool | None = None,
    report: Report = lambda stage, share: None,
    still: Mapping[str, float] | None = None,
    for_console: bool = False,
    known_payload: KnownPayload | float | None = None,
    least_gain: float = LEAST_GAIN,
    bias_is: str | Mapping[str, str] | None = None,
    for_file: ForFile | None = None,
) -> Fit:
    """Fit a torque model to recordings, choosing its terms by held-out error.

    Args:
        recordings: Trajectories, or static poses, with efforts: recordings or paths of their files,
            one or several. Beside one trajectory of all joints others may hold some joints only. Of
            a file of more than 600,000 samples stretches are used.
        arm: The arm, its name, or the path of its file.
        coordinates: Of the recordings, one for all or one for each; ``None``: determined for those
            of all joints, joint coordinates for the others.
        effects: Effects that may be used besides the rigid body; ``None``: all.
        validate: Recordings kept out of fit and choice; the held-out errors are then theirs.
        physical: Physically consistent links: every pseudo-inertia positive definite. ``None``: of
            trajectories, with a warning where no bodies are near the fit; static poses do not
            determine inertia.
        report: Called with the stage and the share of it that is done.
        still: Where joints stood that some recording does not hold: joint position, rad.
        for_console: The same as ``for_file="console"``.
        known_payload: Load of the last recording, and of no other: efforts are motor currents, and
            it determines their gains (``drive_gains``). The model is fitted to the others. A
            number: its mass, kg, on the last link.
        least_gain: Part of the squared held-out error, in the mean over motors, that each further
            term of a model of trajectories must remove. Less of it: terms of minor effect, too.
        bias_is: What a constant torque is that dry friction does not hold, for all joints or by
            joint: ``torque``, of a spring, which is compensated, or ``reading``, a bias of its
            effort (or a hand through the whole recording), which is not. ``None``: not known.
        for_file: Fit a model that this file can hold: of the dVRK console its compensation, a URDF,
            or an MJCF.

    Raises:
        RecordingError: No recording, one that cannot be used, or trajectories mixed with poses.
        ConfigError: An effect that no term has, or an option that does not go with poses.
        ArgumentError: An argument of a wrong type.
        NotConvergedError: No bodies near the fit, where ``physical`` requires them.
    """
    arm = Arm.of(arm)
    recordings, validate = opened(recordings, arm=arm), opened(validate, arm=arm)
    effects = [effects] if isinstance(effects, str) else effects
    if effects is not None and not isinstance(effects, Sequence):
        raise ArgumentError("effects", effects, "names of effects")
    still = known_fixed_positions(still, arm)
    if not recordings:
        raise RecordingError("recordings", "none given, expected at least one")
    arm, recordings, missing = with_held(recordings, arm, still)
    bias = stated_bias(bias_is, arm)
    validate = opened(validate, arm=arm)
    given = _each(coordinates, len(recordings))
    gains: tuple[Note, ...] = ()
    if known_payload is not None:
        arm, gains = _with_gains(recordings, arm, known_payload, given)
        recordings, given = recordings[:-1], given[:-1]
    arm, unit, wrong = their_unit(arm, recordings)
    # Neither masses that are not believed judge, nor is a mounting that the file states doubted.
    if wrong is not None and (arm.newtons_stated or (wrong.mounted and arm.base_stated)):
        unit, wrong = (*unit, wrong.warning), None
    if gains:  # found by a known load
        unit = tuple(note for note in unit if note.kind != "effort_read")
    recordings, validate = opened(recordings, arm=arm), opened(validate, arm=arm)
    if validate:
        _require_new(validate, recordings)
    for_file = "console" if for_console else for_file
    if for_file is not None:
        require_form(for_file, arm, effects, all_static(recordings))
    if all_static(recordings):
        fit = _static(recordings, arm, given, effects, physical, report, for_file == "console")
    else:
        _require_identified(effects, arm)
        fit = _dynamic(
            recordings, arm, given, effects, physical, report, still, for_file, least_gain
        )
    warnings = (*about_arm(arm.warnings), *missing, *gains, *unit, *fit.warnings)
    if not contradiction(fit.warnings):
        warnings = (*warnings, *by_weight(fit.parameters, arm))
    if for_file:
        warnings = (*warnings, Note("for_file", None, {}, FORMS[for_file].words))
    fit = replace(fit, warnings=warnings)
    _require_one_torque(fit.model)
    fit = _judged_with_constants(_validated(fit, validate) if validate else fit, bias)
    fit = _unless_contradicted(fit)
    return of_misread(fit, wrong) if wrong is not None else fit


def _judged_with_constants(fit: Fit, bias: Mapping[str, str]) -> Fit:
    """Return the fit with its constants, settled as stated, and with the weight that it found."""
    model, arm = fit.model, fit.model.arm
    found = constants(model, fit.holding, bias)
    weights = held_weights(model, recorded_range(fit.holding), fit.holding)
    verdict = with_constants(fit.verdict, found, weights, arm)
    model = replace(settle(model, found, bias), verdict=verdict.level, reason=verdict.reason)
    return replace(fit, model=model, verdict=verdict, constants=found, weights=weights)


def _require_identified(effects: Sequence[str] | None, arm: Arm) -> None:
    """Refuse effects that trajectories are not fitted with."""
    known = fitted_effects(arm)
    for effect in effects or ():
        if effect not in known:
            reasons = {term.NAME: term.NOT_FITTED for term in terms()}
            why = f" ({reasons[effect]})" if reasons.get(effect) else ""
            raise ConfigError("--terms", effect, f"some of {', '.join(known)}{why}")


def _unless_contradicted(fit: Fit) -> Fit:
    """Return the fit, not to be compensated with where its recordings are of the other arm."""
    why = contradiction(fit.warnings)
    if not why:
        return fit
    arm = fit.model.arm.name
    record = f"a motion of {arm}; or name the arm of these recordings, --arm {OTHER_SIDE[arm]}"
    return replace(
        fit,
        verdict=replace(fit.verdict, level=POOR, reason=why, record=record),
        model=replace(fit.model, verdict=POOR, reason=why),
    )


def _require_one_torque(model: TorqueModel) -> None:
    """Refuse effects of other packages whose methods do not agree on their torque.

    Columns are fitted, and the term's torque is compensated, as a model file restores it. For the
    package's own effects the contract test requires their agreement.

    Raises:
        EffectError: Naming the effect and the methods.
    """
    arm = model.arm
    state = State(*np.random.default_rng(0).uniform(-1.0, 1.0, (3, 20, arm.n)))
    others = set(from_other_packages().values())
    for term in model.terms:
        if term.NAME not in others or not isinstance(term, LinearTerm):
            continue
        columns = term.columns(state, term.memory(state))
        fitted = columns @ term.theta
        restored = type(term).from_parameters(arm, term.parameters())
        read = np.zeros_like(fitted) if restored is None else restored.torque(state)
        largest = np.abs(fitted).max()
        pairs = (
            (columns @ term.with_theta(term.theta).theta, "`theta` differs from `with_theta`'s"),
            (term.torque(state), "`torque` is not `regressor` times `theta`"),
            (read, "`from_parameters` does not restore what `parameters` writes"),
        )
        for torque, problem in pairs:
            if not np.allclose(torque, fitted, rtol=0.0, atol=_SAME_TORQUE * largest):
                raise EffectError(term.NAME, problem)


def _require_new(held_out: Recordings, fitted: Recordings) -> None:
    """Refuse to hold out what was fitted, or is held out already."""
    for index, recording in enumerate(held_out):
        if is_duplicate(recording, (*fitted, *held_out[:index])):
            raise RecordingError(
                recording.source,
                "its samples are those of a recording that was fitted or already validated: "
                "expected recordings that no fit has used",
            )


def _with_gains(
    recordings: Recordings,
    arm: Arm,
    load: KnownPayload | float,
    coordinates: Sequence[Coordinates | None],
) -> tuple[Arm, tuple[Note, ...]]:
    """Return the arm with the drive gains found by a known load, and notes on them."""
    if isinstance(load, bool) or not isinstance(load, KnownPayload | int | float):
        raise ArgumentError("known_payload", load, "a mass in kg, or a KnownPayload")
    if arm.drive_gains is not None:
        mass = load.mass if isinstance(load, KnownPayload) else load
        raise ConfigError("--known-payload", mass, "no drive gains with it: it determines them")
    if all_static(recordings):
        raise RecordingError(recordings[0].source, "holds static poses, expected trajectories")
    if not isinstance(load, KnownPayload):
        load = KnownPayload(float(load))
    *bare, loaded = recordings
    for recording in recordings:
        require_all(recording, arm)
    found = drive_gains(bare, [loaded], arm, load, coordinates[0] or "joint")
    return arm.with_drive_gains(found.gain, found.error), found.notes(arm)


def _each(
    coordinates: Coordinates | Sequence[Coordinates] | None, count: int
) -> Sequence[Coordinates | None]:
    """Return the coordinates of each of some recordings."""
    if coordinates is None or isinstance(coordinates, str):
        return [known_coordinates(coordinates)] * count
    if not isinstance(coordinates, Iterable):
        raise ArgumentError("coordinates", coordinates, "joint or actuator, for all or for each")
    each = [known_coordinates(system) for system in coordinates]
    if len(each) != count:
        raise ConfigError(
            "--coordinates", ",".join(map(str, each)), f"one for all recordings, or {count}"
        )
    return each


def _static(
    recordings: Recordings,
    arm: Arm,
    coordinates: Sequence[Coordinates | None],
    effects: Sequence[str] | None,
    physical: bool | None,
    report: Report,
    for_console: bool,
) -> Fit:
    from dvrk_gravity.identification.poses.fit import fit_static

    source = recordings[0].source
    if effects is not None:
        raise ConfigError(
            "--terms", ",".join(effects),
            f"no --terms with static poses ({source}): what explains them is chosen joint by joint",
        )  # fmt: skip
    if physical:
        raise ConfigError(
            "--physical", True,
            f"trajectories: static poses ({source}) do not determine the links' inertia",
        )  # fmt: skip
    if len(set(coordinates)) > 1:
        raise ConfigError("--coordinates", ",".join(map(str, coordinates)), "one for all poses")
    return fit_static(recordings, arm, coordinates[0] or "joint", report, for_console)


def _dynamic(
    recordings: Recordings,
    arm: Arm,
    coordinates: Sequence[Coordinates | None],
    effects: Sequence[str] | None,
    physical: bool | None,
    report: Report,
    still: Mapping[str, float],
    for_file: ForFile | None,
    least_gain: float,
) -> Fit:
    if physical is not False:
        require_solver()
    for recording in recordings:
        require_all(recording, arm, still)
    complete = [len(recording.joints) == len(arm.joint_names) for recording in recordings]
    if not any(complete):
        raise RecordingError(
            recordings[0].source,
            f"has {', '.join(recordings[0].joints)} only: expected a recording of all joints as "
            "well, to determine gravity and inertia",
        )
    reasons, warnings = list[str](), list[Note]()

    def decide(number: int, prepared: Prepared) -> Coordinates:
        report("coordinates", 0.0)
        decision = decide_coordinates(prepared, arm, coordinates[number])
        warnings.extend(decision.warnings)
        if not complete[number]:
            reasons.append(_partial(prepared.recording, arm, decision.coordinates, still))
        if reason := decision.reason:
            alone = sum(complete) == 1
            reasons.append(reason if alone else f"{prepared.recording.source}: {reason}")
        return decision.coordinates

    report("reading", 0.0)
    observed = observe(recordings, arm, fixed_positions=still, decide=decide)
    shown = next(each for each in observed if each.present.all()).coordinates
    columns: type[Columns] = Columns
    if for_file is not None:
        form = FORMS[for_file]
        columns, effects = form.columns, form.effects
        if form.of_bodies and physical is None:
            physical = True
    fit = fit_dynamic(observed, arm, shown, effects, physical, report, columns, least_gain)
    if shown == "actuator" and coordinates[complete.index(True)] is None:
        fit = replace(fit, model=replace(fit.model, detected_coordinates=shown))
    return replace(fit, handling=(*reasons, *fit.handling), warnings=(*warnings, *fit.warnings))


def _partial(
    recording: Recording, arm: Arm, coordinates: Coordinates, still: Mapping[str, float]
) -> str:
    others = ", ".join(
        f"{joint.name} {joint.shown(still[joint.name], 2)}"
        for joint in arm.joints
        if joint.name not in recording.joints
    )
    return (
        f"{recording.source}: {', '.join(recording.joints)} only, {coordinates} coordinates; the "
        f"others stood at {others}; errors are those of the recordings of all joints"
    )


def _validated(fit: Fit, recordings: Recordings) -> Fit:
    """Return the fit with the errors on recordings that it never saw."""
    result = evaluate(fit.model, recordings, fit.coordinates)
    fitted = np.concatenate([trace.measured for trace in fit.traces])
    errors = errors_of(result.traces, result.idle, fitted.mean(axis=0))
    names = ", ".join(recording.source for recording in recordings)
    verdict = judge(
        errors, fit.training, fit.holding, fit.model.arm, fit.coordinates,
        static=all_static(recordings), with_friction=result.with_friction, against=fit.against,
    )  # fmt: skip
    return replace(
        fit,
        model=replace(fit.model, verdict=verdict.level, reason=verdict.reason),
        verdict=verdict,
        held_out=errors,
        traces=result.traces,
        warnings=(*fit.warnings, *result.warnings),
        validation=f"recordings that neither fit nor choice of terms saw: {names}",
    )
