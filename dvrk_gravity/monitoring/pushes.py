"""Pushes: torque from outside that begins, acts for a moment, and is over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects import Estimate
from dvrk_gravity.estimation import NORMAL_95
from dvrk_gravity.monitoring.change_test import ChangeTest, Sums
from dvrk_gravity.monitoring.events import Event
from dvrk_gravity.monitoring.limits import Limits
from dvrk_gravity.monitoring.settings import MonitorSettings
from dvrk_gravity.monitoring.transients import (
    LONGEST_TRANSIENT,
    TransientTorques,
    TypicalGains,
    transient_torques,
)
from dvrk_gravity.monitoring.window import Window
from dvrk_gravity.monitoring.wrench import Tip

_ASIDE = 0.3  # s, before a push seems to begin, that may have something of it. Chosen
_AROUND = 0.5  # s, before and after it, that are left out with it
_LISTED = 0.2  # of the largest torque, from which on a joint is named. Chosen


@dataclass(frozen=True, eq=False)
class Push:
    """A push that goes on, or is over and not yet reported, since it may be a change.

    Attributes:
        begin: s.
        peak: (n,) largest torque, N·m.
        end: s, so far.
        impulse: Integral of the torque's norm, N·m·s.
    """

    begin: float
    peak: Array
    end: float
    impulse: float = 0.0

    @property
    def span(self) -> tuple[float, float]:
        """From when to when it may act, s."""
        return self.begin - _AROUND, self.end + _AROUND

    def event(self, arm: Arm, now: float) -> Event:
        """Return what is reported of it, s, when it is over."""
        peak, names = self.peak, arm.joint_names
        order = np.argsort(-peak)
        values = {
            names[j]: Estimate(float(peak[j]), np.nan, np.nan, arm.effort_units[j])
            for j in order
            if peak[j] > 0.0
        }
        joints = tuple(names[j] for j in order if peak[j] > _LISTED * peak.max())
        return Event(
            "push", self.begin, now, joints, end=self.end, values=values, impulse=self.impulse
        )


class PushDetector:
    """Follows pushes from look to look.

    Attributes:
        ended: Pushes that are over, and neither reported nor dropped.
        excluded_spans: When those that were reported acted, s: left out of what follows.
    """

    def __init__(self, arm: Arm, settings: MonitorSettings, tip: Tip | None) -> None:
        """Begin to look; ``tip``: where a force may act, ``None``: nowhere."""
        self._arm, self._settings, self._tip = arm, settings, tip
        self._typical_gains = TypicalGains.begin(arm.n)
        self._levels: tuple[tuple[float, Array], ...] = ()  # at the last looks
        self._acting: Push | None = None
        self.ended: tuple[Push, ...] = ()
        self.excluded_spans: tuple[tuple[float, float], ...] = ()

    @property
    def level(self) -> Array:
        """(n,) of errors, before what may have changed of late: see :class:`Limits`."""
        return self._levels[0][1] if self._levels else np.ones(1)

    def look(
        self, window: Window, new: int, baseline: Sums | None, limits: Limits, blind: Sequence[int]
    ) -> None:
        """Begin a push, go on with it, or end it, by what the last rows show.

        Args:
            window: The samples.
            new: Rows since the last look.
            baseline: Of samples before the window.
            limits: From which gain on there is a push.
            blind: Indices of joints that are not looked at.
        """
        settings, now = self._settings, float(window.time[-1])
        rate = settings.sampling.row_rate
        first_new = int(np.searchsorted(window.time, now - new / rate))
        earliest = float(window.time[max(first_new - LONGEST_TRANSIENT, 0)])
        # What a push adds must not pass for what is uncertain anyway.
        pushes = self.ended if self._acting is None else (*self.ended, self._acting)
        until = min([earliest, *(push.begin - _ASIDE for push in pushes)])
        before = (window.time < until)[:, None]
        uncertain = window.uncertain * before[:, :, None]
        known = ChangeTest(uncertain, window.residual * before, baseline)
        found = transient_torques(window, known, first_new, self._tip, blind)
        limit = limits.push_limit(
            found.gain, self._typical_gains.for_transients(found), self._typical_gains.largest
        )
        over = max((push.end for push in self.ended), default=-np.inf)
        begins = window.time[found.begin]
        excess = np.where(begins[:, None] > over, found.gain / limit, 0.0)
        forgotten = new / rate / settings.forgetting_time
        self._typical_gains = self._typical_gains.updated(found, limit, float(np.exp(-forgotten)))
        self._levels = (*self._levels, (now, self._typical_gains.level))
        self._levels = tuple(each for each in self._levels if each[0] > now - settings.level_delay)
        acts = excess > 1.0
        if acts.any():
            self._acting = self._continued(window, found, excess, now - new / rate)
        goes_on = acts[begins > window.time[first_new] - _ASIDE].any()
        if self._acting is not None and not goes_on:
            if now - self._acting.begin < settings.longest_push + 2.0:
                self.ended = (*self.ended, self._acting)
            self._acting = None

    def _continued(
        self, window: Window, found: TransientTorques, excess: Array, last_look: float
    ) -> Push:
        """Return the push that acts, as what was found since the last look, s, shows it."""
        clearest = int(excess.max(axis=1).argmax())
        begin, end = float(window.time[found.begin[clearest]]), int(found.end[clearest]) - 1
        felt = np.any(excess > 1.0, axis=1, keepdims=True) & (found.gain[:, :-1] > NORMAL_95**2)
        peak = np.max(np.abs(np.where(felt, found.torque, 0.0)), axis=0)
        if not peak.any():  # a little at several
            peak = np.abs(window.torque[found.begin[clearest] : end].mean(axis=0))
        old = self._acting or Push(begin, peak, begin)
        torque = np.linalg.norm(window.torque[window.time >= max(begin, last_look)], axis=1)
        return replace(
            old, peak=np.maximum(old.peak, peak), end=float(window.time[end]),
            impulse=old.impulse + torque.sum() / self._settings.sampling.sample_rate,
        )  # fmt: skip

    def drop(self, pushes: Sequence[Push]) -> None:
        """Forget pushes that are over and were part of a change."""
        self.ended = tuple(push for push in self.ended if push not in pushes)

    def drop_acting(self) -> None:
        """Forget the push that acts: it is a change."""
        self._acting = None

    def report(self, push: Push, now: float) -> Event:
        """Return the event of a push that is over, and leave it out of what follows."""
        self.drop([push])
        self.excluded_spans = (*self.excluded_spans, push.span)
        return push.event(self._arm, now)

    def forget_before(self, start: float) -> None:
        """Forget spans that are over before a time, s."""
        self.excluded_spans = tuple(span for span in self.excluded_spans if span[1] > start)
