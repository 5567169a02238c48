"""Which arms changed, since when, how fast, and which need a hand first.

Every series of an arm is a change that was fitted alone to each of its recordings
(``diagnosis.track``). Many arms with many series each are many chances to be wrong. An arm is
reported if it changed at all, at a false discovery rate over the arms (Benjamini and Hochberg 1995;
of an arm the smallest p-value, times its series): arms are independent, its series are not. Of the
reported arms those series are named whose change holds at that rate times the part of the arms that
are reported (Benjamini and Bogomolov 2014).

Several quantities that move at one date are one change. The one is named that the findings of the
recordings since then name, else the likeliest; another is a change of its own only if it still
changed when the first one's course is allowed for, and not by a step at the same date.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.errors import ConfigError
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.fleet import change_points
from dvrk_gravity.fleet.change_points import FEWEST, MONTH, Change, FittedSeries
from dvrk_gravity.fleet.store import table

if TYPE_CHECKING:
    import pyarrow

_COLUMNS = (
    "serial", "kind", "arm", "date", "effect", "joints", "parameter", "value", "standard_error",
    "unit", "torque_ratio", "certainty", "verdict", "key", "content", "model", "version", "report",
    "recording", "text",
)  # fmt: skip
Name = tuple[str, str, str]
"""Of a series: effect, joint and parameter."""

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_DAY = 86400.0


@dataclass(frozen=True)
class HistorySettings:
    """What counts as a change, and as a need.

    Attributes:
        false_discovery_rate: False discovery rate. A convention.
        urgent_ratio: Torque of a change over the joint's friction, from which on an arm needs a
            hand: what is not compensated moves a joint once it exceeds its friction, and friction
            has then doubled.
        horizon_months: Months for which a slope is extrapolated where arms are put in order.
            Chosen.
        min_evidence: Log-likelihood that it must be ahead of another quantity, else either may be
            it: a Bayes factor of 20 (Kass and Raftery 1995: strong).
        naming_share: Part of the recordings since a change whose findings must name a cause.
            Chosen: most.
        max_changes: Changes of one arm: a bound on time.
    """

    false_discovery_rate: float = 0.05
    urgent_ratio: float = 1.0
    horizon_months: float = 3.0
    min_evidence: float = 3.0
    naming_share: float = 0.5
    max_changes: int = 5


@dataclass(frozen=True)
class Visit:
    """One recording of an arm.

    Attributes:
        day: Since 1970.
        verdict: Of its diagnosis; failed: there is none.
        recording: Path or URL.
        report: Path of its report, as seen from the folder of results; ``""``: none.
        text: The verdict in a sentence.
    """

    day: float
    verdict: str
    recording: str
    report: str
    text: str


@dataclass(frozen=True, eq=False)
class Series:
    """One quantity of one arm.

    Attributes:
        effect: Name of the effect.
        joint: Name of the joint; ``""``: of the arm.
        parameter: Name of the parameter.
        unit: SI unit.
        torque_ratio: RMS torque of one unit over the joint's friction; NaN: not known.
        day: (N,) since 1970, increasing.
        value: (N,) by how much it differs from the arm's model.
        error: (N,) standard errors.
        fitted: What it did; ``None``: too few values.
    """

    effect: str
    joint: str
    parameter: str
    unit: str
    torque_ratio: float
    day: Array
    value: Array
    error: Array
    fitted: FittedSeries | None = None

    @property
    def name(self) -> Name:
        """Effect, joint and parameter."""
        return self.effect, self.joint, self.parameter

    @cached_property
    def daily(self) -> tuple[Array, Array, Array]:
        """Days, values and errors, one a day."""
        return change_points.daily(self.day, self.value, self.error)


@dataclass(frozen=True)
class ArmChange:
    """A change of an arm that is reported.

    Attributes:
        series: The quantity that it is named by.
        change: What that did.
        q_value: Its p-value, adjusted for the arm's series.
        also: Quantities that moved with it, most significant first.
        rivals: Those of them by which it could be named as well.
        by_findings: The findings since then name it, too.
        severity: Torque of the change at the last date over the joint's friction.
        due: When that is beyond what is usable, by the slope; ``None``: there is none.
        due_interval: 95 % interval of that, by the slope's error; ``None`` as its end: never.
    """

    series: Series
    change: Change
    q_value: float
    also: tuple[Name, ...]
    rivals: tuple[Name, ...]
    by_findings: bool
    severity: float
    due: float | None
    due_interval: tuple[float | None, float | None]

    def severity_after(self, months: float) -> float:
        """Return the severity so many months after the last date."""
        if self.change.shape == "break":
            return self.severity
        ratio = self.series.torque_ratio
        return abs(self.change.now + months * self.change.size) * ratio


@dataclass(frozen=True, eq=False)
class ArmHistory:
    """One arm over time.

    Attributes:
        serial: Which arm.
        arm: Its kind.
        visits: Its recordings, in the order of their dates.
        series: Its quantities.
        p_value: Of no change at all.
        changes: What changed, the most urgent first; empty: nothing that holds.
        urgency: Of the most urgent change, the severity some months ahead.
    """

    serial: str
    arm: str
    visits: tuple[Visit, ...]
    series: tuple[Series, ...]
    p_value: float = 1.0
    changes: tuple[ArmChange, ...] = ()
    urgency: float = 0.0
    named_days: Mapping[tuple[str, str], Array] = field(default_factory=dict)


def histories(
    folder: Path, serial: str = "", settings: HistorySettings | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> list[ArmHistory]:  # fmt: skip
    """Return the arms in a folder of results, the most urgent first.

    Args:
        folder: The folder that ``fleet --out`` names.
        serial: Of one arm alone; ``""``: of all.
        settings: What counts.
        progress: Called with the part that is done.

    Raises:
        ConfigError: No results, or none of that arm.
    """
    of = settings or HistorySettings()
    kinds = ("recording", "change", "finding")
    rows = table(folder, kinds, _COLUMNS, serial)
    if not rows.num_rows:
        what = f"results of arm {serial}" if serial else "results of `fleet`"
        raise ConfigError("--arm" if serial else "", serial or "none", what, folder)
    arms = list(_arms(rows))
    fitted = []
    for count, arm in enumerate(arms, start=1):
        fitted.append(_fit_series(arm))
        progress(count / len(arms))
    return assess_changes(fitted, of)


def assess_changes(
    arms: Sequence[ArmHistory], settings: HistorySettings | None = None
) -> list[ArmHistory]:
    """Return arms whose series are fitted with what changed, the most urgent first."""
    from scipy.stats import false_discovery_control

    of = settings or HistorySettings()
    adjusted = false_discovery_control([arm.p_value for arm in arms]) if arms else []
    reported = [bool(q <= of.false_discovery_rate) for q in adjusted]
    level = of.false_discovery_rate * sum(reported) / max(len(arms), 1)
    found = [
        _with_changes(arm, level, of) if is_reported else arm
        for arm, is_reported in zip(arms, reported, strict=True)
    ]
    return sorted(found, key=lambda arm: (-arm.urgency, not arm.changes, arm.serial))


def date(day: float) -> datetime:
    """Return the date of a day since 1970."""
    return _EPOCH + timedelta(days=day)


def with_fit(series: Series, given: Array | None = None) -> Series:
    """Return a series with its fitted changes, an expected (N,) course allowed for."""
    time, value, error = series.daily
    if len(time) < FEWEST:
        return replace(series, fitted=None)
    return replace(series, fitted=change_points.fit(time, value, error, given))


def _fit_series(arm: ArmHistory) -> ArmHistory:
    series = tuple(map(with_fit, arm.series))
    p_values = [each.fitted.p_value for each in series if each.fitted is not None]
    smallest = min(1.0, len(p_values) * min(p_values)) if p_values else 1.0
    return replace(arm, series=series, p_value=smallest)


def _with_changes(arm: ArmHistory, level: float, of: HistorySettings) -> ArmHistory:
    """Return an arm with its changes, one after the other, each beside those before it."""
    left, changes = _significant(arm.series, level), list[ArmChange]()
    while left and len(changes) < of.max_changes:
        first, by_findings = _naming_series(arm, [series for series, _ in left], of)
        q_value = {series.name: q for series, q in left}[first.name]
        assert first.fitted is not None
        course = np.interp(first.day, first.daily[0], first.fitted.curve)
        rest = [
            with_fit(series, np.interp(series.daily[0], first.day, course))
            for series, _ in left
            if series is not first
        ]
        still = [pair for pair in _significant(rest, level) if not _same_step(pair[0], first)]
        kept = {series.name for series, _ in still}
        also = tuple(
            series for series, _ in left if series is not first and series.name not in kept
        )
        changes.append(_change(first, q_value, also, by_findings, of))
        left = still
    changes.sort(key=lambda each: -np.nan_to_num(each.severity_after(of.horizon_months)))
    urgency = max(
        (float(np.nan_to_num(each.severity_after(of.horizon_months))) for each in changes),
        default=0.0,
    )
    return replace(arm, changes=tuple(changes), urgency=urgency)


def _significant(series: Sequence[Series], level: float) -> list[tuple[Series, float]]:
    """Return the series whose change holds, with adjusted p-values, the surest first."""
    from scipy.stats import false_discovery_control

    tested = [each for each in series if each.fitted is not None]
    if not tested:
        return []
    adjusted = false_discovery_control([each.fitted.p_value for each in tested])  # type: ignore[union-attr]
    holding = [
        (each, float(q))
        for each, q in zip(tested, adjusted, strict=True)
        if q <= level and each.fitted is not None and each.fitted.change is not None
    ]
    return sorted(holding, key=lambda pair: pair[1])


def _same_step(series: Series, first: Series) -> bool:
    """Return whether two series have a step at what may be the same date."""
    if any(each.fitted is None or each.fitted.change is None for each in (series, first)):
        return False
    one, other = series.fitted.change, first.fitted.change  # type: ignore[union-attr]
    assert one is not None
    assert other is not None
    both = one.shape == other.shape == "break"
    return both and one.since[0] <= other.since[1] and other.since[0] <= one.since[1]


def _naming_series(
    arm: ArmHistory, series: Sequence[Series], of: HistorySettings
) -> tuple[Series, bool]:
    """Return the quantity that a change is named by, and whether the findings name it."""

    def change(each: Series) -> Change:
        assert each.fitted is not None
        assert each.fitted.change is not None
        return each.fitted.change

    def share(each: Series) -> float:
        found = arm.named_days.get((each.effect, each.joint), np.zeros(0))
        at = change(each).at
        after = sum(visit.day >= at for visit in arm.visits)
        return float(np.sum(found >= at)) / max(after, 1)

    named = [each for each in series if share(each) >= of.naming_share]
    return max(named or series, key=lambda each: change(each).gain), bool(named)


def _change(
    series: Series, q_value: float, also: Sequence[Series], by_findings: bool, of: HistorySettings
) -> ArmChange:  # fmt: skip
    assert series.fitted is not None
    assert series.fitted.change is not None
    change, ratio = series.fitted.change, series.torque_ratio
    severity, last = abs(change.now) * ratio, float(series.day[-1])
    due: float | None = None
    interval: tuple[float | None, float | None] = (None, None)
    if change.shape != "break" and np.isfinite(ratio):
        grows = np.sign(change.now) == np.sign(change.size)
        rates = [abs(change.size) + z * change.error for z in (0.0, NORMAL_95, -NORMAL_95)]
        left = [
            last + max(of.urgent_ratio - severity, 0.0) / (rate * ratio) * MONTH
            if grows and rate * ratio > 0.0 else None
            for rate in rates
        ]  # fmt: skip
        due, interval = left[0], (left[1], left[2])
    rivals = tuple(
        each.name for each in also
        if each.fitted is not None and each.fitted.change is not None
        and each.fitted.change.gain > change.gain - of.min_evidence
    )  # fmt: skip
    names = tuple(each.name for each in also)
    return ArmChange(
        series, change, q_value, names, rivals, by_findings, float(severity), due, interval
    )


def _arms(rows: pyarrow.Table) -> Iterator[ArmHistory]:
    """Yield the arms in a table of results, not fitted yet."""
    order = [(name, "ascending") for name in ("serial", "kind", "effect", "joints", "parameter")]
    rows = rows.sort_by([*order, ("date", "ascending")]).combine_chunks()
    serials = rows.column("serial").to_numpy(zero_copy_only=False)
    edges = np.flatnonzero(np.concatenate([[True], serials[1:] != serials[:-1]]))
    for begin, end in zip(edges, [*edges[1:], len(serials)], strict=True):
        yield _arm(str(serials[begin]), rows.slice(begin, end - begin))


def _arm(serial: str, rows: pyarrow.Table) -> ArmHistory:
    columns = {name: rows.column(name).to_pylist() for name in rows.column_names}
    kind = columns["kind"]
    day = [(when - _EPOCH).total_seconds() / _DAY for when in columns["date"]]
    every = range(len(kind))
    # Beside one model, by one version: the pair with the most recordings, of equal ones the later.
    pairs = list(zip(columns["model"], columns["version"], strict=True))
    whole = [k for k in every if kind[k] == "recording"]
    compared = [k for k in whole if columns["model"][k]]
    counts = Counter(pairs[k] for k in compared)
    latest = {pairs[k]: day[k] for k in sorted(compared, key=lambda k: day[k])}
    chosen = max(counts, key=lambda pair: (counts[pair], latest[pair]), default=None)
    # A model fits the recording that it was identified from better than any other.
    references = {columns["content"][k] for k in whole if columns["verdict"][k] == "reference"}
    of_model = [k for k in every if pairs[k] == chosen]
    visits = tuple(sorted(
        (Visit(day[k], columns["verdict"][k], columns["recording"][k], columns["report"][k] or "",
               columns["text"][k] or "")
         for k in of_model if kind[k] == "recording"), key=lambda visit: visit.day,
    ))  # fmt: skip
    named: dict[tuple[str, str], list[float]] = {}
    series: dict[tuple[str, str, str], list[int]] = {}
    for k in of_model:
        joint = (columns["joints"][k] or "").partition(",")[0]
        if kind[k] == "finding" and columns["certainty"][k] == "certain":
            days = named.setdefault((columns["effect"][k], joint), [])
            if day[k] not in days:
                days.append(day[k])
        if kind[k] == "change" and columns["content"][k] not in references:
            series.setdefault((columns["effect"][k], joint, columns["parameter"][k]), []).append(k)
    return ArmHistory(
        serial, columns["arm"][0], visits,
        tuple(each for name, its in series.items() if (each := _series(name, its, day, columns))),
        named_days={name: np.array(days) for name, days in named.items()},
    )  # fmt: skip


def _series(
    name: tuple[str, str, str], rows: Sequence[int], day: Sequence[float],
    columns: Mapping[str, Sequence[Any]],
) -> Series | None:  # fmt: skip
    value, error, ratio = (
        np.array([columns[key][k] for k in rows], dtype=float)
        for key in ("value", "standard_error", "torque_ratio")
    )
    kept = change_points.usable(value, error)
    if not kept.any():
        return None
    known = ratio[np.isfinite(ratio)]
    days = np.array([day[k] for k in rows])[kept]
    order = np.argsort(days, kind="stable")
    return Series(
        *name, columns["unit"][rows[0]] or "", float(np.median(known)) if len(known) else np.nan,
        days[order], value[kept][order], error[kept][order],
    )  # fmt: skip
