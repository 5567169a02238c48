"""What a monitor made of a flight, judged and counted."""

from __future__ import annotations

import time
import traceback
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from scipy.stats import chi2

from dvrk_gravity.arms import Arm
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Recording
from testing.flights import Flight
from testing.hidden_parts import Hidden
from testing.score import fits

IN_TIME = 10.0  # s of motion after a change, within which it is to be named
AROUND = (0.5, 1.0)  # s, by which a push may seem to begin earlier and end later
ANYWHERE = ("payload", "base_tilt")  # effects whose joint need not be right
NO_PUSH = ("half_friction", "link_com", "gripper")  # where all but a push is right
CLEAN = ("clean", "elsewhere")
PLACES = ("named", "alternative", "late", "unnamed", "push", "wrong", "missed")


class Cause(Protocol):
    """A cause that a monitor names."""

    @property
    def effect(self) -> str:
        """Name in the vocabulary; ``""``: none."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of joints."""


class Event(Cause, Protocol):
    """What a monitor reports."""

    @property
    def kind(self) -> str:
        """``push``, ``change``, ``drift`` or ``unexplained``."""

    @property
    def onset(self) -> float:
        """When it began, s."""

    @property
    def reported(self) -> float:
        """When that was known, s."""

    @property
    def end(self) -> float | None:
        """When it was over, s."""

    @property
    def certainty(self) -> str:
        """``certain`` or ``perhaps``."""

    @property
    def alternatives(self) -> Sequence[Cause]:
        """What explains it as well."""


class MonitorOutcome(Protocol):
    """What a monitor saw in a recording."""

    @property
    def events(self) -> Sequence[Event]:
        """In order of time."""

    @property
    def seconds(self) -> float:
        """Of motion that were looked at."""


Monitor = Callable[[Recording, TorqueModel], Any]
"""What is judged: from a recording and a model to :class:`MonitorOutcome`."""


@dataclass
class Verdict:
    """One flight, judged.

    Attributes:
        arm: Which arm.
        seed: Of the arm.
        number: Of the flight.
        scenario: What happened.
        effect: By its name in the vocabulary.
        joints: Where.
        onset: When, s.
        shown: How large, in units of what the model leaves, at the joint where that is most.
        place: ``named``: as a change, by effect and joint, in time, and no other change for
            certain; of a push: as one, and as no change. ``alternative``: the right one among the
            alternatives of a change, or one with the same torque (testing/score.py). ``late``: one
            of these, but not in time. ``unnamed``: only that something is there. ``push``: as a
            push, which it is not. ``wrong``: another change. ``missed``: nothing. Of cases in which
            all but a push is right, ``named`` too where nothing is said. Of a clean flight
            ``silent`` or ``alarm``.
        delay: From the onset to the right report, s of motion; of a push, s.
        early: Events that were reported before the onset.
        pushes: Pushes that were reported from the onset on, and are none.
        events: All of them, in words.
        alarms: Of a clean flight, kind and effect of each event.
        hours: That were looked at.
        seconds: That it took, of the wall's clock.
        failure: Traceback, if it failed.
    """

    arm: str
    seed: int
    number: int
    scenario: str
    effect: str = ""
    joints: list[str] = field(default_factory=list)
    onset: float = 0.0
    shown: float = 0.0
    place: str = ""
    delay: float = float("nan")
    early: int = 0
    pushes: int = 0
    events: list[str] = field(default_factory=list)
    alarms: list[str] = field(default_factory=list)
    hours: float = 0.0
    seconds: float = 0.0
    failure: str = ""

    def __str__(self) -> str:
        """Give it on one line."""
        what = f"{self.arm} {self.seed}.{self.number} {self.scenario}"
        if self.failure:
            return f"{what}: failed: {self.failure.splitlines()[-1]}"
        where = f" {self.effect} {', '.join(self.joints)} x{self.shown:.1f}" if self.effect else ""
        seen = "; ".join(self.events) or "nothing"
        return (
            f"{what}:{where} at {self.onset:.1f} s -> {self.place}: {seen} [{self.seconds:.1f} s]"
        )


def judged(fly: Callable[[], Flight], verdict: Verdict, monitor: Monitor) -> Verdict:
    """Record a flight, let a monitor look at it, and judge; one that fails says so.

    Args:
        fly: Records it.
        verdict: What is known of it before.
        monitor: What is judged.
    """
    try:
        flight = fly()
        verdict.effect, verdict.joints = flight.hidden.effect, list(flight.hidden.joints)
        verdict.onset, verdict.shown = flight.onset, float(flight.shown.max())
        start = time.monotonic()
        seen: MonitorOutcome = monitor(flight.recording, flight.model)
        verdict.seconds = time.monotonic() - start
        verdict.hours = seen.seconds / 3600.0
        judge(verdict, flight, seen.events)
    except Exception:
        verdict.failure = traceback.format_exc(limit=4)
    return verdict


def judge(verdict: Verdict, flight: Flight, events: Sequence[Event]) -> None:
    """Fill in what the events are worth."""
    verdict.events = [words(event) for event in events]
    if flight.scenario in CLEAN:
        verdict.place = "alarm" if events else "silent"
        verdict.alarms = [f"{event.kind} {event.effect}".strip() for event in events]
        return
    after = [event for event in events if event.reported >= flight.onset]
    verdict.early = len(events) - len(after)
    if flight.hidden.effect == "push":
        verdict.place, verdict.delay = _push(flight, events, after)
        return
    verdict.pushes = sum(event.kind == "push" for event in after)
    if flight.hidden.effect == "drift":
        verdict.place, verdict.delay = _drift(flight, after)
    elif flight.scenario in NO_PUSH:
        verdict.place = "push" if verdict.pushes else "named"
    else:
        verdict.place, verdict.delay = _change(flight, events, after)


def right(hidden: Hidden, effect: str, joints: Sequence[str]) -> bool:
    """Whether an effect of some joints is what was hidden, by its own name."""
    if effect != hidden.effect:
        return False
    return effect in ANYWHERE or tuple(joints[:1]) == hidden.joints[:1]


def words(event: Event) -> str:
    """Return an event on one line."""
    sure = "" if event.certainty == "certain" else " (perhaps)"
    what = " ".join(part for part in (event.kind, event.effect, ", ".join(event.joints)) if part)
    return f"{event.onset:.1f}/{event.reported:.1f} s {what}{sure}"


def _push(
    flight: Flight, events: Sequence[Event], after: Sequence[Event]
) -> tuple[str, float]:  # fmt: skip
    first, last = flight.onset - AROUND[0], flight.end + AROUND[1]
    pushes = [event for event in after if event.kind == "push" and first <= event.onset <= last]
    changes = [event for event in events if event.kind == "change" and _certain(event)]
    if any(event.effect == "payload" for event in after) or changes:
        return "wrong", float("nan")
    if pushes:
        return "named", pushes[0].reported - flight.onset
    return ("unnamed" if after else "missed"), float("nan")


def _drift(flight: Flight, after: Sequence[Event]) -> tuple[str, float]:
    for event in after:
        if event.kind == "drift" and event.joints[:1] == flight.hidden.joints[:1]:
            pushed = any(other.kind == "push" for other in after)
            return ("push" if pushed else "named"), event.reported - flight.onset
    return _otherwise(after), float("nan")


def _change(
    flight: Flight, events: Sequence[Event], after: Sequence[Event]
) -> tuple[str, float]:  # fmt: skip
    hidden, arm = flight.hidden, flight.model.arm
    changes = [event for event in after if event.kind == "change"]
    named = [event for event in changes if right(hidden, event.effect, event.joints)]
    listed = [event for event in changes if _listed(hidden, event, arm)]
    others = [
        event for event in events
        if event.kind == "change" and _certain(event) and event not in named + listed
    ]  # fmt: skip
    # Nothing is late that was so from the beginning: a monitor has to get to know the arm first.
    in_time = IN_TIME if flight.onset > 0.0 else np.inf
    for place, found in (("named", named), ("alternative", listed)):
        for event in found:
            delay = flight.moved(event.reported)
            if delay <= in_time:
                return ("wrong" if others else place), delay
    if found := named or listed:
        return ("wrong" if others else "late"), flight.moved(found[0].reported)
    return _otherwise(after), float("nan")


def _listed(hidden: Hidden, event: Event, arm: Arm) -> bool:
    """Whether it is among an event's alternatives, or the event's effect has the same torque."""
    if event.effect and fits(hidden, event.effect, event.joints, arm):
        return True
    return any(right(hidden, each.effect, each.joints) for each in event.alternatives)


def _certain(event: Event) -> bool:
    return event.certainty == "certain"


def _otherwise(after: Sequence[Event]) -> str:
    kinds = {event.kind for event in after}
    for kind, place in (("change", "wrong"), ("push", "push")):
        if kind in kinds:
            return place
    return "unnamed" if kinds else "missed"


def table(title: str, verdicts: Sequence[Verdict]) -> str:
    """Return counts by scenario and arm, delays, and alarms an hour."""
    good = [each for each in verdicts if not each.failure]
    changes = [each for each in good if each.scenario not in CLEAN]
    lines = [title]
    if changes:
        lines.append(
            f"  {'':<19} {'':<14} {'n':>4} " + " ".join(f"{place:>8.8}" for place in PLACES)
            + "  early pushes   delay median, 95 %; named by size <2 / 2-5 / >5"
        )  # fmt: skip
    for scenario in dict.fromkeys(each.scenario for each in changes):
        rows = [each for each in changes if each.scenario == scenario]
        arms = list(dict.fromkeys(each.arm for each in rows))
        lines += [_row(scenario, arm, [each for each in rows if each.arm == arm]) for arm in arms]
        if len(arms) > 1:
            lines.append(_row(scenario, "all", rows))
    for scenario in CLEAN:
        clean = [each for each in good if each.scenario == scenario]
        if not clean:
            continue
        arms = list(dict.fromkeys(each.arm for each in clean))
        lines.append(f"  {scenario}: alarms, hours, upper 95 % bound on alarms an hour")
        lines += [_hours(arm, [each for each in clean if each.arm == arm]) for arm in arms]
        lines.append(_hours("all", clean))
        kinds = Counter(alarm for each in clean for alarm in each.alarms)
        lines += [f"    {alarm}: {count}" for alarm, count in kinds.most_common()]
    failed = [each for each in verdicts if each.failure]
    lines += [f"  {each}" for each in failed]
    speed = sum(each.hours for each in good) * 3600.0 / max(sum(e.seconds for e in good), 1e-9)
    lines.append(f"  {speed:.0f} times as fast as the arm; failed {len(failed)}")
    return "\n".join(lines)


def most_an_hour(alarms: int, hours: float) -> float:
    """Return the upper 95 % bound on a Poisson rate, 1/h (Garwood 1936)."""
    return float(chi2.ppf(0.95, 2 * (alarms + 1)) / 2.0 / hours) if hours else float("inf")


def _row(scenario: str, arm: str, rows: Sequence[Verdict]) -> str:
    counts: Mapping[str, int] = Counter(each.place for each in rows)
    delays = [each.delay for each in rows if each.place in ("named", "alternative", "late")]
    delays = [delay for delay in delays if np.isfinite(delay)]
    between = "{:.1f}, {:.1f} s".format(*np.quantile(delays, (0.5, 0.95))) if delays else "-"
    sizes = []
    for low, high in ((0.0, 2.0), (2.0, 5.0), (5.0, np.inf)):
        these = [each for each in rows if low <= each.shown < high]
        sizes.append(f"{sum(each.place == 'named' for each in these)}/{len(these)}")
    return (
        f"  {scenario:<19} {arm:<14} {len(rows):4d} "
        + " ".join(f"{counts.get(place, 0):8d}" for place in PLACES)
        + f"  {sum(each.early for each in rows):5d} {sum(each.pushes for each in rows):6d}   "
        + f"{between:>14}; {' / '.join(sizes)}"
    )


def _hours(arm: str, rows: Sequence[Verdict]) -> str:
    alarms, hours = sum(len(each.alarms) for each in rows), sum(each.hours for each in rows)
    return f"    {arm:<14} {alarms:4d} in {hours:6.2f} h, < {most_an_hour(alarms, hours):.3f}"
