"""How often the intervals of causes that are not there hold zero, with identified models.

    python benchmark/parameter_intervals.py --seeds 401 411

Every seed draws an arm of MuJoCo's (testing/mujoco_world.py), records a calibration motion,
identifies it, and then records other motions of the same arm with nothing hidden. Hypotheses of
every effect are fitted to each, chosen at random and not by what they explain: what a parameter is
estimated to be is an error then. Counted is how often the 95 % region of a hypothesis' parameters
holds zero: of noise alone; with a part of the known error (``SignificanceSettings.coherent``), as
of a model whose calibration is not kept; of the change beside what its calibration shows of the
cause, by which is judged; and as findings are told.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis import (
    AtCalibration,
    Candidate,
    CrossValidation,
    FilteredData,
    RecurringMisfit,
    every_hypothesis,
    load,
)
from testing.clean_motions import clean_motions, of_each_arm

EACH = 6  # hypotheses of an effect in a recording
REGIONS = ("noise", "part", "change", "told")
Held = tuple[str, str, tuple[bool, ...]]
"""Arm, effect, and whether each of ``REGIONS`` holds zero."""


def regions(name: str, seed: int) -> list[Held]:
    """Return of the hypotheses in every motion of an arm whether their regions hold zero."""
    random, found = np.random.default_rng([seed, 1]), []
    for model, recording in clean_motions(name, seed, random):
        motion = load([recording], model)
        validation, then = CrossValidation.of(FilteredData.of(motion)), AtCalibration.of(motion)
        assert then is not None
        for candidate in _sample(validation, random):
            weighted = validation.weighted([candidate], final=True)
            held = tuple(_hold_zero(weighted, candidate, then))
            found.append((name, candidate.hypothesis.effect, held))
    return found


def _sample(validation: CrossValidation, random: np.random.Generator) -> Iterator[Candidate]:
    """Yield a few hypotheses of every effect, those of one link or joint only."""
    by_effect: dict[str, list[Candidate]] = {}
    for candidate in validation.data.candidates(every_hypothesis(validation.data.motion)):
        # What acts only where nothing may be learned has no estimate.
        felt = validation.size(candidate, np.ones(candidate.size)).any()
        if np.isfinite(candidate.values).all() and felt and not candidate.hypothesis.refits_model:
            by_effect.setdefault(candidate.hypothesis.effect, []).append(candidate)
    for candidates in by_effect.values():
        chosen = random.permutation(len(candidates))[:EACH]
        yield from (candidates[i] for i in chosen)


def _hold_zero(
    validation: CrossValidation, candidate: Candidate, then: AtCalibration
) -> Iterator[bool]:
    """Yield whether each of ``REGIONS`` holds zero."""
    settings = replace(validation.significance.settings, coherent=0.0)
    incoherent = replace(validation.significance, settings=settings)
    yield _holds_zero(*replace(validation, significance=incoherent).fit([candidate]))
    yield _holds_zero(*validation.fit([candidate]))
    theta, covariance = validation.fit([candidate])
    back = then.misfit(candidate) or RecurringMisfit(0.0 * theta, 0.0 * covariance)
    yield _holds_zero(theta - back.mean, covariance + back.variance)
    yield _holds_zero(theta, covariance + back.spread)


def _holds_zero(theta: Array, covariance: Array) -> bool:
    told = np.diag(covariance) > 0.0  # a column that is zero has no estimate
    sd = np.sqrt(np.diag(covariance)[told])
    correlation = covariance[np.ix_(told, told)] / np.outer(sd, sd)
    scaled = theta[told] / sd
    distance = scaled @ np.linalg.pinv(correlation, hermitian=True) @ scaled
    return bool(distance < chi2.ppf(0.95, len(sd)))


def _table(rows: Iterable[tuple[str, tuple[bool, ...]]]) -> str:
    counts: dict[str, list[tuple[bool, ...]]] = {}
    for kind, held in rows:
        counts.setdefault(kind, []).append(held)
    return "\n".join(_line(kind, held) for kind, held in sorted(counts.items()))


def _line(kind: str, held: Sequence[tuple[bool, ...]]) -> str:
    shares = 100 * np.mean(np.array(held), axis=0)
    return f"{kind:24s} {len(held):5d}  " + "".join(f"{share:7.1f}" for share in shares)


def main(given: Sequence[str] | None = None) -> int:
    """Print the table."""
    found: list[Held] = []
    for name, seed, held in of_each_arm(regions, __doc__, given):
        found += held
        print(f"{name} {seed}: {len(held)} hypotheses", file=sys.stderr, flush=True)
    heading = "".join(f"{region:>7s}" for region in REGIONS)
    print(f"{'% that hold zero':24s} {'of':>5s}  {heading}")
    print(_table((effect, held) for _, effect, held in found))
    print(_table((arm, held) for arm, _, held in found))
    print(_line("all", [held for _, _, held in found]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
