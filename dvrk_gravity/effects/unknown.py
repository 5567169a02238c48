"""Unexplained structure: smooth functions of whatever was measured. A legal answer."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.effect import Effect, Hypothesis, spread
from dvrk_gravity.effects.base.meaning import Meaning, meanings
from dvrk_gravity.effects.base.motion import Motion
from dvrk_gravity.effects.base.site import Site

Basis = Callable[[Motion], Array]

_CENTRES = 7  # of a smooth function of a position, velocity or acceleration
_IN_TIME = 12  # of one of time
_BY_DIRECTION = 5  # of one for each direction of motion
_DEGREE = 3  # of a product of polynomials of two positions
_REACH = 1.1  # times half the way, beyond which polynomials are held
_VARIABLES: Mapping[str, Basis] = {
    "position": lambda motion: motion.q,
    "velocity": lambda motion: motion.qd,
    "acceleration": lambda motion: motion.qdd,
}


class Unknown(Effect):
    """Torque that depends on a measured variable in a way that no effect explains."""

    NAME = "unknown"
    REMEDY = "record a motion that moves the joint alone, at several speeds, and diagnose that"
    UNEXPLAINED = True
    MEANINGS = meanings(rms=Meaning("N·m", label="RMS"))


@dataclass(frozen=True, eq=False, kw_only=True)
class UnexplainedHypothesis(Hypothesis):
    """A joint's torque is a smooth function of something, which :attr:`form` names.

    Attributes:
        basis: Returns (N, k) functions at the samples of a motion.
        what: What it is a function of, as a sentence says it.
        over: What its picture is drawn over.
        of: Joint whose variable it is a function of; ``None``: of several, or of time.
    """

    EFFECT = Unknown
    CLAIM = "{joint} has an unexplained torque of {rms} RMS that depends on {what}"

    extrapolates = False

    basis: Basis
    what: str
    over: str
    of: int | None = None

    @property
    def variable(self) -> str:
        return self.over

    @property
    def transient(self) -> bool:
        return self.basis is _of_time

    def regressor(self, motion: Motion) -> Array:
        return spread(self.site.row(self.arm), *self.basis(motion).T)

    def parameters(self, theta: Array) -> dict[str, float]:
        return {"rms": float(np.sqrt(np.mean(theta**2)))}

    def words(self) -> dict[str, str]:
        return super().words() | {"what": self.what}

    def remedy(self, carried: bool) -> str:
        if self.transient or self.of == self.joints[0]:
            return super().remedy(carried)
        return (
            "record a motion that moves these joints, each at several positions of the other, "
            "and diagnose that"
        )

    @property
    def depends_on(self) -> int | None:
        return self.of


def unexplained_hypotheses(
    motion: Motion, joints: Sequence[int]
) -> Iterator[UnexplainedHypothesis]:
    """Yield smooth functions of every variable on some joints, over the range of a motion."""
    arm, moving = motion.arm, np.flatnonzero(motion.moves).tolist()
    kinds = ("position",) if motion.static else tuple(_VARIABLES)
    ranges = {kind: _ranges(_VARIABLES[kind](motion)) for kind in kinds}
    for joint in joints:
        for other in moving:
            for kind in kinds:
                form = f"{kind} of {arm.joint_names[other]}"
                basis = partial(_of_variable, kind=kind, other=other, over=ranges[kind][other])
                yield _smooth(arm, joint, form, f"the {form}", kind, basis, other)
        if not motion.static:
            yield _smooth(arm, joint, "time", "time", "time", _of_time)
            if motion.moves[joint]:
                for other in moving:
                    form = f"its direction and the position of {arm.joint_names[other]}"
                    basis = partial(
                        _by_direction, joint=joint, other=other, over=ranges["position"][other]
                    )
                    yield _smooth(arm, joint, form, form, "position", basis)
        for other in moving:
            if other != joint and motion.moves[joint]:
                pair = f"{arm.joint_names[joint]} and {arm.joint_names[other]}"
                basis = partial(_products, joint=joint, other=other, way=motion.travel)
                form = f"positions of {pair} together"
                yield _smooth(arm, joint, form, f"the {form}", "position", basis)


def _smooth(
    arm: Arm, joint: int, form: str, what: str, variable: str, basis: Basis, of: int | None = None
) -> UnexplainedHypothesis:
    return UnexplainedHypothesis(
        arm=arm, site=Site.joint(joint), form=form, what=what,
        over=variable, basis=basis, of=of,
    )  # fmt: skip


def _of_variable(motion: Motion, kind: str, other: int, over: tuple[float, float]) -> Array:
    return _hats(_VARIABLES[kind](motion)[:, other], _CENTRES, over)


def _of_time(motion: Motion) -> Array:
    ((low, high),) = _ranges(motion.time[:, None])
    return _hats(motion.time, _IN_TIME, (low, high))


def _by_direction(motion: Motion, joint: int, other: int, over: tuple[float, float]) -> Array:
    direction = motion.sign(Site.joint(joint).row(motion.arm))
    return direction[:, None] * _hats(motion.q[:, other], _BY_DIRECTION, over)


def _ranges(values: Array) -> list[tuple[float, float]]:
    """Return the range of each column of (N, n) values, but for the ends of their tails."""
    low, high = np.percentile(values, [1.0, 99.0], axis=0)
    return list(zip(low.tolist(), np.maximum(high, low + 1e-6).tolist(), strict=True))


def _hats(values: Array, count: int, over: tuple[float, float]) -> Array:
    """Return (N, count) Gaussian bells over a range of (N,) values, held at its edges."""
    centres = np.linspace(*over, count)
    width = float(np.median(np.diff(centres)))
    return np.exp(-0.5 * ((np.clip(values, *over)[:, None] - centres) / width) ** 2)


def _products(motion: Motion, joint: int, other: int, way: tuple[Array, Array]) -> Array:
    """Return (N, 15) products of Chebyshev polynomials of two joints' positions over a way."""
    middle, half = way
    x = np.clip((motion.q - middle) / half, -_REACH, _REACH)
    first, second = (np.polynomial.chebyshev.chebvander(x[:, k], _DEGREE) for k in (joint, other))
    products = (first[:, :, None] * second[:, None, :]).reshape(len(x), -1)
    return products[:, 1:]  # a constant depends on nothing
