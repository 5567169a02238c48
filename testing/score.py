"""What a diagnosis made of what was hidden, counted."""

from __future__ import annotations

import time
import traceback
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.diagnosis import Diagnosis, diagnose
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from testing.hidden_parts import Hidden

CLOSE = 0.2  # of a value, that an estimate may be off
RATIOS = (0.0, 2.0, 5.0, np.inf)  # of what is hidden to what the model leaves
WHOLE_ARM = ("base_tilt", "time_delay")
OUTSIDE = 0.2  # of the time: from here on a recording is not one of what the model was made for


@dataclass(frozen=True)
class Equivalence:
    """Two names for what is the same torque, or all but the same, of one joint or its link.

    Attributes:
        hidden: What was hidden.
        named: What it may be called.
        why: The physics.
        ends: At the first and the last joint only.
    """

    hidden: str
    named: str
    why: str
    ends: bool = False


_AXIS = "about the first axis a link's inertia is the rotor's exactly, about the last all but"
EQUIVALENT = (
    Equivalence("payload", "link_com",
                "a mass on a link turns about its joint by its first moment alone: what it adds to "
                "the joints before is some per cent of what they carry"),
    Equivalence("link_com", "payload",
                "a first moment is a mass at a place; how great a mass, only joints before feel"),
    Equivalence("torque_offset", "elastic_cable",
                "a constant is the constant part of an elastic torque"),
    Equivalence("rotor_inertia", "link_inertia", _AXIS, ends=True),
    Equivalence("link_inertia", "rotor_inertia", _AXIS, ends=True),
)  # fmt: skip
"""All that counts as right beside the effect's own name."""


@dataclass
class Outcome:
    """One trial.

    Attributes:
        engine: Where the recording comes from.
        arm: Which arm.
        seed: Of arm and motions.
        effect: What was hidden.
        joints: Where.
        ratio: How large, in units of what the identified model leaves.
        outside: Part of the time that a joint where it acts is where the model was not identified.
        verdict: Of the diagnosis.
        found: Effect and joints of every finding, in order.
        certain: Of each, whether it was told without `perhaps`.
        place: ``first``, ``alternative``, ``later``, ``wrong``, ``known`` (told as no news, where
            there is no finding), ``missed``; of a clean recording ``silent`` or ``alarm``.
        further: Findings beside the one that is right.
        errors: Relative error of each parameter that was hidden and estimated.
        inside: Whether the true one lies within its 95 % interval.
        seconds: Of the diagnosis.
        failure: Traceback, if it failed.
    """

    engine: str
    arm: str
    seed: int
    effect: str
    joints: list[str] = field(default_factory=list)
    ratio: float = 0.0
    outside: float = 0.0
    verdict: str = ""
    found: list[str] = field(default_factory=list)
    certain: list[bool] = field(default_factory=list)
    place: str = ""
    further: int = 0
    errors: dict[str, float] = field(default_factory=dict)
    inside: dict[str, bool] = field(default_factory=dict)
    seconds: float = 0.0
    failure: str = ""

    def __str__(self) -> str:
        """Give it on one line."""
        if self.failure:
            why = self.failure.splitlines()[-1]
            return f"{self.engine} {self.arm} {self.seed} {self.effect}: failed: {why}"
        where = ", ".join(self.joints)
        found = "; ".join(
            name + ("" if sure else " (perhaps)")
            for name, sure in zip(self.found, self.certain, strict=True)
        )
        away = f", {100 * self.outside:.0f} % outside" if self.outside >= OUTSIDE else ""
        return (
            f"{self.engine} {self.arm} {self.seed}: {self.effect}{' ' + where if where else ''} "
            f"x{self.ratio:.1f}{away} -> {self.place}: {found or 'nothing'}  [{self.seconds:.1f} s]"
        )


def run_trial(
    outcome: Outcome,
    make: Callable[[], tuple[Recording, Hidden, float]],
    model: TorqueModel,
    reference: Recording | None = None,
) -> Outcome:
    """Record, diagnose, compare; a trial that fails says so.

    Args:
        outcome: What is known of it before.
        make: The recording, what is hidden in it, and how large.
        model: The identified model; beside a reference one of the arm.
        reference: The same motion without it, to diagnose against in the place of the model.
    """
    try:
        recording, hidden, outcome.ratio = make()
        outcome.outside = outside(recording, hidden, model)
        start = time.monotonic()
        diagnosis = (
            diagnose(recording, model)
            if reference is None
            else diagnose(recording, arm=model.arm, reference=reference)
        )
        outcome.seconds = time.monotonic() - start
        compare(outcome, hidden, diagnosis, model.arm)
    except Exception:
        outcome.failure = traceback.format_exc(limit=4)
    return outcome


def outside(recording: Recording, hidden: Hidden, model: TorqueModel) -> float:
    """Return the greatest part of the time that a joint is where the model was not identified.

    Of the joints where something is hidden; of all, if that is the arm as a whole or nothing.
    """
    known = model.uncertainty
    if known is None:
        return 0.0
    q = recording.position
    if recording.coordinates == "actuator":
        q = model.arm.joint_position(q)
    beyond = np.mean((q < known.lower) | (q > known.upper), axis=0)
    joints = [model.arm.joint_names.index(name) for name in hidden.joints]
    return float(np.max(beyond[joints] if joints else beyond))


def compare(outcome: Outcome, hidden: Hidden, diagnosis: Diagnosis, arm: Arm) -> None:
    """Fill in what the diagnosis made of it."""
    findings = diagnosis.findings
    outcome.joints, outcome.verdict = list(hidden.joints), diagnosis.verdict
    outcome.found = [" ".join((f.effect, ", ".join(f.joints))).strip() for f in findings]
    outcome.certain = [f.certain for f in findings]
    if hidden.effect == "nothing":
        outcome.place = "alarm" if findings else "silent"
        outcome.further = len(findings)
        return
    right = [fits(hidden, f.effect, f.joints, arm) for f in findings]
    listed = [
        any(fits(hidden, other.effect, other.joints, arm) for other in f.alternatives)
        for f in findings
    ]
    if right[:1] == [True]:
        outcome.place = "first"
    elif any(listed):
        outcome.place = "alternative"
    elif any(right):
        outcome.place = "later"
    elif findings:
        outcome.place = "wrong"
    else:
        no_news = any(fits(hidden, each.effect, each.joints, arm) for each in diagnosis.known)
        outcome.place = "known" if no_news else "missed"
    outcome.further = len(findings) - (any(right) or any(listed))
    own = [f for f, fit in zip(findings, right, strict=True) if fit and f.effect == hidden.effect]
    if not own:
        return
    for name, truth in hidden.parameters.items():
        estimate = own[0].parameters.get(name)
        if estimate is not None and name != "phase":
            outcome.errors[name] = abs(estimate.value - truth) / _size(hidden, name)
            outcome.inside[name] = estimate.low <= truth <= estimate.high


def fits(hidden: Hidden, effect: str, joints: Sequence[str], arm: Arm) -> bool:
    """Tell whether a finding, or an alternative of one, is what was hidden."""
    if effect == hidden.effect:
        if effect in WHOLE_ARM:
            return True
        if effect == "joint_coupling":  # a leak is between two, whichever is called first
            return set(joints) == set(hidden.joints)
        return tuple(joints[:1]) == hidden.joints[:1]
    at_end = hidden.joints[:1] in (arm.joint_names[:1], arm.joint_names[-1:])
    return any(
        (equivalence.hidden, equivalence.named) == (hidden.effect, effect)
        and tuple(joints[:1]) == hidden.joints[:1]
        and (at_end or not equivalence.ends)
        for equivalence in EQUIVALENT
    )


def _size(hidden: Hidden, name: str) -> float:
    """Return by what an error is divided: of a vector's part, the vector's length."""
    for parts in (("roll", "pitch"), tuple(f"first_moment_{axis}" for axis in "xyz")):
        if name in parts:
            return float(np.linalg.norm([hidden.parameters[part] for part in parts]))
    return max(abs(hidden.parameters[name]), 1e-12)


def report(title: str, outcomes: Sequence[Outcome], identified: Mapping[str, float]) -> str:
    """Return the table of some trials, and its summary in the last line.

    Args:
        title: Of the table.
        outcomes: The trials.
        identified: Seconds that each identification took.
    """
    good = [outcome for outcome in outcomes if not outcome.failure]
    hidden = [outcome for outcome in good if outcome.effect != "nothing"]
    clean = [outcome for outcome in good if outcome.effect == "nothing"]
    lines = [
        f"{title}: what was hidden, and where it is named",
        f"  {'':<22} {'n':>3} {'first':>6} {'+alt.':>6} {'later':>6} {'wrong':>6} {'known':>6} "
        f"{'missed':>6} {'further':>8} {'values':>8} {'in ci95':>8}   "
        "first or alternative by size " + " / ".join(_band(i) for i in range(3)),
    ]
    for effect in dict.fromkeys(outcome.effect for outcome in hidden):
        lines.append(_row(effect, [outcome for outcome in hidden if outcome.effect == effect]))
    lines.append(_row("all", hidden))
    lines += _by_arm(hidden, clean)
    for name, inside in (("within the range", True), ("elsewhere", False)):
        lines.append(
            _beside_clean(
                name,
                [outcome for outcome in hidden if (outcome.outside < OUTSIDE) == inside],
                [outcome for outcome in clean if (outcome.outside < OUTSIDE) == inside],
            )
        )
    alarms = [outcome for outcome in clean if outcome.found]
    named = [
        outcome
        for outcome in clean
        if any(not name.startswith("unknown") for name in outcome.found)
    ]
    wrongly = Counter(name for outcome in alarms for name in outcome.found)
    failed = [outcome for outcome in outcomes if outcome.failure]
    seconds = [outcome.seconds for outcome in good] or [0.0]
    lines.append(
        f"  certain of a wrong cause: {part(sum(map(_surely_wrong, hidden)), len(hidden))}"
    )
    lines += [f"  false: {name}, {count} times" for name, count in wrongly.most_common()]
    lines += [f"  failed: {outcome}" for outcome in failed[:3]]
    known = [outcome for outcome in hidden if outcome.ratio >= RATIOS[1]]
    lines.append(
        f"{title}: false alarms {part(len(alarms), len(clean))} clean recordings "
        f"(with a name {len(named)}, certain {sum(any(outcome.certain) for outcome in clean)}), "
        f"named first {part(_count(hidden, 'first'), len(hidden))}, "
        f"or listed {part(_count(hidden, 'first', 'alternative'), len(hidden))}; "
        f"of those above twice the residual {part(_count(known, 'first'), len(known))}, "
        f"{part(_count(known, 'first', 'alternative'), len(known))}; "
        f"further findings {_mean([outcome.further for outcome in hidden]):.2f} a recording; "
        f"values {_values(hidden)}, in ci95 {_inside(hidden)}; "
        f"failed {len(failed)}; median s: identify {_median(list(identified.values())):.1f}, "
        f"diagnose {_median(seconds):.1f}"
    )
    return "\n".join(lines)


def _by_arm(hidden: Sequence[Outcome], clean: Sequence[Outcome]) -> list[str]:
    """Return a row an arm, where there are several."""
    arms = list(dict.fromkeys(outcome.arm for outcome in hidden))
    if len(arms) < 2:
        return []
    return [
        _beside_clean(
            f"all of {arm}",
            [outcome for outcome in hidden if outcome.arm == arm],
            [outcome for outcome in clean if outcome.arm == arm],
        )
        for arm in arms
    ]


def _beside_clean(name: str, rows: Sequence[Outcome], clean: Sequence[Outcome]) -> str:
    alarms = sum(bool(outcome.found) for outcome in clean)
    return f"{_row(name, rows)}; false alarms {alarms} of {len(clean)} clean"


def _band(number: int) -> str:
    low, high = RATIOS[number], RATIOS[number + 1]
    if low == 0.0:
        return f"<{high:g}"
    return f">{low:g}" if np.isinf(high) else f"{low:g}-{high:g}"


def _row(name: str, rows: Sequence[Outcome]) -> str:
    counts = [
        _count(rows, place)
        for place in ("first", "alternative", "later", "wrong", "known", "missed")
    ]
    counts[1] += counts[0]
    bands = []
    for low, high in pairwise(RATIOS):
        these = [outcome for outcome in rows if low <= outcome.ratio < high]
        bands.append(f"{_count(these, 'first', 'alternative')}/{len(these)}" if these else "-")
    return (
        f"  {name:<22} {len(rows):3d} " + " ".join(f"{count:6d}" for count in counts)
        + f" {_mean([outcome.further for outcome in rows]):8.2f} {_values(rows):>8}"
        + f" {_inside(rows):>8}   "
        + " / ".join(bands)
    )  # fmt: skip


def _surely_wrong(outcome: Outcome) -> bool:
    """Whether a name was given for certain, and neither it nor an alternative is right."""
    sure = (
        certain and not name.startswith("unknown")
        for name, certain in zip(outcome.found, outcome.certain, strict=True)
    )
    return outcome.place == "wrong" and any(sure)


def _count(rows: Sequence[Outcome], *places: str) -> int:
    return sum(outcome.place in places for outcome in rows)


def _values(rows: Sequence[Outcome]) -> str:
    held = [
        error < CLOSE or outcome.inside[name]
        for outcome in rows
        for name, error in outcome.errors.items()
    ]
    return f"{sum(held)}/{len(held)}"


def _inside(rows: Sequence[Outcome]) -> str:
    held = [value for outcome in rows for value in outcome.inside.values()]
    return f"{sum(held)}/{len(held)}"


def part(count: int, total: int) -> str:
    """Return a count of a total, in per cent too."""
    return f"{count} of {total}" + (f" ({100 * count / total:.0f} %)" if total else "")


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else 0.0


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else float("nan")
