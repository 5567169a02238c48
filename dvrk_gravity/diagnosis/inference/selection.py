"""Forward selection of effects with backward elimination."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import (
    Candidate,
    Score,
    are_possible,
    most_parsimonious,
)
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.diagnosis.inference.fit_context import FitContext, homogeneous, variation
from dvrk_gravity.diagnosis.inference.nonlinear import refined
from dvrk_gravity.diagnosis.inference.recurring_misfit import AtCalibration
from dvrk_gravity.diagnosis.inference.significance import Multiplicity
from dvrk_gravity.effects import Hypothesis, Residual
from dvrk_gravity.estimation import Trial, eliminate_backward, select

Report = Callable[[str], None]


@dataclass(frozen=True)
class SelectionSettings:
    """When a hypothesis is selected.

    Attributes:
        alpha: Chance that a step selects anything where nothing is, corrected for the number of
            hypotheses; and that any effect which held-out blocks confirm is none. A convention; a
            tenth of it would need longer recordings.
        unseen: ... where it acts in no held-out block that could confirm it: as unlikely as to
            pass the test of the choice and theirs.
        most_effects: Selected at most, times the joints: a bound on time. Chosen: a model without
            any friction or rotor lacks three or four of each joint.
        screened: Hypotheses that are cross-validated at each step: a bound on time.
        refined: ... and whose settings are searched for.
        close: Part of the best gain by which those may miss it.
        equal: Standard errors of the difference by which one that is as good may gain less than the
            best: one-sided 95 % of a normal one (Vuong 1989).
        equal_least: Log-likelihood likewise, at least: odds of 20 to one, "strong" in the scale of
            Kass and Raftery (1995).
        equal_most: Part of the best gain likewise, at most: what differs in a single block has a
            standard error as large as the difference. Chosen; see `make sensitivity`.
        consequence: Times a joint's known error that a finding's torque must be, RMS: as large
            as its error is in one motion of twenty where nothing is there. The square of
            that over the known one's is Fisher's F of 30 degrees of freedom each
            (``SignificanceSettings.dof``), of which 1.84 is the 95 % point. Chosen: with the
            99 % point, 1.55, causes of twice what the model leaves are lost.
        day_to_day: Times what changed friction may be off by, added in squares. One: that is a
            standard deviation by itself.
        share: Part of a joint's torque, RMS, that it must be as well, of a model that was
            identified. Chosen: no torque constant is known as well.
    """

    alpha: float = 0.01
    unseen: float = 0.01**2
    most_effects: int = 5
    screened: int = 24
    refined: int = 6
    close: float = 0.15
    equal: float = 1.64
    equal_least: float = 3.0
    equal_most: float = 0.02
    consequence: float = 1.36
    day_to_day: float = 1.0
    share: float = 0.003

    def least(self, validation: CrossValidation, changed: Array | float = 0.0) -> Array:
        """Return (n,) the least RMS torque that matters, where friction may be off by (n,), N·m."""
        known = validation.known_error
        share = np.where(known > 0.0, self.share * validation.data.torque_rms, 0.0)
        least = np.hypot(self.consequence * known, self.day_to_day * np.asarray(changed))
        return np.maximum(least, share)


SELECTION = SelectionSettings()


@dataclass(frozen=True, eq=False)
class EffectTrial(Trial[Candidate]):
    """A hypothesis and how it did beside those that were selected at the time.

    Its worth is the log-likelihood gained over the set without it, its cost taken off; it passes if
    it is significant, plausible, and worth having.

    Attributes:
        score: Score of the set with it.
        p_value: Corrected for the number of hypotheses.
        removed: Largest part of a joint's error that it removes.
        plausible: Whether its parameters are such as it can have.
        typical: ... and such as one meets with, see ``Hypothesis.typical``.
        size: (n,) RMS of its torque at the joints that are judged, N·m; zero where friction may
            change by as much.
        inflation: Log-likelihood that counts as one unit, for errors are correlated; see
            ``CrossValidation.inflation``.
        day_to_day: Where it matters, friction changed by as much at other joints: day-to-day
            variation, and no finding.
        seen_before: It would pass, had what the model was identified on not shown as much of it.
    """

    score: Score
    p_value: float
    removed: float
    plausible: bool
    typical: bool
    size: Array
    inflation: float
    day_to_day: bool
    seen_before: bool

    @property
    def candidate(self) -> Candidate:
        """The hypothesis with its columns."""
        return self.move

    @property
    def named(self) -> tuple[str, tuple[int, ...]]:
        """Effect and joints, as findings name it."""
        return self.candidate.hypothesis.effect, self.candidate.hypothesis.joints

    @property
    def gain(self) -> float:
        """Log-likelihood over the set without it, its cost taken off."""
        return self.worth


@dataclass(frozen=True, eq=False)
class Selection:
    """Chooses among a pool of hypotheses.

    Attributes:
        validation: The samples.
        pool: The candidates that need no search.
        report: Called with a line about every choice.
        always: Parameters of the model itself that are fitted again beside every hypothesis.
        ordinary: What is likely there before anything is seen: it needs not be found, and nothing
            is looked for in its place.
        at_calibration: What the calibration recording shows of the hypotheses.
        settings: When a hypothesis is selected.
        excluded: Keys of hypotheses that are not chosen.
    """

    validation: CrossValidation
    pool: Sequence[Candidate]
    report: Report
    always: Sequence[Candidate] = ()
    ordinary: Sequence[Candidate] = ()
    at_calibration: AtCalibration | None = None
    settings: SelectionSettings = SELECTION
    excluded: Collection[tuple[object, ...]] = ()

    def excluding(self, hypotheses: Iterable[Hypothesis]) -> Selection:
        """Return the same without some hypotheses."""
        gone = (hypothesis.key for hypothesis in hypotheses)
        return replace(self, excluded={*self.excluded, *gone})

    def at(self, candidates: Sequence[Candidate], final: bool = False) -> FitContext:
        """Return some of the hypotheses as selected, see :class:`FitContext`."""
        return FitContext.of(self.validation, candidates, final)

    def run(self, start: Sequence[Candidate] | None = None) -> FitContext:
        """Select until nothing more passes; start by default at what is free or ordinary."""
        selected = (*self.always, *self.ordinary) if start is None else start
        most = self.settings.most_effects * self.validation.joints + len(self.always)
        most -= len(selected)
        return select(self, self.at(selected), max(most, 0))[0]

    def fixed(self, candidate: Candidate) -> bool:
        """Return whether nothing is looked for in the place of one that is selected."""
        keys = {other.hypothesis.key for other in self.ordinary}
        return candidate in self.always or candidate.hypothesis.key in keys

    def moves(self, state: FitContext) -> list[Candidate]:
        """Return the hypotheses to try beside those selected, in no order."""
        return [*self.pool, *self._searched(state)]

    def attempt(self, state: FitContext, moves: Sequence[Candidate]) -> list[EffectTrial]:
        """Return how the best of some hypotheses do beside those selected."""
        return self.best(state, moves)

    def choose(self, trials: Sequence[EffectTrial]) -> EffectTrial | None:
        """Return the most parsimonious of the passing trials that are as good as the best."""
        passing = [trial for trial in trials if trial.passes]
        return self.preferred(passing) if passing else None

    def take(self, state: FitContext, trial: EffectTrial) -> FitContext:
        """Return the set with a hypothesis, those left out that are no longer needed."""
        self.report(f"accepted: {trial.move.hypothesis}")
        *old, newest = self._read(state.extended(trial.move))

        def failing(kept: list[Candidate]) -> list[tuple[float, Candidate]]:
            context = FitContext(state.validation, tuple(kept))
            tested = [each for each in kept if each is not newest and each not in self.always]
            return [
                (found.worth, found.move)
                for found in self._without(context, tested)
                if not found.passes
            ]

        return self.at(
            eliminate_backward(
                [*old, newest], failing,
                lambda gone: self.report(f"no longer needed: {gone.hypothesis}"),
            )
        )  # fmt: skip

    @staticmethod
    def _read(chosen: FitContext) -> list[Candidate]:
        """Return a set with readings of what acts beside the others in it."""
        return [
            refined(chosen.validation, candidate, chosen.without(candidate).candidates)
            if candidate.hypothesis.EFFORT_READING
            else candidate
            for candidate in chosen.candidates
        ]

    def best(
        self, selected: FitContext, pool: Sequence[Candidate] | None = None
    ) -> list[EffectTrial]:
        """Return the best hypotheses beside the selected ones, settings refined, best first."""
        validation, settings = selected.validation, self.settings
        known = {each.hypothesis.key for each in selected.candidates} | {*self.excluded}
        pool = self.moves(selected) if pool is None else pool
        pool = [candidate for candidate in pool if candidate.hypothesis.key not in known]
        least = settings.least(validation)
        others = selected.candidates
        screened = validation.screen(others, pool, settings.screened, least)
        trials = [self.evaluate(selected, candidate) for candidate in screened]
        if not trials:
            return []
        most = max((trial.gain for trial in trials if trial.plausible), default=0.0)
        limit = (1.0 - settings.close) * most
        trials.sort(key=lambda trial: -trial.gain)
        result, seen = [], set()
        for trial in trials:
            hypothesis = trial.candidate.hypothesis
            name = (hypothesis.key, trial.candidate.size)
            if name in seen:
                continue
            seen.add(name)
            adjustable = hypothesis.refine or hypothesis.fixed_point or hypothesis.refine_first
            if adjustable and trial.gain >= limit and len(seen) <= settings.refined:
                again = self.evaluate(selected, refined(validation, trial.candidate, others))
                # Away from the setting that its fit determines it is not the torque of its cause.
                settled = hypothesis.refine_first or not trial.plausible
                trial = again if settled or again.gain > trial.gain else trial
            result.append(trial)
        return sorted(result, key=lambda trial: -trial.gain)

    def evaluate(self, rest: FitContext, candidate: Candidate) -> EffectTrial:
        """Return how a candidate does beside the selected ones."""
        return self._trial(candidate, rest, rest.extended(candidate))

    def _trial(self, candidate: Candidate, rest: FitContext, whole: FitContext) -> EffectTrial:
        """Return how a candidate does, whether it comes or stays: by the same measure.

        Bonferroni's correction is for all torques that were compared (:class:`Multiplicity`).
        """
        validation, settings = rest.validation, self.settings
        before, after = rest.score, whole.score
        theta = next(values for other, values in whole.fitted if other is candidate)
        possible = are_possible(candidate, whole.fitted)
        inflation = validation.inflation(after.error, before.error - after.error)
        comparisons = self.multiplicity.n_comparisons(candidate)
        p_value = validation.p_value(before, after, candidate, inflation, comparisons)
        used = (validation.weight > 0.0) & candidate.acts
        removed = 1.0 - after.rms / np.maximum(before.rms, 1e-300)
        size = np.where(used, validation.size(candidate, theta), 0.0)
        if validation.model_size:
            # What the model's parameters would make up for as best they can is not theirs.
            with_torque = np.maximum(np.hypot(after.rms, size), 1e-300)
            removed = np.fmax(removed, 1.0 - after.rms / with_torque)
        most = float(np.max(removed[used], initial=0.0))
        gain = after.likelihood - before.likelihood
        torque = validation.torque(candidate, theta)
        expected = rest.friction.explains(candidate.hypothesis.effect, torque)
        matters = used & (size >= settings.least(validation, rest.friction.uncertain))
        passes = p_value < settings.alpha and possible and bool(matters.any())
        changed = self._change_fraction(candidate, rest) if passes else 1.0
        if changed < 1.0:
            p_value = validation.p_value(before, after, candidate, inflation, comparisons, changed)
        seen_before = passes and p_value >= settings.alpha
        day_to_day = bool(np.any(expected & (size > 0.0))) and not np.any(matters & ~expected)
        largest = float(np.max(inflation[candidate.acts]))
        if passes and candidate.hypothesis.common_cause:
            # Friction varies from day to day at all joints, but not equally: there what is common
            # has to be more, in squares, than what differs.
            likelihood = after.likelihood + settings.equal_least * largest
            passes = (
                variation(rest, candidate, theta) < 1.0
                if day_to_day
                else homogeneous(rest, candidate, theta, likelihood, settings.least(validation))
            )
        return EffectTrial(
            candidate, gain, passes and not seen_before, after, p_value, most, possible,
            candidate.hypothesis.typical(theta), np.where(expected, 0.0, size), largest, day_to_day,
            seen_before,
        )  # fmt: skip

    @cached_property
    def multiplicity(self) -> Multiplicity:
        """How many torques are compared at each step: that most are screened out is chance, too."""
        return Multiplicity.of(self.moves(self.at((*self.always, *self.ordinary))))

    def _change_fraction(self, candidate: Candidate, rest: FitContext) -> float:
        """Return the fraction of a candidate's evidence not already present at calibration."""
        misfit = None if self.at_calibration is None else self.at_calibration.misfit(candidate)
        if misfit is None:
            return 1.0
        theta, covariance = rest.validation.fit([*rest.candidates, candidate])
        own = slice(len(theta) - candidate.size, len(theta))
        return misfit.changed_fraction(theta[own], covariance[own, own])

    def is_significant(self, selected: FitContext, candidate: Candidate) -> bool:
        """Return whether one of those selected is significant without held-out blocks.

        What comes once, and is over before one of them, is not: a joint that slips once looks so.
        """
        if candidate.hypothesis.transient:
            return False
        (trial,) = self._without(selected, [candidate])
        return trial.p_value < self.settings.unseen

    def _without(self, selected: FitContext, looked_at: Iterable[Candidate]) -> list[EffectTrial]:
        """Return how some of the selected do beside all others."""
        return [self._trial(each, selected.without(each), selected) for each in looked_at]

    def _searched(self, selected: FitContext) -> list[Candidate]:
        """Return the hypotheses that are found in what is not explained."""
        data, validation = self.validation.data, selected.validation
        allowed = data.fold >= 0
        weight = allowed[:, None] * validation.weight**2
        residual = Residual(data, validation.residual(selected.candidates), weight, allowed)
        found = (
            hypothesis
            for effect, basis in data.search_bases.items()
            for hypothesis in effect.search(basis, residual)
        )
        return list(data.candidates(found))

    def as_good(self, trial: EffectTrial, best: EffectTrial) -> bool:
        """Return whether the data cannot show that one hypothesis is worse than another."""
        settings, spread = self.settings, self.validation.spread(best.score, trial.score)
        margin = min(settings.equal * spread, settings.equal_most * best.gain)
        return trial.gain > best.gain - max(margin, settings.equal_least * best.inflation)

    def eliminate_backward(self, selected: Sequence[Candidate]) -> FitContext:
        """Return those that are still significant and worth having when all is known.

        The weakest goes first, since others may take its place. Parameters of the model that moved
        along stay if they help to predict what they have not seen.
        """

        def failing(kept: list[Candidate]) -> list[tuple[float, Candidate]]:
            context = self.at(kept, final=True)
            return [
                (trial.gain, trial.candidate)
                for trial in self._without(context, kept)
                if not (
                    trial.gain + trial.candidate.cost > 0.0
                    if trial.candidate in self.always
                    else trial.passes
                )
            ]

        kept = eliminate_backward(
            selected, failing, lambda gone: self.report(f"not confirmed: {gone.hypothesis}")
        )
        return self.at(kept, final=True)

    def preferred(self, trials: Sequence[EffectTrial]) -> EffectTrial:
        """Return the day-to-day variation or the most parsimonious of those as good as the best.

        What likely causes it (``Hypothesis.EXPLAINED_BY``) goes before that.
        """
        best = max(trials, key=lambda trial: trial.gain)
        equal = [trial for trial in trials if self.as_good(trial, best)]
        expected = [trial for trial in equal if trial.day_to_day]
        if expected:
            return max(expected, key=lambda trial: trial.gain)
        gains = [(trial.gain, trial.candidate) for trial in equal]
        chosen = most_parsimonious(gains, self.settings.equal_least)
        causes = [
            trial
            for trial in equal
            if trial.candidate.hypothesis.effect == chosen.hypothesis.EXPLAINED_BY and trial.typical
        ]
        if causes:
            return max(causes, key=lambda trial: trial.gain)
        return next(trial for trial in trials if trial.candidate is chosen)
