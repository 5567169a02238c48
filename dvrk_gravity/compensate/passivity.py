"""A passivity observer for friction compensation: it takes back energy that it may have fed in.

Friction compensation pushes along the motion. Where it pushes with more than the arm's friction
takes out, the arm runs away, and an arm in a springy hand swings higher and higher. The friction is
not known; it is assumed to be at least half of the model's (`certain_friction`: the model may
overestimate it by up to 100 %).

**Observed.** Let f v be the power of the compensation at full factor, friction torque times
velocity, and `part` the part of the modelled friction that f is. With a factor s applied,

    net power into arm and hand  <=  (s - sure / part) f v,

since friction takes out at least `certain_friction` / part times f v. The integral of the
right-hand side is the energy that the compensation may have fed in; where it falls, friction took
energy out. It is the passivity observer of Hannaford and Ryu (2002), "Time-domain passivity control
of haptic interfaces", IEEE Trans. Robotics and Automation 18:1, with a known loss on the device's
side.

Delay does not spoil the bound: f(v(t - d)) v(t) is at most |f| |v(t)| for dry friction, and for
viscous friction its integral is at most that without delay (Cauchy and Schwarz). But the account
uses a late velocity: it misses some of the energy fed while a joint accelerates, and overestimates
some payment while it slows down.

**Done.** A controller that took all of it back at once would compensate half the friction, however
good the model is: a hand that works against the remaining friction and a hand that is worked upon
can show the same motion. But only growth does harm, and the growth of a passive hand's motion
(springs, masses, dampers of any size) shows: at the top speed of a swing all of its energy and the
arm's is kinetic. So, for each joint:

1. `fed` is the energy since the top of the last swing. 2. A joint that is faster than its
`allowance` and than `allowed_growth` times its `base` speed owes `fed`:
   the last top was below that speed, and nothing else but a hand can have driven it beyond.
3. While it owes, no friction is compensated; the friction that is certain pays.
4. Then a passive hand and the arm have no more energy than that speed stands for. A joint that is
   still faster `settling_time` later is driven by a hand that works: its speed is the new base. Any
   other keeps its base.
5. The base falls towards the tops of slower swings, and to zero after a rest.

So a passive hand and arm get no faster than `allowed_growth` times the base, or the allowance,
except for the energy of a single swing, the effect of delay and what coupled joints pass on: the
base does not rise without a hand's work. A hand that works loses its compensation for about a tenth
of a second each time that it moves a joint faster by `allowed_growth` than lately. No inertia
enters. Joints that share motors have one factor, the least of theirs: parts of a motor's friction
that differ by joint would feed energy of their own.

`benchmark/passivity.py` measures both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dvrk_gravity.arrays import Array


@dataclass(frozen=True)
class PassivitySettings:
    """Assumptions and time constants; speeds are rad/s (``Arm.scale``).

    `benchmark/passivity.py` passes with these; its cases set those without a reason of their own.

    Attributes:
        certain_friction: Part of the modelled friction that is certain: 1 / (1 + 100 %).
        allowed_growth: Growth of a joint's top speed that is allowed. A smaller one interferes with
            the ordinary unevenness of a hand's motion.
        settling_time: s from payment to judgement: 30 ms of delay, 20 ms until the factor is down,
            and as long again in which a joint without a hand slows down. With 0.05 s a delayed
            velocity passes for a hand's.
        moving_speed: Speed that counts as motion: the default dead band, below which nothing is
            fed.
        rest_time: A hand's spring that cannot move a joint for so long, s, has no energy to return.
        memory_time: The base is kept longer, s, so that a hand that pauses between its moves is not
            slowed at each.
        base_decay: Part of the base that is kept at each slower swing.
        speed_factor: A speed is certainly beyond a limit by this factor…
        speed_margin: … and by this: encoders' steps and noise.
        period: Motions of a hand are below 20 Hz: every fifth sample at 1 kHz, s, is often enough.
        fade_time: From one end of the factor to the other, s: not a jolt.
    """

    certain_friction: float = 0.5
    allowed_growth: float = 1.3
    settling_time: float = 0.07
    moving_speed: float = 0.05
    rest_time: float = 0.5
    memory_time: float = 2.0
    base_decay: float = 0.8
    speed_factor: float = 1.02
    speed_margin: float = 0.03
    period: float = 0.0049
    fade_time: float = 0.02


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
        """Start at rest.

        Args:
            part: (n,) part of the modelled friction that is compensated at full factor.
            allowance: (n,) speeds below which growth does no harm, rad/s.
            coupled: (n,) whether a joint shares a motor with others.
            scale: (n,) ``Arm.scale``; ``None``: 1.
        """
        self._per_scale = 1.0 / (np.ones(len(part)) if scale is None else scale)
        self._joints = [_Joint() for _ in part]
        self.limit(part, allowance)
        self._coupled = np.flatnonzero(coupled).tolist()
        self._full = np.ones(len(part))
        self.factor = self._full
        self._last = -np.inf

    def limit(self, part: Array, allowance: Array) -> None:
        """Replace the (n,) part and allowance; debts stay."""
        sure = SETTINGS.certain_friction / np.maximum(part, 1e-9)
        reach = (allowance * self._per_scale).tolist()
        for joint, *values in zip(self._joints, sure.tolist(), reach, strict=True):
            joint.dissipation_ratio, joint.allowance = values

    def update(self, velocity: Array | None, friction: Array, now: float) -> Array:
        """Return the (n,) factor to apply to a sample's friction torque.

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
    """The account of one joint; the module's text explains each name."""

    __slots__ = (
        "allowance",
        "base",
        "debt",
        "dissipation_ratio",
        "factor",
        "fed",
        "fed_since_top",
        "owes",
        "paid_for",
        "resting",
        "sign",
        "top",
    )  # fmt: skip

    def __init__(self) -> None:
        self.dissipation_ratio = (
            0.0  # what friction takes out at least, over the power of the compensation
        )
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
        """Advance by one step, s, and return the factor of this joint."""
        speed = abs(velocity)
        if speed < SETTINGS.moving_speed:
            self.resting += step
            if self.resting > SETTINGS.rest_time:
                if self.resting - step <= SETTINGS.memory_time:
                    self._rest()
                return 1.0
        else:
            self.resting = 0.0
            if velocity * self.sign <= 0.0:
                self._turn(velocity)
        # Conditions rather than min and max: this runs seven times a sample.
        energy = (applied - self.dissipation_ratio) * power * step
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
                if self.paid_for > SETTINGS.settling_time:
                    self._judge(speed)
            self.factor = max(self.factor - step / SETTINGS.fade_time, 0.0)
        else:
            if speed > self.allowance and speed > SETTINGS.allowed_growth * self.base:
                self.owes, self.debt, self.paid_for = True, self.fed, 0.0
            if self.factor < 1.0:
                self.factor = min(self.factor + step / SETTINGS.fade_time, 1.0)
        return self.factor

    def _turn(self, velocity: float) -> None:
        """Begin a swing in the other direction."""
        self.sign = 1.0 if velocity > 0.0 else -1.0
        self.base = min(self.base, max(self.top, SETTINGS.base_decay * self.base))
        self.top, self.fed = 0.0, self.fed_since_top

    def _judge(self, speed: float) -> None:
        """Decide, after payment, whether a hand keeps up the speed."""
        limit = max(SETTINGS.allowed_growth * self.base, self.allowance)
        if speed > SETTINGS.speed_factor * limit + SETTINGS.speed_margin:
            self.base = speed
        elif speed > limit:
            return
        self.owes = False
        self.fed = self.fed_since_top = 0.0

    def _rest(self) -> None:
        self.owes = False
        self.factor = 1.0
        self.top = self.fed = self.fed_since_top = 0.0
        if self.resting > SETTINGS.memory_time:
            self.base = 0.0
