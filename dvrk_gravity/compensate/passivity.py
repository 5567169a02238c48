"""A passivity observer for friction compensation: it pays back what it may have fed into the arm.

Friction compensation pushes along the motion. Where it pushes with more than the arm's friction
takes out, the arm runs away, and an arm held by a springy hand swings higher and higher. How much
friction there really is, is what nobody knows; that it is at least half of what the model says
(:data:`SURE`: a model that is wrong by up to 100 %) is supposed here.

**What is observed.** Let f v be the power of the compensation at full factor (friction torque times
velocity), and `part` the part of the modelled friction that f is. With a factor s applied,

    net power into arm and hand  <=  (s - SURE / part) f v,

since friction takes out at least SURE / part times f v. Its integral is the energy that the
compensation may have fed in; where it is negative it is the energy that was surely taken out. This
is the passivity observer of Hannaford and Ryu (2002), "Time-domain passivity control of haptic
interfaces", IEEE Trans. Robotics and Automation 18:1, with a known loss on the device's side.

Delay does not spoil it: f(v(t - d)) v(t) is at most |f| |v(t)| for dry friction, and for viscous
friction its integral is, by the inequality of Cauchy and Schwarz, at most that without delay. So
a compensation that is passive without delay is passive with it. (It is the *account* that is late
by d; `SETTLING` waits for that.)

**What is done.** A controller that pays back always would apply half the friction, whatever the
model is worth, since a hand that works against residual friction and a hand that is being worked upon
can show the same motion. It is growth that does harm, and growth can be told: the energy of a
hand that is passive (springs, masses, dampers, of whatever size) and of the arm is kinetic at the
top of a swing. So, joint by joint:

1. The account starts anew at the top of each swing: `fed` is the energy since the last one.
2. A joint that gets faster than `GROWTH` times its `base` speed (and than its `allowance`) may have
   been driven to it, by no more than `fed`, since the last top was below that speed. It owes `fed`.
3. While it owes, no friction is compensated, and what friction surely takes out pays the debt.
4. With the debt paid, a passive hand and the arm have no more energy than at the last top. If the joint
   is nevertheless still as fast, the hand has worked: that speed is the new base. If not, the
   base stays as it is, and so does the bound.
5. The base falls to the tops of slower swings, by a fifth a swing, and to zero after a rest.

So a passive hand and arm never exceed max(GROWTH * base, allowance), but for what they gain
until the (delayed) measurement shows it: base does not rise without a hand's work. An active hand pays
a few hundredths of a second without compensation each time it gets faster by `GROWTH`.
No inertia enters. Joints that share motors have one factor, the least of theirs: parts of a
motor's friction that differ by joint would feed energy of their own.

The figures come from ``benchmark/passivity.py``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arm import N_JOINTS

Array = NDArray[np.float64]

SURE = 0.5
"""Part of the modelled friction that the arm surely has: 1 / (1 + 100 %)."""
GROWTH = 1.3
"""Growth of the top speed that passes. Less answers a hand's ordinary unevenness, more lets a
passive hand's swing grow by more; 1.3 is the square root of 1.7 in energy."""
ALLOWANCE = 0.1
"""Part of a joint's speed limit below which nothing is done about growth."""
SETTLING = 0.05
"""s from payment to judgement: 30 ms of delay, a period, and the slewing of the command."""
# The velocity that counts as motion, rad/s, is the default dead band: below it nothing is fed.
_MOVES = 0.05
# Energy of a hand's spring that is left in a joint at rest for so long, s, cannot overcome the
# friction; the base is kept longer, so that a hand that moves in jerks is not asked every time.
_REST, _FORGET = 0.5, 2.0
_KEPT = 0.8  # of the base, at each slower swing
# How much faster than the limit is certainly as fast: noise and steps of the velocity.
_CERTAIN, _CERTAIN_BY = 1.02, 0.03
# Motions of a hand are below 20 Hz: more often than this, s, is work for nothing.
_PERIOD = 0.004
# The factor goes from one end to the other in this time, s: no step is felt.
_FADE = 0.02


class PassivityObserver:
    """Scales friction compensation down, joint by joint, where it may make the motion grow.

    Attributes:
        factor: (7,) part of the friction torque to apply, 0 to 1.
    """

    def __init__(self, part: Array, allowance: Array, coupled: NDArray[np.bool_]) -> None:
        """Start with everything at rest.

        Args:
            part: (7,) part of the modelled friction that is compensated at full factor.
            allowance: (7,) speeds below which growth does no harm, rad/s.
            coupled: (7,) whether a joint shares a motor with others.
        """
        sure = SURE / np.maximum(part, 1e-9)
        self._joints = [
            _Joint(*given) for given in zip(sure.tolist(), allowance.tolist(), strict=True)
        ]
        self._coupled = np.flatnonzero(coupled).tolist()
        self._full = np.ones(N_JOINTS)
        self.factor = self._full
        self._last = -np.inf

    def update(self, velocity: Array | None, friction: Array, now: float) -> Array:
        """Take a sample; return the (7,) factor to apply to its friction torque.

        Args:
            velocity: (7,) rad/s; ``None`` where unknown: then no friction is compensated either.
            friction: (7,) torque of friction compensation at full factor, N·m.
            now: Monotonic time, s.
        """
        step = now - self._last
        if step < _PERIOD or velocity is None:
            return self.factor
        self._last = now
        if step == np.inf:  # the first sample
            return self.factor
        applied = self.factor.tolist()
        power = (friction * velocity).tolist()
        factors = [
            joint.go(v, p, s, step)
            for joint, v, p, s in zip(self._joints, velocity.tolist(), power, applied, strict=True)
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

    def __init__(self, sure: float, allowance: float) -> None:
        self.sure = sure  # what friction surely takes out, over the power of the compensation
        self.allowance = allowance  # rad/s
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
        if speed < _MOVES:
            self.resting += step
            if self.resting > _REST:
                self._rest()
                return self.factor
        else:
            self.resting = 0.0
            if velocity * self.sign <= 0.0:
                self._turn(velocity)
        energy = (applied - self.sure) * power * step
        self.fed = max(self.fed + energy, 0.0)
        self.fed_since_top = max(self.fed_since_top + energy, 0.0)
        if speed > self.top:
            self.top, self.fed_since_top = speed, 0.0
        limit = max(GROWTH * self.base, self.allowance)
        if self.owes:
            self.debt += energy
            if self.debt <= 0.0:
                self.paid_for += step
                if self.paid_for > SETTLING:
                    self._judge(speed, limit)
        elif speed > limit:
            self.owes, self.debt, self.paid_for = True, self.fed, 0.0
        change = step / _FADE
        self.factor = max(self.factor - change, 0.0) if self.owes else min(self.factor + change, 1.0)
        return self.factor

    def _turn(self, velocity: float) -> None:
        """Begin a swing in the other direction."""
        self.sign = 1.0 if velocity > 0.0 else -1.0
        self.base = min(self.base, max(self.top, _KEPT * self.base))
        self.top, self.fed = 0.0, self.fed_since_top

    def _judge(self, speed: float, limit: float) -> None:
        """Decide, the debt being paid, whether a hand keeps up the speed."""
        if speed > _CERTAIN * limit + _CERTAIN_BY:
            self.base = speed
        elif speed > limit:
            return
        self.owes = False
        self.fed = self.fed_since_top = 0.0

    def _rest(self) -> None:
        self.owes = False
        self.factor = 1.0
        self.top = self.fed = self.fed_since_top = 0.0
        if self.resting > _FORGET:
            self.base = 0.0
