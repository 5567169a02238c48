"""The diagnosis itself: readings, then physics, then what has no name, then the proof."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity import effects
from dvrk_gravity.diagnosis.assemble import assemble
from dvrk_gravity.diagnosis.bench import Bench
from dvrk_gravity.diagnosis.candidate import Candidate
from dvrk_gravity.diagnosis.contest import Contest
from dvrk_gravity.diagnosis.findings import Diagnosis
from dvrk_gravity.diagnosis.in_simulation import in_simulation
from dvrk_gravity.diagnosis.judge import Judge, Unconfirmed
from dvrk_gravity.diagnosis.load import Loaded, load
from dvrk_gravity.diagnosis.motion import Motion
from dvrk_gravity.diagnosis.readings import ReadingScore, read_as, try_readings
from dvrk_gravity.diagnosis.selection import LEAST_GAIN, Accepted, Selection, Tried
from dvrk_gravity.effects.effect import Hypothesis
from dvrk_gravity.effects.site import Kind
from dvrk_gravity.effects.unknown import nameless
from dvrk_gravity.identification.motion import known_still
from dvrk_gravity.model import TorqueModel
from dvrk_gravity.recording import Given, Recording, RecordingFile, opened
from dvrk_gravity.recording.data import Coordinates

Array = NDArray[np.float64]

_READING_SHARE = 0.7  # of the best hypothesis' gain, that another reading must reach
_LEAST_UNKNOWN = 1.5 * LEAST_GAIN
_MOST_UNKNOWN = 3
_MODEL_DOUBTFUL = 1.5  # times the noise, left by all that was found
_MOVING_GAIN = 20.0  # log-likelihood, all costs taken off
_ATTEMPTS = 3  # at a choice that the held-out blocks confirm
_AT_FLOOR = 1.05  # times the noise: nothing worth finding is left
_MIMIC = 0.5  # share of a nameless function's gain below which a name does not fit


@dataclass(frozen=True, eq=False)
class Outcome:
    """What was accepted, before it is put into words.

    Attributes:
        loaded: The motion as it was finally read.
        readings: Wrong readings found, each with the motion read as it was before.
        contest: The contest.
        accepted: Named effects in order.
        unknown: Structure without a name.
        unconfirmed: Effects that the held-out blocks do not show.
        pool: Hypotheses that need no search.
    """

    loaded: Loaded
    readings: tuple[tuple[ReadingScore, Motion, tuple[ReadingScore, ...]], ...]
    contest: Contest
    accepted: tuple[Accepted, ...]
    unknown: tuple[Tried, ...]
    unconfirmed: tuple[Unconfirmed, ...]
    pool: tuple[Candidate, ...]


def diagnose(
    recordings: Given | Iterable[Given],
    model: TorqueModel | str | Path,
    progress: Callable[[str], None] | None = None,
    simulated: bool = False,
    still: Mapping[str, float] | None = None,
    coordinates: Coordinates = "joint",
) -> Diagnosis:
    """Tell what a model gets wrong about recordings, and prove it on data held out.

    Args:
        recordings: One or more trajectories, or sets of static poses; in joint or actuator
            coordinates, as each says; or the paths of their files. Of trajectories longer than ten
            minutes together, stretches are looked at; one in a file is not held in memory then.
        model: The model on trial, or the path of its file.
        progress: Called with one line at every step.
        simulated: Also compare given and extended model in the simulator, which takes seconds.
        still: Where joints stood that the recordings do not hold: joint position, rad.
        coordinates: Of recordings that are given as files, which do not tell.

    Returns:
        Findings, gains on held-out blocks, and the model extended by what it can carry.

    Raises:
        RecordingError: Recordings that cannot tell: too short, no effort, no motion.
        ConfigError: A model of absurd torques.
        ArgumentError: An argument of a wrong type.
    """
    model = TorqueModel.of(model)
    whole = opened(recordings, coordinates, model.arm)
    say = progress or _silent
    say("reading")
    outcome = investigate(whole, model, say, known_still(still))
    say("measuring gains on held-out blocks")
    diagnosis = assemble(
        outcome.loaded, outcome.readings, outcome.contest, outcome.accepted, outcome.unknown,
        outcome.unconfirmed, outcome.pool,
    )  # fmt: skip
    if not simulated or not any(finding.in_model for finding in diagnosis.findings):
        return diagnosis
    say("simulating motion and drift")
    spans = outcome.contest.bench.held_out_spans
    compared = in_simulation(model, diagnosis.model, outcome.loaded.motion, spans)
    return replace(diagnosis, in_simulation=compared)


def investigate(
    recordings: Sequence[Recording | RecordingFile],
    model: TorqueModel,
    say: Callable[[str], None],
    still: Mapping[str, float] | None = None,
) -> Outcome:
    """Choose readings, effects and nameless structure; the arguments are :func:`diagnose`'s."""
    loaded = load(recordings, model, still)
    readings: list[tuple[ReadingScore, Motion, tuple[ReadingScore, ...]]] = []
    contest, pool = _prepare(loaded.motion, say)
    tried = try_readings(loaded.motion)
    if tried and tried[0].passes and _misread(tried[0], Selection(contest, pool, say)):
        alike = tuple(s for s in tried[1:] if s.gain > 0.97 * tried[0].gain)
        readings.append((tried[0], loaded.motion, alike))
        say(f"wrong reading: {tried[0].reading.words}")
        contest.release()
        del contest, pool  # of a long recording there is no room for two
        loaded = replace(loaded, motion=read_as(loaded.motion, tried[0].reading))
        contest, pool = _prepare(loaded.motion, say)
    selection = Selection(contest, pool, say)
    say("weighing hypotheses")
    chosen = selection.run()
    floor = contest.bench.floor(loaded.floor, contest.left(chosen))
    if np.any(contest.score(chosen).rms > _MODEL_DOUBTFUL * floor):
        selection, chosen = _with_model_moving(contest, pool, selection, chosen, say)
    chosen, unconfirmed = _confirmed(contest, selection, chosen, say)
    # Masses that only moved along are no cause: they come last.
    chosen.sort(key=lambda one: one.hypothesis.of_model)
    accepted = selection.explained(chosen)
    say("looking for structure without a name")
    floor = contest.bench.floor(loaded.floor, contest.left(chosen))
    contest.release()
    accepted, unknown = _nameless(contest, selection, accepted, floor)
    return Outcome(loaded, tuple(readings), contest, tuple(accepted), tuple(unknown),
                   tuple(unconfirmed), tuple(pool))  # fmt: skip


def _misread(reading: ReadingScore, selection: Selection) -> bool:
    """Tell whether another reading does about as well as the best hypothesis, or better."""
    best = selection.best([], selection.contest.score([]))
    return not best or reading.gain > _READING_SHARE * best[0].gain


def _with_model_moving(
    contest: Contest,
    pool: Sequence[Candidate],
    selection: Selection,
    chosen: list[Candidate],
    say: Callable[[str], None],
) -> tuple[Selection, list[Candidate]]:
    """Return the better of a choice and one beside which the model's masses are fitted anew.

    Masses that were fitted without a cause that is missing have made up for it as far as they
    could; only when they move along does the cause get its due.
    """
    say("weighing hypotheses with the model's own parameters moving along")
    always = [one for one in pool if one.hypothesis.of_model]
    # What links weigh is theirs to say now.
    pool = [one for one in pool if one in always or one.hypothesis.site.kind is not Kind.LINK]
    moving = Selection(contest, pool, say, always)
    other = moving.run()
    contest.weigh(contest.out_of_fold(other))
    whole = contest.score(other).likelihood
    # What the masses overfit shows in the folds that they have not seen: no further cost.
    gain = whole + sum(one.cost for one in always) - contest.score(chosen).likelihood
    if gain <= _MOVING_GAIN:
        return selection, chosen
    return moving, other


def _confirmed(
    contest: Contest,
    selection: Selection,
    chosen: list[Candidate],
    say: Callable[[str], None],
) -> tuple[list[Candidate], list[Unconfirmed]]:
    """Return the effects that hold in the end, and those that the held-out blocks do not confirm.

    In the place of one that fails the choice may find a simpler one.
    """
    unconfirmed: list[Unconfirmed] = []
    for attempt in range(_ATTEMPTS):
        say("comparing alternatives")
        chosen = selection.confirmed(selection.fewer(selection.settled(chosen)))
        chosen, failed = _held_out_confirms(contest, chosen)
        unconfirmed += failed
        if not failed or attempt == _ATTEMPTS - 1:
            break
        selection.exclude(one.hypothesis for one in failed)
        chosen = selection.run(chosen)
    return chosen, unconfirmed


def _held_out_confirms(
    contest: Contest, chosen: Sequence[Candidate]
) -> tuple[list[Candidate], list[Unconfirmed]]:
    """Return the effects that blocks show which no choice had seen, and those that they do not."""
    kept, failed = list(chosen), []
    while kept:
        contest.weigh(contest.out_of_fold(kept))
        judge = Judge(contest)
        failures = [
            (failure, one) for one in kept
            if not one.hypothesis.of_model and (failure := judge.unconfirmed(kept, one))
        ]  # fmt: skip
        if not failures:
            break
        # The weakest first: of two that share one torque, either may hold without the other.
        worst, which = min(failures, key=lambda pair: pair[0].gain.relative)
        failed.append(worst)
        kept = [one for one in kept if one is not which]
    return kept, failed


def hypotheses(motion: Motion) -> Iterable[Hypothesis]:
    """Yield every hypothesis that needs no search in the residual."""
    for effect in effects.effects():
        yield from effect.hypotheses(motion)


def _prepare(motion: Motion, say: Callable[[str], None]) -> tuple[Contest, list[Candidate]]:
    say("building hypotheses")
    contest = Contest(Bench.of(motion))
    pool = [contest.candidate(one) for one in hypotheses(motion)]
    return contest, [one for one in pool if np.isfinite(one.values).all() and one.acts.any()]


def _nameless(
    contest: Contest, selection: Selection, accepted: list[Accepted], floor: Array
) -> tuple[list[Accepted], list[Tried]]:
    """Return the accepted effects that bear their name, and structure that no name fits."""
    named = [one.tried.candidate for one in accepted]
    present = contest.bench.motion.present
    clean = contest.score(named).rms <= _AT_FLOOR * floor  # false where the floor is not known
    joints = np.flatnonzero(present & ~clean).tolist()
    pool = [contest.candidate(one) for one in nameless(contest.bench.motion, joints)]
    unknown: list[Tried] = []
    while len(unknown) < _MOST_UNKNOWN:
        beside = [*named, *(one.candidate for one in unknown)]
        contest.weigh(contest.out_of_fold(beside), final=True)
        before = contest.score(beside)
        best = selection.best(beside, before, pool)
        strong = [one for one in best if one.passes and one.removed > _LEAST_UNKNOWN]
        if not strong:
            break
        unknown.append(strong[0])
    judge = Judge(contest)
    unknown = [
        one for one in unknown if judge.unconfirmed([*named, one.candidate], one.candidate) is None
    ]
    for found in unknown:
        named = [one for one in named if not _mimics(contest, named, one, found.candidate)]
    kept = [one for one in accepted if any(one.tried.candidate is other for other in named)]
    return kept, unknown


def _mimics(
    contest: Contest, named: Sequence[Candidate], one: Candidate, nameless: Candidate
) -> bool:
    """Tell whether a nameless function does so much better that the name does not fit."""
    if not set(one.hypothesis.joints) & set(nameless.hypothesis.joints):
        return False
    rest = [other for other in named if other is not one]
    without = contest.score(rest).likelihood
    mine = contest.score([*rest, one]).likelihood - without
    its = contest.score([*rest, nameless]).likelihood - without
    return mine < _MIMIC * its


def _silent(line: str) -> None:
    del line
