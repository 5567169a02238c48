"""The PSM's dynamics are those of its mechanism.

MuJoCo has the PSM's loops as the mechanism has them, closed by equality constraints: nothing there
turns about the remote centre, no bar is forced to stay upright and no weight to follow.
"""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin
from made_up_arm import random_inertias, random_motion

from dvrk_gravity.arms import Arm, build_tree
from testing import mujoco_arms

TILTED = np.array([1.3, -2.1, -9.4])
PINNED = {"yaw": "link1", "pitch": "back", "insertion": "link3", "roll": "link4",
          "wrist_pitch": "link5"}  # joints of the arm that one joint of MuJoCo is  # fmt: skip
ACROSS = "-1 0 0"  # the pitch axis at zero


def text(values) -> str:
    return " ".join(repr(float(value)) for value in values)


def frames(arm: Arm, q: np.ndarray) -> dict[str, np.ndarray]:
    tree = build_tree(arm, {}, TILTED)
    pin.forwardKinematics(tree.model, tree.data, tree.expand @ q)
    return {
        body.name: (tree.data.oMi[i] * body.frame).homogeneous
        for i, body in enumerate(arm.bodies, start=1)
    }


class LoopedPsm:
    """A PSM whose loops are MuJoCo's equality constraints; axes and pins are those of the world."""

    def __init__(self, arm: Arm, inertias: dict[str, pin.Inertia]) -> None:
        """Build it at zero, where every body's mass is where the arm's file has its frame."""
        zero = frames(arm, np.zeros(7))

        def xml(part: tuple, parent: tuple[float, ...] = (0.0, 0.0, 0.0)) -> str:
            name, kind, axis, at, *inner = part
            frame, inertia = zero[name][:3], inertias[name]
            com = frame @ np.append(inertia.lever, 1.0) - at
            i = frame[:, :3] @ inertia.inertia @ frame[:, :3].T
            return (
                f'<body name="{name}" pos="{text(np.subtract(at, parent))}">'
                f'<joint name="{name}" type="{kind}" axis="{axis}"/>'
                f'<inertial mass="{inertia.mass!r}" pos="{text(com)}" '
                f'fullinertia="{text(i[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])}"/>'
                f"{''.join(xml(child, at) for child in inner)}</body>"
            )

        back, low, high = -0.516, 0.14454, 0.18262  # along the yaw axis; pins of the bars on back
        pins = back - 0.04009
        wrist = ("link4", "hinge", "0 0 -1", (0.0, 0.0, 0.0156),
                 ("link5", "hinge", ACROSS, (0.0, 0.0, 0.0156),
                  ("link6", "hinge", "0 -1 0", (0.0, 0.0, 0.0065)),
                  ("link7", "hinge", "0 -1 0", (0.0, 0.0, 0.0065))))  # fmt: skip
        front = ("link2", "hinge", ACROSS, (0.0, pins + 0.516, low),
                 ("link3", "slide", "0 0 -1", (0.0, 0.0, 0.4318), wrist))  # fmt: skip
        middle = ("middle", "hinge", ACROSS, (0.0, pins + 0.096, low))
        whole = ("link1", "hinge", "0 -1 0", (0.0, 0.0, 0.0),
                 ("back", "hinge", ACROSS, (0.0, back, 0.0),
                  ("counterweight", "slide", "0 0 1", (0.0, back, 0.0)),
                  ("upper_bar", "hinge", ACROSS, (0.0, pins, high)),
                  ("lower_bar", "hinge", ACROSS, (0.0, pins, low), middle, front)))  # fmt: skip
        loops = "".join(
            f'<connect body1="upper_bar" body2="{name}" anchor="0 {along} 0"/>'
            for name, along in (("link2", 0.516), ("middle", 0.096))
        )
        loops += (
            f'<connect body1="link1" body2="middle" anchor="{text((0.0, back + 0.096, 0.0))}"/>'
        )
        loops += '<joint joint1="counterweight" joint2="link3" polycoef="0 1 0 0 0"/>'
        self.model = mujoco.MjModel.from_xml_string(
            f'<mujoco><compiler angle="radian"/><option gravity="{text(TILTED)}" '
            f'jacobian="dense"/><worldbody>{xml(whole)}</worldbody><equality>{loops}'
            "</equality></mujoco>"
        )
        self.data = mujoco.MjData(self.model)

    def actuated(self, q: np.ndarray) -> dict[str, float]:
        """What the arm's joints are of MuJoCo's."""
        known = {PINNED[name]: q[i] for i, name in enumerate(PINNED)}
        return known | {"link6": q[5] - 0.5 * q[6], "link7": q[5] + 0.5 * q[6]}

    def assemble(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Assemble the mechanism by Newton's method; return its errors and their Jacobian."""
        model, data = self.model, self.data
        known = self.actuated(q)
        free = [model.joint(i).dofadr[0] for i in range(model.njnt)
                if model.joint(i).name not in known]  # fmt: skip
        for name, value in known.items():
            data.qpos[model.joint(name).qposadr[0]] = value
        for _ in range(20):
            mujoco.mj_fwdPosition(model, data)
            jacobian = data.efc_J.reshape(-1, model.nv)[: data.ne]
            error = data.efc_pos[: data.ne].copy()
            data.qpos[free] -= np.linalg.lstsq(jacobian[:, free], error, rcond=None)[0]
        return error, jacobian.copy()

    def rates(self, q: np.ndarray) -> np.ndarray:
        """Return (nv, 7): motion of all of MuJoCo's joints by the arm's, which the loops allow."""
        _, jacobian = self.assemble(q)
        allowed = np.linalg.svd(jacobian)[2][np.linalg.matrix_rank(jacobian, 1e-9) :].T
        assert allowed.shape[1] == 7
        unit = np.array([list(self.actuated(row).values()) for row in np.eye(7)]).T
        own = [self.model.joint(name).dofadr[0] for name in self.actuated(q)]
        return allowed @ np.linalg.solve(allowed[own], unit)

    def effort(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Return (7,) efforts: those of the opened tree, along the motions that the loops allow."""
        step = 1e-6
        turning = (self.rates(q + step * qd) - self.rates(q - step * qd)) @ qd / (2 * step)
        rates = self.rates(q)
        error, _ = self.assemble(q)
        np.testing.assert_allclose(error, 0.0, atol=1e-12)
        model, data = self.model, self.data
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EQUALITY
        data.qvel[:], data.qacc[:] = rates @ qd, rates @ qdd + turning
        mujoco.mj_inverse(model, data)
        model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
        return data.qfrc_inverse @ rates


def test_dynamics_of_the_psm_are_those_of_the_mechanism_with_its_loops_in_mujoco():
    psm = Arm.load("psm")
    inertias, seed = random_inertias(psm, 3), 3
    looped, tree = LoopedPsm(psm, inertias), build_tree(psm, inertias, TILTED)
    motion = random_motion(psm, 6, seed)
    of_trials = mujoco_arms.table("psm", inertias, TILTED).torque(*motion)
    for q, qd, qdd, too in zip(*motion, of_trials, strict=True):
        expected = looped.effort(q, qd, qdd)
        found = tree.inverse_dynamics(q, qd, qdd)
        np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())
        np.testing.assert_allclose(too, expected, atol=1e-7 * np.abs(expected).max())
