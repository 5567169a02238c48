"""What a diagnosis says in words, from the values that it found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from shlex import quote

import numpy as np

from dvrk_gravity import effects
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.filtered_data import FilteredData
from dvrk_gravity.diagnosis.data.motion import MeasuredMotion
from dvrk_gravity.diagnosis.inference.held_out import Gain, Unconfirmed
from dvrk_gravity.diagnosis.results.findings import Contender
from dvrk_gravity.effects import Estimate, Hypothesis, compared_with
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import labels
from dvrk_gravity.units import quantity

IDENTIFY_AGAIN = "identify the model again from this recording and its own"
DIAGNOSE_ALONE = "diagnose each recording alone"
RECORD_ALONE = (
    "if something was held for a while, record with it all the time; keep hands and cables off the "
    "arm"
)
SHARES_JOINT = "{} is found there, too: two causes of one joint may be one that has no name here"
GO_THERE = "identify from a recording that covers this range as well, then diagnose again"
USE_EXTENDED = "use the extended model, which has it"
DIFFERENT = "the recordings differ about it"
BESIDE_DIFFERENT = "found together with an average of recordings that differ"

FLOORS: Mapping[str, str] = {
    "repetition": "the difference between periods of the motion",
    "high_frequencies": "the noise at high frequencies",
    "nothing": "unknown",
}


def parameter_text(effect: str, name: str, estimate: Estimate) -> str:
    """Return an effect's parameter with unit and interval, its sign in words."""
    return effects.named(effect).meaning(name).in_words(estimate)


def effect_found(
    hypothesis: Hypothesis, parameters: Mapping[str, Estimate], gain: Gain, joints: Sequence[str],
    doubt: str = "",
) -> str:  # fmt: skip
    """Return an effect's claim, its size, and what it removes of the error.

    Args:
        hypothesis: The hypothesis.
        parameters: Its estimates by name.
        gain: Its gain on held-out data.
        joints: The joints of that gain, the largest first.
        doubt: Why it is uncertain in spite of its gain.
    """
    first, *others = joints
    where = f"{first} and {len(others)} more joints" if len(others) > 1 else " and ".join(joints)
    does, to = ("removes", "of") if gain.relative >= 0.0 else ("adds", "to")
    claim = hypothesis.claim(parameters)
    if (doubt or gain.low <= 0.0) and not hypothesis.hedges(parameters):
        claim = f"perhaps {claim}"
    removed = f"{does} {100 * abs(gain.relative):.0f} % {to} the error at {where}"
    what = "fitting them again with all findings" if hypothesis.refits_model else "correcting that"
    sentence = f"{claim}; {what} {removed}"
    if doubt:
        return f"{sentence} (not certain: {doubt})"
    if gain.low <= 0.0:
        interval = f"{100 * gain.low:.0f} to {100 * gain.high:.0f} %"
        return f"{sentence} (not certain: 95 % interval of what it removes {interval})"
    return sentence


def wrong_reading(words: str, removed: float, joint: str) -> str:
    """Return that a recording was read wrongly, and the part of the error that this explains."""
    return (
        f"The recording is read wrongly: {words}; corrected, {100 * removed:.0f} % of the error at "
        f"{joint} is gone"
    )


def unknown_error(joint: str, rms: str, ratio: float, least: str) -> str:
    """Return that a joint's error is larger than noise and unexplained."""
    return f"{joint} is off by {rms} RMS, {ratio:.2g} times {least}; no tested effect explains it"


def difference(subject: str, claims: Mapping[int, str], sources: Sequence[str]) -> str:
    """Return what each recording shows of a cause about which they differ; ``""`` is nothing."""
    shown = "; ".join(
        f"{labels(sources)[number]}: {claim or 'none of it'}" for number, claim in claims.items()
    )
    return f"recordings differ about {subject}: {shown}"


def alternative(gain: float, selected: float, how: str, apart: str = "") -> str:
    """Return why an effect may stand in place of the selected one, and what separates them."""
    why = f"{how}: log-likelihood gain {gain:.0f} against {selected:.0f} of the one found"
    return f"{why}; {apart}" if apart else why


def minor_effect(
    claim: str, negligible: bool, seen_before: bool, day_to_day: bool, friction: str,
    elsewhere: bool,
) -> str:  # fmt: skip
    """Return a significant effect and why it is no finding.

    Args:
        claim: What the effect claims.
        negligible: It is small beside the joint's torque.
        seen_before: The calibration recording shows it as well.
        day_to_day: It may be day-to-day friction variation.
        friction: The change of friction that it resembles; ``""`` if it is one itself.
        elsewhere: Other joints show such a variation.
    """
    why = "no larger than the model's error at calibration"
    if negligible:
        why = "negligible beside the joint's torque"
    if seen_before:
        claim = f"unmodelled torque looks as if {claim}"
        why = "already present in the calibration recording"
    if day_to_day:
        why = "within day-to-day friction variation"
        why += ", which other joints show as well" if elsewhere else ""
        claim = f"{friction}, which looks as if {claim}" if friction else claim
    return f"{claim}; significant, but {why}"


def not_significant(claim: str) -> str:
    """Return how large something is that is known to be there, and that nothing shows."""
    return f"{claim}; its torque is not significant"


def pushed_together(joints: Sequence[str]) -> str:
    """Return which joints are pushed at the same time as a finding's; ``""`` for none."""
    if not joints:
        return ""
    pushed = f"{' and '.join(joints)} {'is' if len(joints) == 1 else 'are'} pushed"
    return f"{pushed} at the same time, as by a load that was held for a while"


def leaves(joint: str, ratio: float) -> str:
    """Return that a cause leaves more of an error than noise and the model's own."""
    return f"it leaves {ratio:.2g} times the error at {joint} that noise and the model's own would"


def ambiguity(pair: str, overlap: float, contenders: Sequence[Contender], pose: str) -> str:
    """Return that two causes cannot be separated, their sizes, and a pose that separates them."""
    if any(contender.suspected for contender in contenders):
        sizes = " against ".join(map(_contender, contenders))
    else:
        gains = " and ".join(f"{contender.gain:+.0f}" for contender in contenders)
        clear = "clear " if any(contender.gain > 0.0 for contender in contenders) else ""
        sizes = f"no {clear}sign of either (log-likelihood {gains} on unseen blocks)"
    return (
        f"{pair} cannot be separated here: the second reproduces {100 * overlap:.0f} % of the "
        f"torque of the first; {sizes}; {pose}"
    )


def separating_command(findings: str, poses: bool) -> str:
    """Return the command that plans the motion, or the poses, that separate causes."""
    plan = Path(findings).parent / "separate.yaml"
    how = " --poses" if poses else ""
    return f"dvrk_gravity plan --separate {quote(findings)}{how} --out {quote(str(plan))}"


def _contender(contender: Contender) -> str:
    alone, together = (
        ", ".join(
            f"{name} {parameter_text(contender.effect, name, value)}"
            for name, value in values.items()
        )
        for values in (contender.alone, contender.combined)
    )
    removed = round(100 * contender.removed, 1) + 0.0
    return (
        f"{alone} alone ({together} with both; log-likelihood {contender.gain:+.0f} on unseen "
        f"blocks, {removed:.1f} % of the held-out error at {contender.at})"
    )


def payload(
    found: str, known: float, scale: Estimate | None, gain: str, against_reference: bool
) -> str:
    """Return how the payload found compares with the known mass.

    Args:
        found: The mass found, with its interval; ``""`` if none was.
        known: The known mass, kg.
        scale: Mass found over known mass; ``None`` where efforts are not in N·m.
        gain: N·m per unit of effort in that case.
        against_reference: Two recordings were compared.
    """
    if not found:
        return f"no payload was found; expected {quantity(known, 'kg')}"
    if scale is None:
        return (
            f"{found} are {quantity(known, 'kg')} if one unit of effort is {gain} N·m at every "
            "joint: `identify --known-payload` finds each joint's gain"
        )
    if scale.low <= 1.0 <= scale.high:
        verdict = (
            f"the torque scale agrees within its uncertainty, {100 * scale.low:.0f} to "
            f"{100 * scale.high:.0f} %"
        )
    else:
        off = scale.percent(1.0).signed(("too high", "too low"))
        other = " or more changed between the recordings" if against_reference else ""
        verdict = (
            f"efforts read {off}, or the mass is different{other}: check torque constants, gear "
            "ratios and current scales"
        )
    return f"found {found}, expected {quantity(known, 'kg')}: {verdict}"


def within_uncertainty(joint: str, moved: str, most: str, source: str, within: bool) -> str:
    """Return how much of a joint's error the model's own uncertainty explains, at 95 % at most."""
    how = "explained by" if within else "absorbed by the model's parameters, beyond"
    whose = "the uncertainty of the model's parameters" if within else "their uncertainty"
    return f"{moved} RMS at {joint} {how} {whose} (up to {most} RMS from its {source})"


def remaining_error(joint: str, rms: str, expected: str, times: float, least: float) -> str:
    """Return a joint's remaining error beside the one that the model expects of itself.

    Args:
        joint: The joint's name.
        rms: The error.
        expected: The one expected, as in the table of errors.
        times: The first over the second.
        least: From which multiple on an error is a finding.
    """
    small = f", and less than {least:g} times that is no finding by itself"
    return (
        f"{joint}: {rms} RMS remain; the model expects {expected}"
        f"{small if 1.0 < times < least else ''}"
    )


def day_to_day_difference(joint: str, rms: str) -> str:
    """Return what two recordings differ by without a cause worth reporting."""
    return f"{joint}: {rms} RMS of friction, springs or timing"


def slower_compensation(ratio: float | None) -> str:
    """Return what to do about friction that decreased, with the largest safe ratio if any."""
    again = "identify again with the arm as warm as in use"
    if ratio is None:
        return again
    return (
        f"{again}; until then friction_compensation.ratio {ratio:.2f} at most, since more would "
        "drive the arm"
    )


def nothing_found(
    against_reference: bool, friction: str, minor: Sequence[str], ratio: Mapping[str, float],
    least: str, known: Sequence[str], unexpected: float | None,
) -> str:  # fmt: skip
    """Return that nothing was found, and what error remains.

    Args:
        against_reference: Two recordings were compared.
        friction: Change of friction since calibration; ``""`` for none.
        minor: Other effects that are significant, and why each is no finding.
        ratio: By joint, remaining error over what is expected.
        least: What is expected, in words.
        known: Joints where known causes act.
        unexpected: Ratio that is more than it should be; ``None`` if nothing is.
    """
    but = f" but day-to-day friction variation: {friction}" if friction else ""
    also = f". Not certain enough for a finding: {'; '.join(minor)}" if minor else ""
    nothing = f"Nothing was found that {compared_with(against_reference)} lacks{but}{also}"
    if not ratio:
        return f"{nothing}."
    most = max(ratio, key=lambda name: ratio[name])
    beside = ", known causes included" if most in known else ""
    sentence = (
        f"{nothing}{'. The' if but or also else '; the'} remaining error is at most "
        f"{ratio[most]:.2g} times {least} ({most}{beside})."
    )
    if unexpected is None or ratio[most] <= unexpected:
        return sentence
    return (
        f"{sentence} That is more than it should be, and no hypothesis explains it with certainty: "
        f"record longer, with more motion of {most}, and once {most} alone."
    )


def rejected(unconfirmed: Unconfirmed) -> str:
    """Return why an effect that explains the data best is no finding."""
    joint, gain = unconfirmed.joint, unconfirmed.gain
    if gain is None:
        why = "it hardly acts in the held-out blocks that could confirm it"
    elif unconfirmed.partial:
        why = "part of what it implies is absent"
    else:
        why = (
            f"not confirmed on held-out blocks, where it removes {100 * gain.relative:.0f} % of "
            f"the error at {joint} (95 %: {100 * gain.low:.0f} to {100 * gain.high:.0f})"
        )
    return f"rejected: {unconfirmed.hypothesis}: {why}"


def left_out(hypothesis: Hypothesis, why: str) -> str:
    """Return why the extended model lacks an effect."""
    return f"left out of the extended model: {hypothesis}: {why}"


def larger_errors(joints: Sequence[str]) -> str:
    """Return that findings make errors larger."""
    return f"the findings do not explain everything: they increase the error at {', '.join(joints)}"


def extrapolated(outside: Sequence[str]) -> list[str]:
    """Return where joints are outside the identified range, and what that means."""
    return [f"{line}: the model extrapolates there, and is uncertain" for line in outside]


def why_exact(model: TorqueModel) -> str:
    """Return why a model is taken as exact; ``""`` if it states its uncertainty."""
    if model.uncertainty is not None:
        return ""
    return model.why_no_uncertainty or "it states no uncertainty"


def unfit_model(model: TorqueModel) -> str:
    """Return that a model's own verdict forbids to rely on it."""
    why = f" ({model.reason})" if model.reason else ""
    return f"the model's own verdict is {model.verdict.replace('_', ' ')}{why}: identify it again"


def error_far_below(ratio: float, least: float) -> str:
    """Return that the error is so many times the one predicted, far less than it should be."""
    return (
        f"the error is {ratio:.2g} times what the model's uncertainty predicts, expected at least "
        f"{least:g}: that uncertainty is not this model's, or far too large; identify again"
    )


def unseen_friction(joint: str, size: float, limit: float, unit: str, others: int) -> str:
    """Return how much friction would have been missed at a joint, and at how many others."""
    smallest = f"below {quantity(size, unit)}" if np.isfinite(size) else "of any size"
    more = f", likewise at {others} more" if others else ""
    return (
        f"friction {smallest} would have been missed at {joint}, expected at most "
        f"{quantity(limit, unit)}{more}: record more motion, or identify a better model"
    )


def cannot_judge(reasons: Sequence[str]) -> str:
    """Return that nothing found says nothing, and why."""
    return f"Nothing was found, which says little: {'; '.join(reasons)}."


def method_notes(motion: MeasuredMotion, data: FilteredData, floor: Array) -> list[str]:
    """Return how recordings were prepared and hypotheses judged, a sentence each.

    Args:
        motion: The motion as it was finally read.
        data: What was compared.
        floor: (n,) noise, N·m.
    """
    blocks = data.settings.blocks
    notes = [
        *motion.processing_log,
        f"{data.count} blocks, one in {blocks.held_out} held out of fit and model selection; the "
        f"others in {blocks.folds} folds for cross-validation",
    ]
    if data.repetition is not None:
        notes.append(
            f"the motion repeats every {data.repetition.period:.4g} s, {data.copies:.3g} times: a "
            "block is one phase of every period"
        )
    notes.append(f"noise floor: {FLOORS[data.noise_source(floor)]}")
    notes.append(_certainty(data))
    if data.band is None:
        return notes
    notes.append(f"torques and hypotheses compared below {data.band:g} Hz, zero-phase")
    names = np.array(motion.arm.joint_names)
    stuck = np.where(motion.stands, 0.0, motion.stuck.mean(axis=0))
    return notes + [
        f"{name} stands still {100 * part:.0f} % of the time: those samples are left out"
        for name, part in zip(names, stuck, strict=True)
        if part > 0.05
    ]


def stands_still(joints: Sequence[str]) -> str:
    """Return that joints never move, and what their efforts show then."""
    return (
        f"not judged: efforts of {', '.join(joints)}, which never move: friction may hold any "
        "torque up to its level"
    )


def _certainty(data: FilteredData) -> str:
    """Return how certain the model was taken to be."""
    model = data.motion.model
    if not data.expectation.predicts:
        return "the reference's efforts at the same phase were used in place of a model's torques"
    if model.uncertainty is None:
        why = f" ({model.why_no_uncertainty})" if model.why_no_uncertainty else ""
        return (
            f"the model states no uncertainty{why}: its parameters were taken as exact and, where "
            "much error remained, as free as links plausibly weigh (their prior in "
            "docs/judgement.md)"
        )
    return (
        f"the model's parameters were free in {model.uncertainty.size} directions within their "
        "posterior, and its error at calibration counted as noise"
    )
