"""Arms that MuJoCo itself moves, with its own friction, flexible joint and backlash.

Nothing of this is our physics: damping and frictionloss are MuJoCo's (a soft constraint), rotors
its armature; a flexible joint is a second hinge on the same body with a stiffness, backlash one
with a narrow range, as its documentation models them. A computed torque with feedback follows a
drawn motion; recorded are the motor's position and its torque.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from dvrk_gravity.arms import Arm
from dvrk_gravity.arrays import Array
from testing import mujoco_arms
from testing.lab_motion import Sines
from testing.lab_physics import Truth
from testing.mujoco_world import Sizes

Kind = Literal["friction", "flexible", "backlash"]
STEP = 1e-3  # s
STIFFNESS = 100.0  # N·m/rad a N·m of the effort limit: half a degree to a degree under load
PLAY = np.radians(0.5)  # either way
BANDWIDTH = 2.0 * np.pi * 6.0  # rad/s, of the loop that follows the motion


@dataclass(frozen=True, eq=False)
class ForwardWorld:
    """An arm that MuJoCo moves.

    Attributes:
        arm: What the package knows of it.
        rigid: Its links, rigid and without friction.
        moved: What is simulated.
        parameters: fv, fs and Ia by joint, (3, n).
        soft: The joint that is not rigid; -1: none.
        kind: What it is.
    """

    arm: Arm
    rigid: mujoco_arms.MujocoArm
    moved: mujoco.MjModel
    parameters: Array
    soft: int
    kind: Kind

    @classmethod
    def draw(cls, name: str, kind: Kind, seed: int, urdf: str) -> ForwardWorld:
        """Draw an arm; ``urdf`` is its own without meshes."""
        random = np.random.default_rng([seed, 77])
        arm = mujoco_arms.arm_of(name)
        sizes = Sizes.of(arm)
        factors = random.uniform(0.7, 1.4, arm.n)
        rigid = mujoco_arms.urdf(arm, factors.tolist())
        parameters = np.array([
            0.5 * sizes.friction, sizes.friction, sizes.rotors
        ]) * random.uniform(0.6, 1.4, (3, arm.n))  # fmt: skip
        spec = mujoco.MjSpec.from_string(urdf)
        spec.option.timestep = STEP
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        soft = -1 if kind == "friction" else 2
        for i, joint in enumerate(arm.joint_names):
            own = spec.joint(joint)
            own.limited = 0
            own.damping = [parameters[0, i], 0.0, 0.0]
            own.frictionloss, own.armature = parameters[1, i], parameters[2, i]
            if i == soft:
                second = own.parent.add_joint(
                    name="soft", type=mujoco.mjtJoint.mjJNT_HINGE, axis=own.axis, pos=own.pos
                )
                limit = float(arm.effort_limit[i])
                if kind == "flexible":
                    second.stiffness = [STIFFNESS * limit / 5.0, 0.0, 0.0]
                    second.damping = [0.1 * limit, 0.0, 0.0]
                else:
                    second.limited, second.range = 1, [-PLAY, PLAY]
                    second.damping = [0.01 * limit, 0.0, 0.0]
        moved = spec.compile()
        for body, joint in zip(rigid.bodies, arm.joint_names, strict=True):
            own_body = moved.jnt_bodyid[moved.joint(joint).id]
            moved.body_mass[own_body] = rigid.model.body_mass[body]
            moved.body_inertia[own_body] = rigid.model.body_inertia[body]
        mujoco.mj_setConst(moved, mujoco.MjData(moved))
        return cls(arm, rigid, moved, parameters, soft, kind)

    def truth(self, motion: Sines, before: float, duration: float, after: float) -> Truth:
        """Return the motors' motion and torque."""
        model, data, arm = self.moved, mujoco.MjData(self.moved), self.arm
        time = np.arange(-before, duration + after, STEP)
        want = motion.at(time)
        forward = self.rigid.torque(*want) + self.parameters[2] * want[2]
        motors = np.array([model.joint(name).dofadr[0] for name in arm.joint_names])
        data.qpos[motors], data.qvel[motors] = want[0][0], want[1][0]
        at, still = np.tile(want[0][0], (arm.n, 1)), np.zeros((arm.n, arm.n))
        column = self.rigid.torque(at, still, np.eye(arm.n)) - self.rigid.torque(at, still, still)
        inertia = np.diag(column) + self.parameters[2]
        kp, kd = BANDWIDTH**2 * inertia, 1.4 * BANDWIDTH * inertia
        q, qd, effort = (np.empty_like(want[0]) for _ in range(3))
        for row in range(len(time)):
            q[row], qd[row] = data.qpos[motors], data.qvel[motors]
            effort[row] = (
                forward[row] + kp * (want[0][row] - q[row]) + kd * (want[1][row] - qd[row])
            )
            data.qfrc_applied[motors] = effort[row]
            mujoco.mj_step(model, data)
        return Truth(arm, time, q, qd, np.gradient(qd, STEP, axis=0), effort)
