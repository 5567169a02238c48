"""Links behind springs: gears and cables that give way between the encoder and the link."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dvrk_gravity.arrays import Array
from dvrk_gravity.effects.base.effect import Effect, Hypothesis
from dvrk_gravity.effects.base.meaning import Meaning, meanings
from dvrk_gravity.effects.base.motion import Motion, State
from dvrk_gravity.effects.base.site import Site
from dvrk_gravity.effects.rotor_inertia import RotorInertia

_SMALL = 1e-3  # rad: less give than that is linear
_MOST = 0.3  # rad, that a joint may give. Chosen: a fit on its way may ask for more
_BAND = 4.0  # Hz; chosen: motions end at 2 Hz, and noise grows with the square of the frequency
_SOFTEST = 1e-9  # rad/(N·m), in place of none


class JointFlexibility(Effect):
    """position is read at the motor, theta = q + tau_J / k; the link is at q.

    With the spring between motor and link, stiffness k (Spong 1987, Modeling and Control of Elastic
    Joint Robots; De Luca and Book 2016, Robots with Flexible Elements, Springer Handbook of
    Robotics, chapter 11)::

        M(q) q'' + c(q, q') + g(q) = tau_J = k (theta - q)
        B theta'' + friction(theta') + tau_J = tau

    Rotors and friction are at the motor, whose motion is read. All else acts on the link, at
    q = theta - s with s = tau_J / k. So the measured effort is that of a rigid arm with
    tau_J(theta, theta', theta'') replaced by tau_J(theta - s, theta' - s', theta'' - s''); to first
    order that adds, of a joint j and at every joint, with s = tau_J,j / k::

        -(d tau_J / d q_j) s - (d tau_J / d q'_j) s' - M_j s''

    The first part is most of it: a load's weight moves by what its joint gives. The last one is in
    proportion to the square of a motion's frequency over the joint's resonance.
    """

    NAME = "joint_flexibility"
    REMEDY = "read {joint}'s position behind its gear, or move and load it less"
    MEANINGS = meanings(
        stiffness=Meaning("N·m/rad", least=0.0),
        # The fit's parameter, in which the torque is linear; nothing gives way against its load.
        compliance=Meaning("rad/(N·m)", 0.0, least=0.0, reported=False),
    )

    @classmethod
    def hypotheses(cls, motion: Motion) -> Iterator[Hypothesis]:
        for joint in np.flatnonzero(motion.moves).tolist():
            yield FlexibleHypothesis(
                arm=motion.arm, site=Site.joint(joint), setting={"compliance": 0.0}
            )


@dataclass(frozen=True, eq=False, kw_only=True)
class FlexibleHypothesis(Hypothesis):
    """A joint gives way under its load."""

    EFFECT = JointFlexibility
    CLAIM = "{joint} gives way under its load like a spring of {stiffness}"

    fixed_point = ("compliance",)

    def regressor(self, motion: Motion) -> Array:
        """Return the secant of the link's torque by the compliance."""
        rotors = motion.model.term(RotorInertia.NAME)
        state = motion.state_at(motion.true_q)
        rigid = motion.modelled - motion.friction
        if rotors is not None:
            rigid = rigid - rotors.torque(state)
        joint, unit = self.site.index, self.arm.scale[self.site.index]
        largest = max(float(np.abs(rigid[:, joint]).max()), _SOFTEST)
        least, most = (part * unit / largest for part in (_SMALL, _MOST))
        compliance = float(np.clip(self.setting["compliance"], 0.0, most))
        step, link = max(compliance, least), rigid
        for _ in range(2 if compliance > least else 1):  # what is carried where it has given way
            link = self._link_torque(motion, state, step * link[:, joint])
        return ((link - rigid) / step)[:, :, None]

    def _link_torque(self, motion: Motion, state: State, give: Array) -> Array:
        """Return (N, n) torques without rotors and friction where the joint gives by (N,) rad."""
        shift = np.eye(self.arm.n)[self.site.index]
        if state.qd is None or state.qdd is None:
            there = replace(state, q=state.q - give[:, None] * shift)
        else:
            q, qd, qdd = (each[:, None] * shift for each in _low_passed_derivatives(motion, give))
            there = State(state.q - q, state.qd - qd, state.qdd - qdd)
        behind = (
            term.torque(there)
            for term in motion.model.terms
            if not (term.FRICTION or isinstance(term, RotorInertia))
        )
        return sum(behind, np.zeros(state.q.shape))

    def parameters(self, theta: Array) -> dict[str, float]:
        compliance = float(theta[0])
        return {"stiffness": 1.0 / max(compliance, _SOFTEST), "compliance": compliance}


def _low_passed_derivatives(motion: Motion, values: Array) -> tuple[Array, Array, Array]:
    """Return (N,) a signal below :data:`_BAND`, and its first and second derivatives.

    Of a model's torque, which has the noise of measured accelerations; zero where too little was
    recorded at a time.
    """
    from scipy.signal import butter, sosfiltfilt

    result = np.zeros((3, len(values)))
    for part in motion.parts:
        time = motion.time[part]
        if time[-1] - time[0] <= 1.0 / _BAND:
            continue
        step = float(np.median(np.diff(time)))
        low = butter(2, min(_BAND, 0.2 / step), fs=1.0 / step, output="sos")
        slow = sosfiltfilt(low, values[part], padlen=min(len(time) - 1, round(1.0 / _BAND / step)))
        rate = np.gradient(slow, step)
        result[:, part] = slow, rate, np.gradient(rate, step)
    return result[0], result[1], result[2]
