"""A master arm in MuJoCo, from the DH table and the links alone, beside the package's plant."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import Arm, LinkMass, beta_from_links
from dvrk_gravity.effects import Gravity
from testing.mujoco_arms import dh_table

ROTORS = np.array([0.0043, 0.0026, 0.0038, 0.00012, 0.000062, 0.000062, 0.000015])
# Motor angles from joint angles, written out: a3 = q2 + q3, a4 = q4 + 0.6697 q3.
MOTORS = np.eye(7)
MOTORS[2, 1], MOTORS[3, 2] = 1.0, 0.6697


def weight_of(arm: Arm, links: dict[str, pin.Inertia]) -> Gravity:
    """The gravity term of these links, from the closed form."""
    masses = {name: LinkMass(body.mass, tuple(body.lever)) for name, body in links.items()}
    return Gravity(arm, beta_from_links(masses, columns=14), np.array([0.0, 0.0, -9.81]))


class Oracle:
    """The same arm in MuJoCo, from the DH table and the links alone.

    The parallelogram is put together another way round than in the package: the crank hangs
    on link 1 and turns by q2 + q3, the bar hangs on the crank's tip and turns back by q3.
    """

    # Joint angles -> hinge angles, in the order in which MuJoCo meets them in the file.
    SPREAD = np.zeros((9, 7))
    SPREAD[0, 0] = 1.0
    SPREAD[1, 1:3] = 1.0  # crank
    SPREAD[2, 2] = -1.0  # bar
    SPREAD[range(3, 9), range(1, 7)] = 1.0

    def __init__(self, arm: Arm, links: dict[str, pin.Inertia]) -> None:
        degrees = np.degrees
        text = ""
        for i, joint in reversed(list(enumerate(dh_table("mtmr"), start=1))):
            # Rz(offset) Tz(d) Tx(a) Rx(alpha): a frame within a frame for each half.
            distal = (
                f'<body euler="0 0 {degrees(joint.offset)}">'
                f'<body pos="{joint.a} 0 {joint.d}" euler="{degrees(joint.alpha)} 0 0">'
                f"{self._inertial(links[f'link{i}'])}"
                f"{self._parallelogram(arm, links) if i == 1 else ''}{text}</body></body>"
            )
            text = f'<body name="j{i}"><joint name="q{i}" axis="0 0 1"/>{distal}</body>'
        self.model = mujoco.MjModel.from_xml_string(
            '<mujoco><compiler angle="degree" inertiafromgeom="false" boundmass="1e-12" '
            'boundinertia="1e-15"/><option gravity="0 0 -9.81"><flag energy="enable" '
            f'contact="disable"/></option><worldbody>{text}</worldbody></mujoco>'
        )
        self.data = mujoco.MjData(self.model)
        names = [self.model.joint(i).name for i in range(9)]
        assert names == ["q1", "crank", "bar", *(f"q{i}" for i in range(2, 8))]

    def _parallelogram(self, arm: Arm, links: dict[str, pin.Inertia]) -> str:
        side, table = 0.1, dh_table("mtmr")
        start = np.degrees(table[1].offset + table[2].offset)
        back = 180.0 - np.degrees(table[2].offset)
        return (
            f'<body name="crank" euler="0 0 {start}"><joint name="crank" axis="0 0 1"/>'
            f'<body pos="{side} 0 0" euler="0 0 90">{self._inertial(links["crank"])}</body>'
            f'<body name="bar" pos="{side} 0 0" euler="0 0 {back}"><joint name="bar" axis="0 0 1"/>'
            f"{self._inertial(links['bar'])}</body></body>"
        )

    @staticmethod
    def _inertial(body: pin.Inertia) -> str:
        i = body.inertia
        full = (i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2])
        pos = " ".join(f"{x:.17g}" for x in body.lever)
        tensor = " ".join(f"{x:.17g}" for x in full)
        return f'<inertial mass="{body.mass:.17g}" pos="{pos}" fullinertia="{tensor}"/>'

    def _move_to(self, q: np.ndarray, v: np.ndarray) -> None:
        self.data.qpos[:] = self.SPREAD @ q
        self.data.qvel[:] = self.SPREAD @ v
        mujoco.mj_forward(self.model, self.data)

    def acceleration(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        self._move_to(q, v)
        mass = np.zeros((9, 9))
        mujoco.mj_fullM(self.model, self.data, mass)
        mass = self.SPREAD.T @ mass @ self.SPREAD + MOTORS.T @ np.diag(ROTORS) @ MOTORS
        return np.linalg.solve(mass, tau - self.SPREAD.T @ self.data.qfrc_bias)

    def energy(self, q: np.ndarray, v: np.ndarray) -> float:
        self._move_to(q, v)
        mujoco.mj_energyPos(self.model, self.data)
        mujoco.mj_energyVel(self.model, self.data)
        return float(self.data.energy.sum() + 0.5 * ROTORS @ (MOTORS @ v) ** 2)
