"""A passivity observer for friction compensation: it takes back what it may have fed into the arm.

Friction compensation pushes along the motion. Where it pushes with more than the arm's friction
takes out, the arm runs away, and an arm in a springy hand swings higher and higher. How much
friction there is, nobody knows; supposed is that it is at least half of what the model says
(`sure`: a model that takes it to be up to 100 % more than it is).

**What is observed.** Let f v be the power of the compensation at full factor, friction torque times
velocity, and `part` the part of the modelled friction that f is. With a factor s applied,

    net power into arm and hand  <=  (s - sure / part) f v,

since friction takes out at least `sure` / part times f v. The integral of the right-hand side is
the energy that the compensation may have fed in; where it falls, energy was surely taken out. It is
the passivity observer of Hannaford and Ryu (2002), "Time-domain passivity control of haptic
interfaces", IEEE Trans. Robotics and Automation 18:1, with a known loss on the device's side.

Delay does not spoil the bound: f(v(t - d)) v(t) is at most |f| |v(t)| for dry friction, and for
viscous friction its integral is at most that without delay (Cauchy and Schwarz). What is passive
without delay is so with it. But the account runs on a late velocity: it misses some of what is fed
while a joint accelerates, and books some payment too much while it slows down.

**What is done.** A controller that takes all of it back at once would compensate half the friction,
whatever the model is worth: a hand that works against the friction that is left and a hand that is
being worked upon can show the same motion. But it is growth that does harm, and the growth of a
passive hand's motion (springs, masses, dampers of any size) shows: at the top speed of a swing all
of its energy and the arm's is kinetic. So, for each joint:

1. `fed` is the energy since the top of the last swing.
2. A joint that is faster than its `allowance` and than `growth` times its `base` speed owes `fed`:
   the last top was below that speed, and nothing else but a hand can have driven it beyond.
3. While it owes, no friction is compensated; what friction surely takes out pays.
4. When that is paid, a passive hand and the arm have no more energy than that speed stands for. A
   joint that `settling` later is still faster is driven by a hand that works: its speed is the new
   base. Any other keeps its base.
5. The base falls towards the tops of slower swings, and to zero after a rest.

So a passive hand and arm get no faster than `growth` times the base, or the allowance, but for what
a single swing feeds, what the delay hides and what coupled joints pass on: the base does not rise
without a hand's work. A
hand that works loses its compensation for about a tenth of a second each time that it moves a
joint faster by `growth` than it has been lately. No inertia enters. Joints that share motors
have one factor, the least of theirs: parts of a motor's friction that differ by joint would feed
energy of their own.

`benchmark/passivity.py` measures both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array


@dataclass(frozen=True)
class PassivitySettings:
    """What is supposed, and how quickly it acts; speeds are rad/s (``Arm.scale``).

    `benchmark/passivity.py` holds with these; its cases have set those without a reason of their
    own.

    Attributes:
        sure: Part of the modelled friction that the arm surely has: 1 / (1 + 100 %).
        growth: Growth of a joint's top speed that passes unasked. A smaller one asks at the
            ordinary unevenness of a hand's motion.
        settling: s from payment to judgement: 30 ms of delay, 20 ms until the factor is down, and
            as long again in which a joint that nobody drives slows down. With 0.05 s a delayed
            velocity passes for a hand's.
        moves: Speed that counts as motion: the default dead band, below which nothing is fed.
        rest: A hand's spring that cannot move a joint for so long, s, has no energy to give back.
        forget: The base is kept longer, s, so that a hand that pauses between its moves is not
            asked at each.
        kept: Part of the base that is kept at each slower swing.
        certain: A speed is certainly beyond a limit by this factor…
        certain_by: … and by this: encoders' steps and noise.
        period: Motions of a hand are below 20 Hz: every fifth sample at 1 kHz, s, is often enough.
        fade: From one end of the factor to the other, s, so that it is no blow.
    """

    sure: float = 0.5
    growth: float = 1.3
    settling: float = 0.07
    moves: float = 0.05
    rest: float = 0.5
    forget: float = 2.0
    kept: float = 0.8
    certain: float = 1.02
    certain_by: float = 0.03
    period: float = 0.0049
    fade: float = 0.02


SETTINGS = PassivitySettings()


class PassivityObserver:
    """Scales friction compensation down, joint by joint, where it may make the motion grow.

    Attributes:
        factor: (n,) part of the friction torque to apply, 0 to 1.
    """

    def __init__(
        self,
        part: Array,
        allowance: Array,
        coupled: NDArray[np.bool_],
        scale: Array | None = None,
    ) -> None:
        """Start with everything at rest.

        Args:
            part: (n,) part of the modelled friction that is compensated at full factor.
            allowance: (n,) speeds below which growth does no harm, rad/s.
            coupled: (n,) whether a joint shares a motor with others.
            scale: (n,) what counts as much as a rad (``Arm.scale``); ``None``: a rad.
        """
        self._per_scale = 1.0 / (np.ones(len(part)) if scale is None else scale)
        self._joints = [_Joint() for _ in part]
        self.limit(part, allowance)
        self._coupled = np.flatnonzero(coupled).tolist()
        self._full = np.ones(len(part))
        self.factor = self._full
        self._last = -np.inf

    def limit(self, part: Array, allowance: Array) -> None:
        """Take another (n,) part and allowance, as at the start; what is owed stays owed."""
        sure = SETTINGS.sure / np.maximum(part, 1e-9)
        reach = (allowance * self._per_scale).tolist()
        for joint, *values in zip(self._joints, sure.tolist(), reach, strict=True):
            joint.sure, joint.allowance = values

    def update(self, velocity: Array | None, friction: Array, now: float) -> Array:
        """Take a sample; return the (n,) factor to apply to its friction torque.

        Args:
            velocity: (n,) rad/s; ``None`` where unknown: then no friction is compensated either.
            friction: (n,) torque of friction compensation at full factor, N·m.
            now: Monotonic time, s.
        """
        step = now - self._last
        if step < SETTINGS.period or velocity is None:
            return self.factor
        self._last = now
        if step == np.inf:  # the first sample
            return self.factor
        applied = self.factor.tolist()
        # Where the model's friction pushes against the motion there is nothing to take back.
        power = np.maximum(friction * velocity, 0.0).tolist()
        factors = [
            joint.go(v, p, s, step)
            for joint, v, p, s in zip(
                self._joints, (velocity * self._per_scale).tolist(), power, applied, strict=True
            )
        ]
        if min(factors) == 1.0:
            self.factor = self._full
            return self._full
        if self._coupled:
            least = min(factors[joint] for joint in self._coupled)
            for joint in self._coupled:
                factors[joint] = least
        self.factor = np.array(factors)
        return self.factor


class _Joint:
    """The account of one joint; see the module's text for what each name stands for."""

    __slots__ = (
        "allowance", "base", "debt", "factor", "fed", "fed_since_top", "owes", "paid_for",
        "resting", "sign", "sure", "top",
    )  # fmt: skip

    def __init__(self) -> None:
        self.sure = 0.0  # what friction surely takes out, over the power of the compensation
        self.allowance = 0.0  # rad/s
        self.factor = 1.0
        self.sign = 0.0  # of the present swing
        self.base = 0.0  # rad/s
        self.top = 0.0  # greatest speed of this swing, rad/s
        self.fed = 0.0  # at most, since the last swing's top, J
        self.fed_since_top = 0.0  # at most, since this swing's top, J
        self.owes = False
        self.debt = 0.0  # J
        self.paid_for = 0.0  # s since the debt was paid
        self.resting = 0.0  # s

    def go(self, velocity: float, power: float, applied: float, step: float) -> float:
        """Go one step on and return the factor that this joint asks for."""
        speed = abs(velocity)
        if speed < SETTINGS.moves:
            self.resting += step
            if self.resting > SETTINGS.rest:
                if self.resting - step <= SETTINGS.forget:
                    self._rest()
                return 1.0
        else:
            self.resting = 0.0
            if velocity * self.sign <= 0.0:
                self._turn(velocity)
        # Conditions rather than min and max: this runs seven times a sample.
        energy = (applied - self.sure) * power * step
        self.fed += energy
        if self.fed < 0.0:
            self.fed = 0.0
        if speed > self.top:
            self.top, self.fed_since_top = speed, 0.0
        else:
            self.fed_since_top += energy
            if self.fed_since_top < 0.0:
                self.fed_since_top = 0.0
        if self.owes:
            self.debt += energy
            if self.debt <= 0.0:
                self.paid_for += step
                if self.paid_for > SETTINGS.settling:
                    self._judge(speed)
            self.factor = max(self.factor - step / SETTINGS.fade, 0.0)
        else:
            if speed > self.allowance and speed > SETTINGS.growth * self.base:
                self.owes, self.debt, self.paid_for = True, self.fed, 0.0
            if self.factor < 1.0:
                self.factor = min(self.factor + step / SETTINGS.fade, 1.0)
        return self.factor

    def _turn(self, velocity: float) -> None:
        """Begin a swing in the other direction."""
        self.sign = 1.0 if velocity > 0.0 else -1.0
        self.base = min(self.base, max(self.top, SETTINGS.kept * self.base))
        self.top, self.fed = 0.0, self.fed_since_top

    def _judge(self, speed: float) -> None:
        """Decide, the debt being paid, whether a hand keeps up the speed."""
        limit = max(SETTINGS.growth * self.base, self.allowance)
        if speed > SETTINGS.certain * limit + SETTINGS.certain_by:
            self.base = speed
        elif speed > limit:
            return
        self.owes = False
        self.fed = self.fed_since_top = 0.0

    def _rest(self) -> None:
        self.owes = False
        self.factor = 1.0
        self.top = self.fed = self.fed_since_top = 0.0
        if self.resting > SETTINGS.forget:
            self.base = 0.0
