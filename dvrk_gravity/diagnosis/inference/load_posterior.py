"""Mass and place of a load: their posterior over all bodies and places that the data allow.

Torque shows a load's weight moment well, its mass only by inertia, and hardly on which body it
is. A point mass m at p of a body adds ``X (1, p, p p') m`` with columns X of that body: quadratic
in the place, linear in the mass. Of Gaussian errors the likelihood is a quadratic form in these ten
numbers, and the mass is integrated in closed form. Places are drawn by tempering from their prior
to the posterior (sequential Monte Carlo; Del Moral, Doucet and Jasra 2006), which also gives each
body's marginal likelihood. A body on which few places explain the data thereby weighs less.

Before any data the logarithm of a mass at an unknown place is as likely to be anywhere (Jeffreys'
prior of a scale), down to what the data resolve. Were it the mass itself, a moment without inertia,
as slow motion shows it, would be a heavy mass near the axis. Any distance from the link's frame is
as likely, within the link's extent: links are slender. Were it any point of the space about it,
hardly a load would be near the frame, and the same moment farther out is a lighter mass.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.diagnosis.data.candidate import Candidate
from dvrk_gravity.diagnosis.data.expectation import load_columns
from dvrk_gravity.diagnosis.inference.cross_validation import CrossValidation
from dvrk_gravity.effects import (
    Estimate,
    Hypothesis,
    Site,
    heaviest,
    link_sizes,
    place_terms,
    point_mass_directions,
)
from dvrk_gravity.estimation import solve

_DRAWS = 1000  # places of a body: 25 lie beyond either end of a 95 % interval
_MOVES = 4  # Metropolis steps of each place at a temperature. Chosen
_KEPT = 0.5  # of the draws, that a temperature leaves effective; a convention
_STEP = 2.38 / np.sqrt(3.0)  # of a random walk in three dimensions (Gelman, Roberts, Gilks 1996)
_TRACE = 1e-9
_THICK = 0.1  # of a link's extent, within which any point is as likely. Chosen
_EXPLAINED = 0.5  # of what the best body explains, that another must that may carry it. Chosen


@dataclass(frozen=True, eq=False)
class LoadPosterior:
    """Equally probable draws of a load on each body of an arm, or at the place that was stated.

    Attributes:
        mass: (bodies, S) kg; negative where a load was taken off.
        place: (bodies, S, 3) m, in the body's link frame.
        share: (bodies,) probability that this body carries it.
        best: Its parameters by the best fit; ``None``: that is at no likely place.
    """

    mass: Array
    place: Array
    share: Array
    best: Mapping[str, float] | None

    @classmethod
    def of(
        cls, validation: CrossValidation, chosen: Sequence[Candidate], load: Candidate,
        theta: Array, spread: Array,
    ) -> LoadPosterior:  # fmt: skip
        """Return the posterior of a load in the place of a payload that was found.

        Args:
            validation: The samples.
            chosen: All causes that were found.
            load: The payload among them.
            theta: (k,) its parameters by the best fit at one place.
            spread: (k, k) covariance that noise does not show: of what recurs with the motion, and
                of drive gains.
        """
        arm = load.hypothesis.arm
        problem = _Problem.of(validation, chosen, load, theta, spread, changed=True)
        stated = validation.data.motion.payload_at
        if stated is not None:
            # A constant or a spring at a joint looks like the load there.
            kept = [
                each
                for each in chosen
                if each is load
                or each.hypothesis.variable != "position"
                or not each.hypothesis.joints
            ]
            alone = _Problem.of(validation, kept, load, theta, spread, changed=False)
            return cls._at(load.hypothesis, (alone, problem), *stated)
        best = load.hypothesis.parameters(theta)
        return cls.drawn(map(problem.form, range(len(arm.bodies))), arm, best, problem.sign)

    @classmethod
    def drawn(
        cls, forms: Iterable[LoadLikelihood], arm: Arm, best: Mapping[str, float] | None,
        sign: float = 1.0,
    ) -> LoadPosterior:  # fmt: skip
        """Return the posterior of a load that was found, on whatever body.

        Args:
            forms: Likelihood on each of the arm's bodies.
            arm: The arm.
            best: Parameters by the best fit; ``None``: that is at no likely place.
            sign: Whether it was put on or taken off.
        """
        random = np.random.default_rng(0)
        places, masses, evidence, explained = [], [], [], []
        for form, (_, extent) in zip(forms, link_sizes(arm), strict=True):
            place, likelihood = _tempered(form, extent, random)
            mass = form.draw(place, random)
            weight = 1.0 / np.maximum(mass, form.resolved(place))
            rows = random.choice(_DRAWS, _DRAWS, p=weight / weight.sum())
            places.append(place[rows])
            masses.append(sign * mass[rows])
            # As likely at any place of any body: a small one has fewer.
            evidence.append(likelihood + np.log(weight.mean() * extent**3))
            explained.append(float(form.explained(place).max()))
        share = np.exp(np.array(evidence) - max(evidence))
        # A load was found: on a body where it has no torque it would be none, of any mass.
        share[np.array(explained) < _EXPLAINED * max(explained)] = 0.0
        return cls(np.array(masses), np.array(places), share / share.sum(), best)

    @classmethod
    def _at(
        cls, hypothesis: Hypothesis, problems: Sequence[_Problem], body: int, place: Array
    ) -> LoadPosterior:
        """Return the posterior of the mass at a place that is known.

        That the load is there is known: the mass that is reported is that of the first problem,
        which leaves nothing that the load explains to other causes; the interval holds both.
        """
        places, random = np.tile(place, (_DRAWS, 1)), np.random.default_rng(0)
        alone, beside = (each.sign * each.form(body).draw(places, random) for each in problems)
        best = hypothesis.parameters(np.array([np.median(alone)]))
        mass = np.concatenate([alone, beside])
        return cls(mass[None], np.tile(place, (1, 2 * _DRAWS, 1)), np.ones(1), best)

    def estimates(self, hypothesis: Hypothesis) -> dict[str, Estimate]:
        """Return the parameters of a payload with 95 % intervals: of mass on whatever body.

        Its place is that on the body that the hypothesis names. The values are those of the best
        fit, if its mass is in the interval, else medians.

        Args:
            hypothesis: The payload.
        """
        bodies = len(self.share)
        body = hypothesis.site.index if bodies > 1 else 0
        mass, place, equal = self.mass[body], self.place[body], np.ones(len(self.mass[body]))
        draws = {"mass": (self.mass.ravel(), np.repeat(self.share, self.mass.shape[1]))}
        for axis, along in zip(hypothesis.setting, place.T, strict=True):
            draws[f"first_moment_{axis}"] = mass * along, equal
            draws[axis] = along, equal
        drawn = {
            name: Estimate(*_quantiles(*weighted), hypothesis.unit(name))
            for name, weighted in draws.items()
        }
        best = self.best
        if best is None or not drawn["mass"].low <= best["mass"] <= drawn["mass"].high:
            return drawn
        return {name: _at_fit(each, best[name]) for name, each in drawn.items()}


def _at_fit(drawn: Estimate, value: float) -> Estimate:
    """Return an estimate with the fit's value, and an interval that holds it."""
    return replace(drawn, value=value, low=min(drawn.low, value), high=max(drawn.high, value))


def _quantiles(values: Array, weight: Array) -> tuple[float, float, float]:
    """Return median, 2.5 and 97.5 % quantiles of weighted draws."""
    order = np.argsort(values)
    reached = np.cumsum(weight[order]) / weight.sum()
    rows = np.minimum(np.searchsorted(reached, [0.5, 0.025, 0.975]), len(values) - 1)
    middle, low, high = values[order][rows].tolist()
    return middle, low, high


@dataclass(frozen=True, eq=False)
class _Problem:
    """Samples in which a load is looked for, beside all else that may be off.

    Attributes:
        validation: The samples.
        load: The payload.
        sign: Whether it was put on or taken off.
        weight: (R n,) of the samples, so that a unit error is one standard deviation.
        base: (R n, d) weighted columns of what may be off.
        gram: (d, d) their products, and what is known of them.
        target: (R n,) weighted residual.
    """

    validation: CrossValidation
    load: Candidate
    sign: float
    weight: Array
    base: Array
    gram: Array
    target: Array

    @classmethod
    def of(
        cls, validation: CrossValidation, chosen: Sequence[Candidate], load: Candidate,
        theta: Array, spread: Array, changed: bool,
    ) -> _Problem:  # fmt: skip
        """Return it; ``changed``: springs, constants and friction may have changed."""
        data = validation.data
        rest = [other for other in chosen if other is not load]
        before, after = (validation.out_of_fold(causes) for causes in (rest, chosen))
        independent = validation.inflation(after, before - after) * validation.redundancy
        weight = np.tile(1.0 / np.sqrt(independent), len(after))
        base, size = validation.regression(rest).design, 0
        if changed:
            torque = load.hypothesis.regressor(data.motion) @ theta
            columns = Candidate.of(load.hypothesis, data.reduce(load_columns(data.motion, torque)))
            base, size = np.hstack([base, validation.design([columns])]), columns.size
        # Errors that look like the load that was found, as large as its parameters' spread.
        size += len(theta)
        base = np.hstack([base, validation.design([load]) @ _root(spread)])
        ridges = [np.ones(validation.model_size), *(other.ridge for other in rest), np.ones(size)]
        base = base * weight[:, None]
        target = (validation.of_choice(data.residual) * validation.weight).ravel() * weight
        gram = base.T @ base + np.diag(np.concatenate(ridges))
        target = target - base @ solve(gram, base.T @ target, _TRACE)
        sign = -1.0 if theta[0] < 0.0 and load.hypothesis.against_reference else 1.0
        return cls(validation, load, sign, weight, base, gram, target)

    def form(self, body: int) -> LoadLikelihood:
        """Return the likelihood of a mass at a place of a body."""
        hypothesis, data = self.load.hypothesis, self.validation.data
        columns = data.motion.link_torque(body, point_mass_directions(hypothesis.arm, body))
        here = replace(hypothesis, site=Site.link(body), joints=())
        own = self.validation.design([Candidate.of(here, data.reduce(columns))])
        own *= self.weight[:, None]
        products = own.T @ self.base
        precision = own.T @ own - products @ solve(self.gram, products.T, _TRACE)
        return LoadLikelihood(precision, self.sign * own.T @ self.target, heaviest(hypothesis.arm))


def _root(covariance: Array) -> Array:
    """Return (k, k) R, R R' = covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


@dataclass(frozen=True, eq=False)
class LoadLikelihood:
    """Log-likelihood of a mass at a place: ``b' m z - m^2 z' A z / 2``, z the place's ten terms.

    The mass is half normal before any data.

    Attributes:
        precision: (10, 10) A.
        score: (10,) b.
        plausible: kg, standard deviation of the mass.
    """

    precision: Array
    score: Array
    plausible: float

    def _mass(self, place: Array) -> tuple[Array, Array]:
        """Return (S,) precision of the mass at (S, 3) places, and its mean times that."""
        terms = place_terms(place)
        precision = np.einsum("sk,kl,sl->s", terms, self.precision, terms)
        return np.maximum(precision, 0.0) + self.plausible**-2, terms @ self.score

    def explained(self, place: Array) -> Array:
        """Return (S,) log-likelihoods over those of no load, of the best mass at (S, 3) places."""
        precision, score = self._mass(place)
        return 0.5 * np.maximum(score, 0.0) ** 2 / precision

    def log_likelihood(self, place: Array) -> Array:
        """Return (S,) log-likelihoods of (S, 3) places, the mass integrated."""
        from scipy.special import log_ndtr

        precision, score = self._mass(place)
        root = np.sqrt(precision)
        mean = score / root
        return 0.5 * mean**2 + log_ndtr(mean) - np.log(0.5 * self.plausible * root)

    def resolved(self, place: Array) -> Array:
        """Return (S,) standard errors of the mass at (S, 3) places."""
        return np.asarray(1.0 / np.sqrt(self._mass(place)[0]))

    def draw(self, place: Array, random: np.random.Generator) -> Array:
        """Return (S,) masses, kg, one at each of (S, 3) places."""
        from scipy.special import ndtr, ndtri

        precision, score = self._mass(place)
        root = np.sqrt(precision)
        least = ndtr(-score / root)  # of a normal that is cut off at zero
        chance = least + (1.0 - least) * random.uniform(size=len(place))
        return np.maximum((score / root + ndtri(np.clip(chance, 1e-12, 1.0 - 1e-12))) / root, 0.0)


def _tempered(
    form: LoadLikelihood, extent: float, random: np.random.Generator
) -> tuple[Array, float]:
    """Return (S, 3) places drawn from their posterior, and the log marginal likelihood.

    Args:
        form: The likelihood.
        extent: m, of the half normal distance from the link's frame before any data, in whatever
            direction.
        random: Source of draws.
    """
    thickness = _THICK * extent

    def log_prior(place: Array) -> Array:
        square = (place**2).sum(axis=1)
        return np.asarray(-0.5 * square / extent**2 - np.log(square + thickness**2))

    place = random.normal(size=(_DRAWS, 3))
    place *= extent * random.normal(size=(_DRAWS, 1)) / np.linalg.norm(place, axis=1)[:, None]
    square = (place**2).sum(axis=1)
    inside = square / (square + thickness**2)
    place = place[random.choice(_DRAWS, _DRAWS, p=inside / inside.sum())]
    value, evidence, warmth = form.log_likelihood(place), 0.0, 0.0
    while warmth < 1.0:
        step = _next_step(value, 1.0 - warmth)
        weight = np.exp(step * (value - value.max()))
        evidence += float(np.log(weight.mean()) + step * value.max())
        warmth += step
        rows = random.choice(_DRAWS, _DRAWS, p=weight / weight.sum())
        place, value = place[rows], value[rows]
        root = np.linalg.cholesky(np.cov(place.T) + 1e-12 * extent**2 * np.eye(3))
        for _ in range(_MOVES):
            there = place + _STEP * random.normal(size=place.shape) @ root.T
            found = form.log_likelihood(there)
            rise = warmth * (found - value) + log_prior(there) - log_prior(place)
            taken = np.log(random.uniform(size=_DRAWS)) < rise
            place[taken], value[taken] = there[taken], found[taken]
    return place, evidence


def _next_step(value: Array, most: float) -> float:
    """Return by how much a temperature may rise, so that half of the draws stay effective."""

    def effective(step: float) -> float:
        weight = np.exp(step * (value - value.max()))
        return float(weight.sum() ** 2 / (weight**2).sum())

    if effective(most) >= _KEPT * len(value):
        return most
    low, high = 0.0, most
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if effective(middle) >= _KEPT * len(value) else (low, middle)
    return max(low, 1e-6)
