"""Structure without a name: smooth functions of whatever was measured. A legal answer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arm import Arm
from dvrk_gravity.effects import site
from dvrk_gravity.effects.effect import Effect, Hypothesis, Setting, spread
from dvrk_gravity.effects.evidence import Motion
from dvrk_gravity.effects.meaning import Meaning, meanings

Array = NDArray[np.float64]

_CENTRES = 7  # of a smooth function of a position, velocity or acceleration
_IN_TIME = 12  # of one of time
_BY_DIRECTION = 5  # of one for each direction of motion
_DEGREE = 3  # of a product of polynomials of two positions
_REACH = 1.1  # times half the way, beyond which polynomials are held


class Unknown(Effect):
    """What depends on something measured, in no way that an effect has."""

    NAME = "unknown"
    MEANINGS = meanings(rms=Meaning("N·m", label="RMS"))


@dataclass(frozen=True, eq=False, kw_only=True)
class NamelessHypothesis(Hypothesis):
    """A joint's torque is a smooth function of something, which :attr:`form` names.

    Attributes:
        basis: (N, k) functions at the samples of the motion that it was made for.
        of: Joint whose variable it is a function of; ``None``: of several, or of time.
    """

    EFFECT = Unknown

    basis: Array
    of: int | None = None
    of_state: bool = False

    def build(self, motion: Motion, setting: Setting) -> Array:
        """See :meth:`Hypothesis.build`; of the motion that it was made for."""
        del motion, setting
        return spread(self.site.row(self.arm), *self.basis.T)

    def describe(self, theta: Array, setting: Setting) -> dict[str, float]:
        """See :meth:`Hypothesis.describe`."""
        del setting
        return {"rms": float(np.sqrt(np.mean(theta**2)))}

    @property
    def depends_on(self) -> int | None:
        """See :meth:`Hypothesis.depends_on`."""
        return self.of


def nameless(motion: Motion, joints: Sequence[int]) -> Iterator[NamelessHypothesis]:
    """Yield smooth functions of every variable on some joints."""
    arm, moving = motion.arm, np.flatnonzero(motion.moves).tolist()
    variables: list[tuple[int, str, Array]] = []
    for other in moving:
        variables.append((other, "position", motion.q[:, other]))
        if not motion.static:
            variables.append((other, "velocity", motion.qd[:, other]))
            variables.append((other, "acceleration", motion.qdd[:, other]))
    for joint in joints:
        for other, kind, values in variables:
            form = f"{kind} of {arm.joint_names[other]}"
            yield _smooth(arm, joint, form, kind, _hats(values, _CENTRES), other)
        if not motion.static:
            yield _smooth(arm, joint, "time", "time", _hats(motion.time, _IN_TIME))
            if motion.moves[joint]:
                direction = motion.sign(site.joint(joint).row(arm))[:, None]
                for other in moving:
                    form = f"its direction and position of {arm.joint_names[other]}"
                    basis = direction * _hats(motion.q[:, other], _BY_DIRECTION)
                    yield _smooth(arm, joint, form, "position", basis)
        for other in moving:
            if other != joint and motion.moves[joint]:
                form = (
                    f"positions of {arm.joint_names[joint]} and {arm.joint_names[other]} together"
                )
                yield _smooth(arm, joint, form, "position", _products(motion, joint, other))


def _smooth(
    arm: Arm, joint: int, form: str, variable: str, basis: Array, of: int | None = None
) -> NamelessHypothesis:
    return NamelessHypothesis(
        arm=arm, site=site.joint(joint), joints=(joint,), form=form, variable=variable,
        basis=basis, of=of,
    )  # fmt: skip


def _hats(values: Array, count: int) -> Array:
    """Return (N, count) Gaussian bells over the range of (N,) values, held at its edges."""
    low, high = np.percentile(values, [1.0, 99.0])
    centres = np.linspace(low, max(high, low + 1e-6), count)
    width = float(np.median(np.diff(centres)))
    return np.exp(-0.5 * ((np.clip(values, low, high)[:, None] - centres) / width) ** 2)


def _products(motion: Motion, joint: int, other: int) -> Array:
    """Return (N, 15) products of Chebyshev polynomials of two joints' positions."""
    middle, half = motion.travel
    x = np.clip((motion.q - middle) / half, -_REACH, _REACH)
    mine, theirs = (np.polynomial.chebyshev.chebvander(x[:, k], _DEGREE) for k in (joint, other))
    products = (mine[:, :, None] * theirs[:, None, :]).reshape(len(x), -1)
    return products[:, 1:]  # a constant depends on nothing
