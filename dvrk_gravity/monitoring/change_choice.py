"""Which of the causes that a window shows is the one to be named, and which are as likely."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from dvrk_gravity.effects import is_friction
from dvrk_gravity.monitoring.change_candidates import ChangeCandidate, likeliest
from dvrk_gravity.monitoring.settings import MonitorSettings

# Of the mean square of errors as they are known, that counts at least where causes are compared:
# small errors, too, may look like one of them. Chosen.
_LIKE_CAUSE = 1.0 / 3.0


@dataclass(frozen=True, eq=False)
class Choice:
    """A cause that may be named.

    Attributes:
        named: The cause, as it began at its onset.
        rivals: Causes that are as likely.
        explains: Whether what the cause leaves is no more than errors.
    """

    named: ChangeCandidate
    rivals: tuple[ChangeCandidate, ...]
    explains: bool


class PlausibleChanges:
    """The candidates of a window whose fit is plausible, at joints that have a name left.

    Attributes:
        passing: Those of significant size that exceed their limit.
    """

    def __init__(
        self, found: Sequence[ChangeCandidate], settings: MonitorSettings, blind: Collection[str]
    ) -> None:
        """Take candidates; ``blind``: names of joints at which something has no name."""
        self._found, self._settings, self._blind = found, settings, blind
        self.passing = [each for each in self._above(0.0) if each.significant()]

    def _above(self, excess: float) -> list[ChangeCandidate]:
        """Return plausible fits with more excess."""
        fits = (each.plausible_fit for each in self._found if each.excess > excess)
        return [
            each
            for each in fits
            if each is not None and each.excess > excess and each.joints()[0] not in self._blind
        ]

    def choose(self, now: float) -> Choice | None:
        """Return the cause to be named now, s, with its rivals.

        ``None``: nothing passes that lasts and counts, or it is too early to show.
        """
        settings = self._settings
        first = likeliest(self.passing)
        if not first.is_persistent() or first.size() < settings.min_relative_size:
            return None
        least = settings.longest_push + 1.0 if first.resembles_push() else settings.min_duration
        if now - first.since < least:
            return None
        # Samples before the onset, taken for some with a cause, speak for one of another shape.
        onset = first.onset()
        near = self._above(min(0.0, first.excess - self._margin(first)))
        causes = {each.hypothesis.key: each for each in near}
        begun = [fit for each in causes.values() if (fit := each.refit_from(onset)) is not None]
        likely = [each for each in begun if each.significant()]
        if not likely or likeliest(likely).excess <= 0.0:
            return None
        best = likeliest(likely)
        least = best.excess - self._margin(best)
        equal = [each for each in begun if each is best or each.excess > least]
        # Friction changes from day to day, and warms up: the commonest of causes as likely.
        friction = [
            each
            for each in likely
            if each in equal and each.excess > 0.0 and is_friction(each.hypothesis.effect)
        ]
        named = likeliest(friction or [best])
        rivals = tuple(each for each in equal if each is not named)
        # Which link carries a load, a motion may never show.
        undecided = not all(rival.differs_by_link(named) for rival in rivals)
        if undecided and now - onset < settings.patience:
            return None
        return Choice(named, rivals, named.remaining_error() < settings.misfit_limit)

    def _margin(self, candidate: ChangeCandidate) -> float:
        """Return by how much gain a cause must excel others."""
        return max(
            self._settings.margin * max(candidate.typical_gain, _LIKE_CAUSE),
            self._settings.margin_fraction * candidate.evidence.gain,
        )
