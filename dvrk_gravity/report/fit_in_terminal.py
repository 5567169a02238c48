"""Fits and evaluations as text for a terminal: a table, the verdict, and what to do next."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from math import isfinite, isnan

from dvrk_gravity.arms import Arm, Joint
from dvrk_gravity.identification import (
    GOOD,
    POOR,
    RULE,
    WEIGH,
    Constant,
    Evaluation,
    ExpectedError,
    Fit,
    JointError,
    JointVerdict,
    by_errors,
    constant_in_words,
    good_to,
    in_short,
    in_words,
    level_of,
    scale_in_words,
)
from dvrk_gravity.model import NO_VERDICT, VERDICTS, TorqueModel
from dvrk_gravity.observation import contradiction
from dvrk_gravity.recording import Coordinates
from dvrk_gravity.report.terminal import colorize, warning_lines, wrap
from dvrk_gravity.units import percent, quantity

FAR_ABOVE_NOISE = 3.0
"""Times the recording's noise from which on an error is said to be unmodelled. Chosen: an arm whose
effects are all among the terms is fitted to 1 to 2.5 times."""


def error_table(
    errors: Mapping[str, JointError],
    arm: Arm,
    verdicts: Mapping[str, JointVerdict],
    width: int | None = None,
    expected: Mapping[str, ExpectedError] | None = None,
) -> Iterator[str]:
    """Yield a table of errors by joint, with the bound that each is judged by.

    Beside every verdict stands its reason, unless it is good by the two numbers before it.

    Args:
        errors: By joint.
        arm: The arm.
        verdicts: By joint.
        width: Columns of the terminal, if there is one.
        expected: By joint, what a model expects of its RMSE; ``None``: without that column.
    """
    broad = 1 + max(map(len, errors))
    unit = arm.effort_units[0]
    head = f"RMSE {unit}"
    band = "" if expected is None else f"{'expected':>14}"
    noise = any(isfinite(error.floor) for error in errors.values())
    floor = f"{'noise':>8}" if noise else ""
    left = f"{'joint':<{broad}}{head:>9}{floor}{band}"
    yield f"{left}{'|e|/|tau|':>10}{'R2':>9}{'good to':>8}  verdict"
    said: dict[JointVerdict, str] = {}
    for joint in arm.joints:
        if joint.name not in errors:
            continue
        error, verdict = errors[joint.name], verdicts[joint.name]
        # Said only where it is not the table's.
        other = f" (RMSE in {joint.effort_unit})" if joint.effort_unit != unit else ""
        word = "do not compensate" if verdict.level == POOR else verdict.level
        floor = f"{error.floor:>8.4f}" if noise else ""
        row = (
            f"{joint.name:<{broad}}{error.rmse:>9.4f}{floor}{_band(expected, joint.name)}"
            f"{error.nrmse:>10.3f}{_in_column(error.r2):>9}{good_to(joint):>8.3f}  "
            f"{colorize(word, verdict.level, width)}{other}"
        )
        plain = verdict.level == GOOD == level_of(joint, error.nrmse)
        why = f"as {said[verdict]}" if verdict.reason and verdict in said else verdict.reason
        yield row if plain or not why else wrap(why, width, f"{row}: ")
        said.setdefault(verdict, joint.name)


def unmodelled_joints(
    errors: Mapping[str, JointError],
    verdicts: Mapping[str, JointVerdict],
    everywhere: bool = False,
) -> str:
    """Return for a person where errors are far above the recording's noise; ``""``: nowhere.

    Args:
        errors: By joint.
        verdicts: By joint.
        everywhere: At joints that are good, too: no arm's model has all of its effects.
    """
    far = [
        (name, error)
        for name, error in errors.items()
        if error.over_floor > FAR_ABOVE_NOISE and (everywhere or verdicts[name].level != GOOD)
    ]
    if not far:
        return ""
    which = ", ".join(f"{name} {error.over_floor:.2g}" for name, error in far)
    return (
        f"unmodelled: errors of more than {FAR_ABOVE_NOISE:g} times the recording's noise ({which} "
        "times): beside them `diagnose` does not see a cause that adds less"
    )


def _band(expected: Mapping[str, ExpectedError] | None, joint: str) -> str:
    """Return the 95 % band of an RMSE in fourteen characters; none without that column."""
    if expected is None:
        return ""
    found = expected.get(joint)
    return f"{'-' if found is None else f'{found.low:.4f}-{found.high:.4f}':>14}"


def _in_column(r2: float) -> str:
    """Return a coefficient of determination in eight characters or fewer, a space before it."""
    return f"{r2:.3f}" if r2 > -1000.0 else f"{r2:.1e}"


def fit_text(fit: Fit, verbose: bool = False, width: int | None = None) -> Iterator[str]:
    """Yield what a terminal shows of an identification.

    Args:
        fit: The result.
        verbose: All that the report says in words, too.
        width: Columns of the terminal, if there is one.
    """
    verdict = fit.verdict
    for line in verdict.findings:
        yield wrap(line, width)
    named = [name for name, joint in verdict.joints.items() if joint.level == verdict.level]
    of_joints = "" if verdict.level == GOOD or not named else f" ({', '.join(named)})"
    why = contradiction(fit.warnings)
    found = f": {why}" if why else of_joints
    yield wrap(found, width, f"verdict: {colorize(verdict.words, verdict.level, width)}")
    yield from error_table(fit.held_out, fit.model.arm, verdict.joints, width)
    beyond_noise = unmodelled_joints(fit.held_out, verdict.joints, verbose)
    said = (beyond_noise, *constant_lines(fit, verbose), weight_line(fit))
    yield from (wrap(line, width) for line in said if line)
    if verdict.record:
        yield wrap(f"record instead: {verdict.record}", width)
    warnings = [each for each in fit.warnings if str(each) not in verdict.findings]
    for line in warning_lines(warnings, verbose):
        yield wrap(line, width)
    if verbose:
        yield from (wrap(line, width) for line in _details(fit))


def constant_lines(fit: Fit, everywhere: bool = True) -> Iterator[str]:
    """Yield a line on the constant part of what holds the joints.

    Args:
        fit: The result.
        everywhere: Joints that dry friction holds against it, too.
    """
    shown = [
        f"{joint.name} {constant_in_words(found, joint)} ({_constant_source(found, joint)})"
        for joint in fit.model.arm.joints
        if (found := fit.constants.get(joint.name)) is not None and (found.moves or everywhere)
    ]
    if shown:
        yield (
            "constant torque, of a spring, a bias of the reading or a hand in the recording: "
            + ", ".join(shown)
        )


def _constant_source(found: Constant, joint: Joint) -> str:
    held = f"{percent(found.share)} of what holds it" if found.held else "all that holds it"
    most = f"{quantity(found.least, joint.effort_unit)} moves it"
    return f"{held}, {most}{f', stated: {found.settled}' if found.settled else ''}"


def weight_line(fit: Fit) -> str:
    """Return the weight that was found beside that of the arm's masses, and what of its scale."""
    scale = scale_in_words(fit.weights)
    if not fit.weights:
        return scale
    further = f"; {WEIGH}" if scale else ""
    units = dict(zip(fit.model.arm.joint_names, fit.model.arm.effort_units, strict=True))
    shown = ", ".join(
        f"{each.joint} {quantity(each.ratio * each.weight, units[each.joint])} of "
        f"{quantity(each.weight, units[each.joint])} ({each.ratio:.2g} ± {2 * each.error:.1g})"
        for each in fit.weights
    )
    whose = "the masses in the arm's file" if fit.weights[0].stated else "a plausible such arm"
    return f"weight found, of that of {whose}: {shown}{further}"


def _details(fit: Fit) -> Iterator[str]:
    yield f"{fit.samples} samples, held-out errors in {fit.coordinates} coordinates"
    yield f"rule: {RULE}"
    for line in fit.handling:
        yield f"data: {line}"
    yield f"held out: {fit.validation}"
    kept = [choice for choice in fit.choices if choice.kept]
    rejected = [choice for choice in fit.choices if not choice.kept]
    added = [choice for choice in kept if choice.added]
    yield "terms:"
    for choice in added:
        yield f"  {choice.term}: {choice.reason}"
    if len(kept) > len(added):
        yield f"  taken out again of what the search started with: {len(kept) - len(added)}"
    if rejected:
        yield f"  {len(rejected)} further changes were tried and do too little (all in the report)"
    found = fit.identifiability
    yield found.sentence
    for statement in found.statements:
        yield f"  {statement}"


def evaluation_text(
    result: Evaluation, model: TorqueModel, verbose: bool = False, width: int | None = None
) -> Iterator[str]:
    """Yield what a terminal shows of the evaluation of a model.

    Args:
        result: The result.
        model: The model.
        verbose: What was done with the recordings, too.
        width: Columns of the terminal, if there is one.
    """
    why = contradiction(result.warnings)
    if why:
        yield wrap(why, width)
    verdicts = by_errors(model.arm, result.joints, result.coordinates, result.with_friction)
    yield from error_table(
        result.joints, model.arm, verdicts, width, result.expected if result.expected else None
    )
    said = verdict_comparison(model, result.joints, result.coordinates, result.with_friction)
    yield wrap(said, width)
    if next_step := _next_step(result, verdicts, verbose):
        yield wrap(next_step, width)
    if result.outside and not verbose:
        more = len(result.outside) - 1
        yield wrap(
            "outside its range errors say little of a model: identify from recordings there, too "
            f"({result.outside[0]}{f'; {more} more' if more else ''})",
            width,
        )
    for line in warning_lines(result.warnings, verbose):
        yield wrap(line, width)
    if verbose:
        yield from (wrap(line, width) for line in _about_errors(result, model))


def _next_step(result: Evaluation, verdicts: Mapping[str, JointVerdict], verbose: bool) -> str:
    """Return the one thing to do about errors larger than expected; ``""``: nothing."""
    if above := _above(result):
        return f"larger than the model expects of itself: {above}: `diagnose` finds out why"
    if any(verdict.level == POOR for verdict in verdicts.values()):
        return "`diagnose` finds out why"
    return "" if verbose else unmodelled_joints(result.joints, verdicts)


def _about_errors(result: Evaluation, model: TorqueModel) -> Iterator[str]:
    """Yield what the figures of an evaluation mean, and what was done with the recordings."""
    yield f"{result.samples} samples, errors in {result.coordinates} coordinates"
    yield f"rule: {RULE}"
    yield result.metric
    if line := unmodelled_joints(result.joints, {}, everywhere=True):
        yield line
    yield expectation(result, model)
    if len(result.recordings) > 1:
        for label, joints in result.recordings.items():
            yield f"{label}: |e|/|tau| {in_short(joints)}"
    yield from (f"{line}: extrapolated there" for line in result.outside)
    yield from (f"data: {line}" for line in (result.detected, *result.handling) if line)


def _above(result: Evaluation) -> str:
    """Return the joints whose error is above its band, and how far."""
    ratios = {name: result.joints[name].rmse / band.high for name, band in result.expected.items()}
    return ", ".join(f"{name} {_times(ratio)}" for name, ratio in ratios.items() if ratio > 1.0)


def _times(ratio: float) -> str:
    """Return a ratio above one, with as many digits as show that it is."""
    return f"{ratio:.2g} times" if ratio >= 1.05 else f"{max(ratio, 1.01):.2f} times"


def expectation(result: Evaluation, model: TorqueModel) -> str:
    """Return what a model expects of itself, and where its errors are larger."""
    if not result.expected:
        return f"expected: the model does not know its error here ({_why_unknown(result, model)})"
    above = _above(result)
    larger = f"; above it: {above} (`diagnose` finds out why)" if above else ""
    return (
        "expected: 95 % band of the RMSE that the model expects of itself here, by the posterior "
        "of its parameters and its error on data that its fit had not seen; day-to-day friction "
        f"variation and positions outside its range are not in it{larger}"
    )


def _why_unknown(result: Evaluation, model: TorqueModel) -> str:
    """Return why a model does not know its error on what it was evaluated on, and what does."""
    known = model.uncertainty
    if model.of_file:
        return "it is what the arm's file states; `identify` fits a model that knows it"
    if known is None:
        return (
            model.why_no_uncertainty
            or "it states no uncertainty; `identify` writes a model with one"
        )
    if result.coordinates == "actuator" and not model.arm.direct_drive:
        return (
            "it is known in joint coordinates, these are errors at the motors; evaluate a "
            "recording in joint coordinates"
        )
    of_poses = isnan(known.band)
    if of_poses != (result.cutoff is None):
        kinds = ("trajectories", "static poses")
        here = kinds[not of_poses]
        return f"it is known for {kinds[of_poses]}, these are {here}; identify from {here}"
    if result.cutoff is not None and f"{known.band:.3g}" != f"{result.cutoff:.3g}":
        return (
            f"it is known below {known.band:.3g} Hz, these are errors below {result.cutoff:.3g} "
            "Hz; `identify` or `diagnose` again writes it for these"
        )
    return "its uncertainty states no error on held-out data; identify from a longer recording"


def verdict_comparison(
    model: TorqueModel,
    errors: Mapping[str, JointError],
    coordinates: Coordinates,
    with_friction: Collection[str] = (),
) -> str:
    """Return a line that compares errors on a recording with the verdict in a model's file.

    Arguments as of :func:`dvrk_gravity.identification.judge`.
    """
    alone = by_errors(model.arm, errors, coordinates, with_friction)
    levels = {name: verdict.level for name, verdict in alone.items()}
    found = max(levels.values(), key=VERDICTS.index)
    worst = [name for name, level in levels.items() if level == found]
    said = (
        "the model carries no verdict of identify"
        if model.verdict == NO_VERDICT
        else f"verdict in the model file: {in_words(model.verdict)}"
    )
    which = ", ".join(f"{name} {100 * errors[name].nrmse:.0f} %" for name in worst)
    rubs = any(name in with_friction for name in worst)
    held = ", friction included, which these poses do not separate" if rubs else ""
    why = "" if found == GOOD else f" ({which} of the torque{held})"
    return f"{said}; from these errors alone it would be: {in_words(found)}{why}"
