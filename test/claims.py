"""Small problems of inference: claims of torques of known shapes, and samples that hold some."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from diagnosed import ARM, eye, model, moving

from dvrk_gravity.diagnosis import Candidate, CrossValidation, FilteredData, load
from dvrk_gravity.effects import OffsetHypothesis, Site

N = ARM.n


@cache
def data() -> FilteredData:
    """Return twenty seconds of the small arm, all of whose torque its model explains."""
    motion = moving(0, 20.0)
    effort = model().torque(motion.q, motion.qd, motion.qdd)
    return FilteredData.of(load([motion.read(effort)], model()))


@dataclass(frozen=True, eq=False, kw_only=True)
class Claim(OffsetHypothesis):
    searched: int

    @property
    def n_comparisons(self) -> int:
        return self.searched


def claim(joint: int, form: str = "", searched: int = 1, shape: np.ndarray | None = None):
    """Return a claim that a joint has a torque of some (T,) shape, by default a constant."""
    hypothesis = Claim(
        arm=ARM, site=Site.joint(joint), joints=(joint,), form=form, searched=searched
    )
    values = np.ones(len(data().residual)) if shape is None else shape
    return Candidate.of(hypothesis, (values[:, None] * eye(joint))[:, :, None])


@cache
def pool(count: int = 12) -> tuple[Candidate, ...]:
    """Return claims of smooth random shapes, some a joint."""
    random = np.random.default_rng(0)
    time = data().time[:, None]
    phase, rate = random.uniform(0.0, 6.0, count), random.uniform(1.0, 6.0, count)
    shapes = np.sin(rate * time + phase)
    return tuple(claim(i % N, f"shape {i}", shape=shape) for i, shape in enumerate(shapes.T))


def problem(chosen: dict[int, float], seed: int = 0) -> CrossValidation:
    """Return samples that hold sizes of some of the pool, and white noise of 0.05 N·m or N."""
    noise = 0.05 * np.random.default_rng(seed).normal(size=data().residual.shape)
    torque = sum(size * pool()[i].columns()[..., 0] for i, size in chosen.items())
    return CrossValidation.of(replace(data(), residual=noise + torque))


def names(candidates) -> set[str]:
    return {candidate.hypothesis.form for candidate in candidates}
