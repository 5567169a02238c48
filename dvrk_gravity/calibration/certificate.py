"""The certificate: one value from the files that a calibration left."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from dvrk_gravity.arms import Arm, Joint
from dvrk_gravity.calibration.settings import CalibrationSettings
from dvrk_gravity.calibration.tally import MotionTally
from dvrk_gravity.effects import is_friction
from dvrk_gravity.identification import POOR
from dvrk_gravity.units import fixed, quantity

FORMAT = 1
_UNCERTAIN = 0.5  # half of an interval over its value, from which friction is uncertain. Chosen
_MANY = 4  # names in a sentence


@dataclass(frozen=True)
class JointCertificate:
    """What is certified of one joint.

    Attributes:
        name: Of the joint.
        unit: Of its efforts.
        position_unit: Of its positions.
        rmse: Held-out RMS error, N·m or N.
        expected: 95 % band of that by the model itself; ``None``: not known.
        nrmse: |e| / |tau|.
        level: Verdict on it, one of ``model.VERDICTS``.
        holding: Standard error of the gravity torque at the recorded poses, N·m or N; ``None``:
            not known.
        friction: Dry friction and its 95 % interval, N·m or N; ``None``: none is fitted.
        lower: Least position that was identified, rad or m.
        upper: Greatest one.
        drift: Largest drift at any pose, rad or m; ``None``: not tested.
        sure: Part of random poses at which a part of its friction is sure to hold it; ``None``:
            not known, of a model that is unfit.
    """

    name: str
    unit: str
    position_unit: str
    rmse: float
    expected: tuple[float, float] | None
    nrmse: float
    level: str
    holding: float | None
    friction: tuple[float, float, float] | None
    lower: float
    upper: float
    drift: float | None
    sure: float | None


@dataclass(frozen=True)
class Certificate:
    """A calibration on one page.

    Attributes:
        arm: Name of the arm.
        namespace: Of its topics.
        simulated: What was simulated; ``""``: nothing.
        date: When it was made, UTC.
        versions: Of software, by name.
        reasons: Why it is not certified; empty: it is.
        verdict: In one sentence.
        joints: By joint.
        poses: Number of poses at which the arm was released.
        apart: Least distance of one from a fitted sample, rad.
        seconds: Duration of each release.
        friction: Part of its friction that the arm had meanwhile.
        held: Number of those at which no joint drifted by more than is allowed.
        allowed: That drift, rad (a tenth of it, m).
        reduced: Part of the friction with which joints are sure to be held.
        motion: How the arm was moved.
        findings: What the diagnosis of the held-out motion found.
        unknown: What stays unknown, a sentence each.
        files: SHA-256 by file.
        model: The model's file.
    """

    arm: str
    namespace: str
    simulated: str
    date: str
    versions: Mapping[str, str]
    reasons: tuple[str, ...]
    verdict: str
    joints: tuple[JointCertificate, ...]
    poses: int
    apart: float
    seconds: float
    friction: float
    held: int
    allowed: float
    reduced: float
    motion: MotionTally
    findings: tuple[str, ...]
    unknown: tuple[str, ...]
    files: Mapping[str, str]
    model: str

    @property
    def certified(self) -> bool:
        """Whether the arm may be compensated with the model."""
        return not self.reasons

    def to_json(self) -> str:
        """Return certificate.json's text."""
        content = {"format": FORMAT, "certified": self.certified, **asdict(self)}
        return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def certify(
    arm: Arm,
    settings: CalibrationSettings,
    fit: Mapping[str, Any],
    check: Mapping[str, Any],
    release: Mapping[str, Any],
    diagnosis: Mapping[str, Any],
    motion: MotionTally,
    **known: Any,
) -> Certificate:
    """Return the certificate of what was found.

    Args:
        arm: The arm.
        settings: What is required.
        fit: Content of the model's .json.
        check: That of check.json.
        release: That of release.json.
        diagnosis: That of the last diagnosis's .json.
        motion: How it was moved.
        known: The other attributes of :class:`Certificate`.
    """
    joints = tuple(_joint(arm, k, fit, check, release) for k in range(arm.n))
    worst = _worst_drifts(arm, release)
    held = sum(each <= settings.max_drift for each in worst)
    reasons = _reasons(arm, settings, fit, joints, worst, release, motion)
    # Where an earlier version diagnosed, it did not write which are suspected.
    suspected = [each for each in diagnosis["ambiguities"] if each.get("suspected", True)]
    unknown = (
        *_uncertain_frictions(joints), *_unexpected_errors(joints),
        *_low_friction_reasons(settings, joints),
        *(each["sentence"] for each in diagnosis["ambiguities"] if each not in suspected),
        *fit["identifiability"]["statements"], *check["outside"],
        *([] if release["poses"] else [release["why"]]),
    )  # fmt: skip
    findings = tuple(
        f"{each['sentence']}" + ("" if each["certainty"] == "certain" else " (perhaps)")
        for each in diagnosis["findings"]
    ) + tuple(each["sentence"] for each in suspected)
    verdict = _verdict(arm, known["simulated"], joints, worst, release, reasons)
    return Certificate(
        arm=arm.name, reasons=reasons, verdict=verdict, joints=joints, poses=len(worst),
        apart=release["apart"], seconds=settings.release_duration, friction=release["friction"],
        held=held,
        allowed=settings.max_drift, reduced=settings.friction, motion=motion, findings=findings,
        unknown=tuple(dict.fromkeys(unknown)), **known,
    )  # fmt: skip


def _joint(
    arm: Arm, k: int, fit: Mapping[str, Any], check: Mapping[str, Any], release: Mapping[str, Any]
) -> JointCertificate:
    name, joint = arm.joint_names[k], arm.joints[k]
    error, holding = check["joints"][name], fit["holding"][name]
    band = error["expected"]
    drift = max((pose[k] for pose in release["drift"]), default=None)
    return JointCertificate(
        name, joint.effort_unit, joint.unit, error["rmse"],
        None if band is None else (band["ci95"][0], band["ci95"][1]),
        error["nrmse"], check["levels"][name],
        holding["error"] if math.isfinite(holding["error"]) else None, _friction(fit, joint),
        holding["lower"], holding["upper"], drift,
        fit["held"]["joints"].get(name),
    )  # fmt: skip


def _friction(fit: Mapping[str, Any], joint: Joint) -> tuple[float, float, float] | None:
    """Return a joint's dry friction and its interval, or that of the motor of its number."""
    found = [
        (each["value"], *each["ci95"])
        for each in fit["parameters"]
        if is_friction(each["name"].partition(".")[0])
        and each["unit"] == joint.effort_unit
        and each["name"].endswith(f"[{joint.name}]")
    ]
    known = [each for each in found if all(map(math.isfinite, each))]
    return max(known, key=lambda each: abs(each[0]), default=None)


def _worst_drifts(arm: Arm, release: Mapping[str, Any]) -> list[float]:
    """Return the largest drift at each pose, rad (``Arm.scale``)."""
    return [float(np.max(np.array(pose) / arm.scale)) for pose in release["drift"]]


def _reasons(
    arm: Arm, settings: CalibrationSettings, fit: Mapping[str, Any],
    joints: Sequence[JointCertificate], worst: Sequence[float], release: Mapping[str, Any],
    motion: MotionTally,
) -> tuple[str, ...]:  # fmt: skip
    found = []
    if fit["verdict"]["overall"] == POOR:
        found.append(f"the model is unfit to compensate with: {fit['verdict']['reason']}")
    poor = [each for each in joints if each.level == POOR]
    if poor:
        errors = ", ".join(f"{each.name} {100 * each.nrmse:.0f} %" for each in poor[:_MANY])
        found.append(f"errors on the held-out motion are too large: {errors}")
    away = [k for k, each in enumerate(worst) if not each <= settings.max_drift]
    if away:
        k = max(away, key=lambda pose: worst[pose])
        ways = [way / size for way, size in zip(release["drift"][k], arm.scale, strict=True)]
        joint = max(range(arm.n), key=lambda j: ways[j])
        most = format_drift(release["drift"][k][joint], arm.units[joint])
        found.append(
            f"at {len(away)} of {len(worst)} poses it drifted by more than "
            f"{math.degrees(settings.max_drift):g} deg, at most {most} ({arm.joint_names[joint]})"
        )
    elif len(worst) < settings.poses and fit["verdict"]["overall"] != POOR:
        why = f" ({release['why']})" if release["why"] else ""
        found.append(f"it was released at {len(worst)} of {settings.poses} poses{why}")
    if motion.seconds > settings.max_duration:
        found.append(
            f"it moved for {motion.seconds / 60:.1f} min, of {settings.max_duration / 60:g}"
        )
    return tuple(found)


def _verdict(
    arm: Arm, simulated: str, joints: Sequence[JointCertificate], worst: Sequence[float],
    release: Mapping[str, Any], reasons: Sequence[str],
) -> str:  # fmt: skip
    name = f"{'simulated ' if simulated else ''}{arm.name.upper()}"
    if reasons:
        return f"{name} is not certified: {'; '.join(reasons)}"
    errors = sorted(100 * each.nrmse for each in joints)
    most = max((each.drift or 0.0) / size for each, size in zip(joints, arm.scale, strict=True))
    with_friction = (
        ""
        if release["friction"] == 1.0
        else f" with {100 * release['friction']:g} % of its friction"
    )
    text = (
        f"{name} holds itself: at {len(worst)} poses that nothing was fitted on it drifted by "
        f"{largest_drift(most)} in {release['seconds']:g} s{with_friction}; held-out error "
        f"{errors[0]:.1f} to {errors[-1]:.0f} % by joint"
    )
    uncertain = [each.name for each in joints if _is_uncertain(each)]
    if uncertain:
        listed = ", ".join(uncertain[:_MANY]) + (", …" if len(uncertain) > _MANY else "")
        text += f"; friction of {listed} is uncertain"
    return text


def _unexpected_errors(joints: Sequence[JointCertificate]) -> list[str]:
    return [
        f"{joint.name}: the error on the second motion, {quantity(joint.rmse, joint.unit)}, is "
        f"more than the model expects (at most {quantity(joint.expected[1], joint.unit)}): it "
        "lacks something there"
        for joint in joints
        if joint.expected is not None and joint.rmse > joint.expected[1]
    ]


def _low_friction_reasons(
    settings: CalibrationSettings, joints: Sequence[JointCertificate]
) -> list[str]:
    return [
        f"{joint.name}: with {100 * settings.friction:g} % of its friction it is not sure to stay "
        f"at {100 * (1 - joint.sure):.1f} % of poses"
        for joint in joints
        if joint.sure is not None and joint.sure < 1.0
    ]


def format_drift(value: float, unit: str = "rad") -> str:
    """Return a drift, rad or m, in deg or mm, in hundredths: a fiftieth of what is allowed."""
    shown, name = (math.degrees(value), "deg") if unit == "rad" else (1e3 * value, "mm")
    return f"{fixed(shown, 2)} {name}"


def largest_drift(value: float) -> str:
    """Return the largest of some drifts, rad, as "at most …", or "< …" of hardly any."""
    # None that is measured is none that would show.
    shown = format_drift(value or math.ulp(0.0))
    return shown if shown.startswith("<") else f"at most {shown}"


def _is_uncertain(joint: JointCertificate) -> bool:
    if joint.friction is None:
        return True
    value, low, high = joint.friction
    return 0.5 * (high - low) > _UNCERTAIN * abs(value)


def _uncertain_frictions(joints: Sequence[JointCertificate]) -> list[str]:
    found = []
    for joint in filter(_is_uncertain, joints):
        if joint.friction is None:
            found.append(f"friction of {joint.name} is not determined")
            continue
        low, high = (quantity(each, joint.unit) for each in joint.friction[1:])
        found.append(f"friction of {joint.name} is uncertain: 95 % interval {low} to {high}")
    return found
