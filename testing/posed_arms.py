"""Static poses of arms that are no MTM, as friction that sticks lets them be read.

Efforts are the weight of a plant's links as Pinocchio (ECM, PSM) or MuJoCo (UR5) has it, friction
that sticks at more than half of its level, and noise. Neither knows the effects of the package.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from dvrk_gravity.arms import Arm, build_tree
from dvrk_gravity.arrays import Array
from dvrk_gravity.recording import Recording
from dvrk_gravity.simulate import PlantFile
from testing import mujoco_arms

NOISE = 0.003  # of a joint's effort limit
USED = 0.8  # of each joint's range
Weight = Callable[[Array, float], Array]


@dataclass(frozen=True, eq=False)
class Posed:
    """An arm that is posed, and what its first joints read.

    Attributes:
        arm: All of its joints.
        posed: How many of them are posed and recorded; the others stay at zero.
        weight: From (N, n) positions and the mass of a load, kg, to (N, n) efforts.
        friction: (n,) level at each joint, N·m or N.
        directed: Whether the way in which a pose was approached is recorded.
        load: Mass of the load that is hidden, kg.
        carries: Joint whose link carries it.
    """

    arm: Arm
    posed: int
    weight: Weight
    friction: Array
    directed: bool
    load: float
    carries: str

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints that are posed."""
        return self.arm.joint_names[: self.posed]

    def positions(self, seed: int, count: int, used: float = USED) -> Array:
        """Return (N, n) positions in the middle part of the ranges of the joints that are posed."""
        low, high = self.arm.range
        middle, half = 0.5 * (low + high), 0.5 * used * (high - low)
        q = np.random.default_rng(seed).uniform(middle - half, middle + half, (count, self.arm.n))
        q[:, self.posed :] = 0.0
        return q

    def record(self, seed: int, count: int, load: float = 0.0, used: float = USED) -> Recording:
        """Return what poses read, each stuck on its way."""
        random = np.random.default_rng(seed + 1000)
        q = self.positions(seed, count, used)
        way = random.choice([-1.0, 1.0], q.shape)
        stuck = way * self.friction * random.uniform(0.5, 1.0, q.shape)
        noise = NOISE * self.arm.effort_limit * random.standard_normal(q.shape)
        effort, first = self.weight(q, load) + stuck + noise, slice(self.posed)
        return Recording(
            self.names, None, q[:, first], effort=effort[:, first],
            direction=way[:, first] if self.directed else None, source=f"poses {seed}",
        )  # fmt: skip

    def irreducible_error(self) -> Array:
        """(posed,) RMS of what no model can know: noise, and friction as far as it varies."""
        # Of u between 0.5 and 1: its variance where its sign is known, else its mean square.
        unknown = 1.0 / 48.0 if self.directed else 7.0 / 12.0
        variance = unknown * self.friction**2 + (NOISE * self.arm.effort_limit) ** 2
        return np.sqrt(variance)[: self.posed]


def of_plant(name: str, link: str, com: tuple[float, float, float]) -> tuple[Arm, Weight]:
    """Return an arm of the package and the weight of its plant's links, by Pinocchio."""
    plant = PlantFile.load(name)
    arm, values = plant.model.arm, plant.model.parameters()
    links = dict(plant.links)
    if carried := values.get("payload.mass"):  # the endoscope
        centre = np.array(values["payload.first_moment"]) / carried
        body = arm.body(str(values["payload.link"]))
        endoscope = pin.Inertia(carried, body.frame.actInv(centre), np.zeros((3, 3)))
        links[body.name] = links[body.name] + endoscope

    def weight(q: Array, load: float) -> Array:
        point = pin.Inertia(load, np.array(com), np.zeros((3, 3)))
        tree = build_tree(arm, {**links, link: links[link] + point}, arm.gravity)
        return np.array([tree.gravity(row) for row in q])

    return arm, weight


def ecm() -> Posed:
    """An ECM without its roll, approached from unknown directions."""
    arm, weight = of_plant("ecm", "link3", (0.05, 0.02, -0.1))
    return Posed(arm, 3, weight, np.array([0.6, 0.6, 3.0, 0.02]), False, 0.8, "insertion")


def psm() -> Posed:
    """A PSM without its instrument's joints, each pose approached in a known direction."""
    arm, weight = of_plant("psm", "link3", (0.02, 0.02, 0.1))
    friction = np.array([0.1, 0.22, 0.7, 0.0, 0.0, 0.0, 0.0])
    return Posed(arm, 3, weight, friction, True, 0.2, "insertion")


def ur5() -> Posed:
    """A UR5 whose last two joints stay where they are, approached from unknown directions."""
    arm = mujoco_arms.arm_of("ur5")
    engine = mujoco_arms.urdf(arm, [1.0] * arm.n)

    def weight(q: Array, load: float) -> Array:
        still = np.zeros_like(q)
        bare = engine.torque(q, still, still)
        if not load:
            return bare
        return bare + engine.added((q, still, still), 3, load, (0.0, 0.1, 0.1))

    return Posed(arm, 4, weight, 0.02 * arm.effort_limit, False, 2.0, "wrist_1_joint")


POSED: Mapping[str, Callable[[], Posed]] = {"ecm": ecm, "psm": psm, "ur5": ur5}
