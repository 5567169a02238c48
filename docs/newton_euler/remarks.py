"""The document's remarks on its results, each checked against our own numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from printed import EXERCISES, HALF_DECIMAL, reactions

from dvrk_gravity.newton_euler import JointMotion, Mechanism, inverse_dynamics, read


class Remark(NamedTuple):
    """One statement of the document, what we find, and whether it holds."""

    exercise: str
    statement: str
    ours: str
    holds: bool


def exercise(name: str) -> tuple[Mechanism, JointMotion]:
    """Return what an exercise's file holds."""
    return read(EXERCISES / f"{name}.yaml")


def torque(name: str, **changes: np.ndarray) -> np.ndarray:
    """Return the actuation of an exercise, (n,), with q, qd or qdd changed if given."""
    mechanism, motion = exercise(name)
    motion = replace(motion, **changes)
    return inverse_dynamics(mechanism, motion.q, motion.qd, motion.qdd).tau


def shown(tau: np.ndarray) -> str:
    """Return actuations with two decimals."""
    return "tau = (" + ", ".join(f"{value:z.2f}" for value in tau) + ")"


def remarks() -> Iterator[Remark]:
    """Yield every remark in the document's order."""
    yield from _planar()
    yield from _sliding()
    yield from _spatial()
    yield from _general()


def _planar() -> Iterator[Remark]:
    dry, wet = torque("2_1_without_gravity"), torque("2_1_with_gravity")
    yield Remark("2.1 without", "both torques positive", shown(dry), bool(np.all(dry > 0)))
    degrees = np.arange(-180, 180)
    second = exercise("2_1_with_gravity")[1].q[1]
    at = [torque("2_1_with_gravity", q=np.array([a, second])) for a in np.radians(degrees)]
    range_ = degrees[[bool(np.all(tau > dry)) for tau in at]]
    yield Remark(
        "2.1 with",
        "a distinct increment of both torques, which stay positive",
        f"{shown(wet)} at the representative q1 = 20 deg; both grow for q1 from "
        f"{range_[0]} to {range_[-1]} deg",
        bool(np.all(wet > dry)),
    )
    dry, wet = torque("2_2_without_gravity"), torque("2_2_with_gravity")
    yield Remark(
        "2.2 without",
        "first torque negative, second positive",
        shown(dry),
        bool(dry[0] < 0 < dry[1]),
    )
    yield Remark(
        "2.2 without",
        "the first is the bigger in absolute value",
        shown(dry),
        bool(abs(dry[0]) > abs(dry[1])),
    )
    yield Remark("2.2 with", "both torques negative", shown(wet), bool(np.all(wet < 0)))
    yield Remark(
        "2.2 with",
        "gravity's effect is bigger than that of the motion",
        f"by gravity {shown(wet - dry)}",
        bool(np.all(np.abs(wet - dry) > np.abs(dry))),
    )


def _sliding() -> Iterator[Remark]:
    dry, wet = torque("3_1_without_gravity"), torque("3_1_with_gravity")
    yield Remark("3.1 without", "torque and force positive", shown(dry), bool(np.all(dry > 0)))
    yield Remark(
        "3.1 without",
        "the force is very little",
        f"{dry[1]:.4f} N at the representative q2 = 0.2 m",
        bool(abs(dry[1]) < 0.1),
    )
    yield Remark("3.1 with", "torque and force bigger", shown(wet), bool(np.all(wet > dry)))
    dry, wet = torque("3_2_without_gravity"), torque("3_2_with_gravity")
    yield Remark("3.2 without", "torque and force negative", shown(dry), bool(np.all(dry < 0)))
    yield Remark("3.2 with", "the force is positive", shown(wet), bool(wet[1] > 0))
    yield Remark(
        "3.2 with",
        "gravity's effect on the first link is limited, its arm being small",
        f"tau 1 goes from {dry[0]:.2f} to {wet[0]:.2f} N·m",
        bool(abs(wet[0]) < 10 * abs(dry[0])),
    )
    mechanism, motion = exercise("3_2_with_gravity")
    first, second = mechanism.links
    along = replace(second, com=np.array([0.0, 0.0, second.com[0]]))
    planar = inverse_dynamics(
        replace(mechanism, links=(first, along)), motion.q, motion.qd, motion.qdd
    ).reactions
    printed = reactions("3_2_with_gravity")
    yield Remark(
        "3.2 with",
        f"the mechanism is planar, yet vr 1 has Mx = {printed[0, 3]} and My = {printed[0, 4]}",
        "(0.4, 0, 0) in frame 2 is 0.4 m out of the plane; with the centre along the slide "
        f"vr 1 has Mx = {planar[0, 3]:z.2f}, My = {planar[0, 4]:z.2f}",
        bool(np.max(np.abs(planar[0, 3:5] - printed[0, 3:5])) < HALF_DECIMAL),
    )
    loads = inverse_dynamics(mechanism, motion.q, motion.qd, motion.qdd).wrenches[1]
    about_p = loads[3:] - np.cross([0.0, 0.0, motion.q[1]], loads[:3])
    yield Remark(
        "3.2 with",
        "section 1.2: moments act at P_i",
        f"Mx of vr 2 is {loads[3]:.2f} about Q_1 and {about_p[0]:z.2f} about P_2; "
        f"{printed[1, 3]:.2f} is printed",
        bool(abs(about_p[0] - printed[1, 3]) < HALF_DECIMAL),
    )


def _spatial() -> Iterator[Remark]:
    dry, wet = torque("4_1_without_gravity"), torque("4_1_with_gravity")
    yield Remark("4.1 without", "torques positive", shown(dry), bool(np.all(dry > 0)))
    yield Remark(
        "4.1 with",
        "the first torque remains the same",
        f"{dry[0]:.2f} without, {wet[0]:.2f} with gravity",
        bool(abs(wet[0] - dry[0]) < 1e-9),
    )
    yield Remark(
        "4.1 with",
        "the last two torques also carry the weight",
        f"{dry[1]:.2f} to {wet[1]:.2f} and {dry[2]:.2f} to {wet[2]:.2f} N·m",
        bool(np.all(wet[1:] > dry[1:])),
    )
    mechanism, motion = exercise("4_1_without_gravity")
    wrenches = inverse_dynamics(mechanism, motion.q, motion.qd, motion.qdd).wrenches
    cosine, sine = np.cos(motion.q[2]), np.sin(motion.q[2])
    turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    inertial = wrenches[1, :3] - turn @ wrenches[2, :3]
    without = wrenches[1, 3:] - np.cross(mechanism.links[1].com, inertial)
    printed = reactions("4_1_without_gravity")[1, 4]
    yield Remark(
        "4.1 without",
        "section 1.2: the moment of link n-1 as written, without r × m dv/dt of its centre",
        f"My of vr 2 would be {without[1]:.2f}; with it {wrenches[1, 4]:.2f}; "
        f"{printed:.2f} is printed",
        bool(abs(without[1] - printed) < HALF_DECIMAL),
    )


def _general() -> Iterator[Remark]:
    dry, wet = torque("2_2_without_gravity"), torque("2_2_with_gravity")
    slow, drawn = torque("3_2_without_gravity"), torque("3_2_with_gravity")
    yield Remark(
        "conclusions",
        "gravity can change an actuation's sign",
        f"second one of 2.2: {dry[1]:.2f} to {wet[1]:.2f} N·m; of 3.2: "
        f"{slow[1]:.2f} to {drawn[1]:.2f} N",
        bool(dry[1] * wet[1] < 0 and slow[1] * drawn[1] < 0),
    )
    _, motion = exercise("2_2_without_gravity")
    still = np.zeros(2)
    faster = torque("2_2_without_gravity", qd=2 * motion.qd, qdd=still)
    faster /= torque("2_2_without_gravity", qdd=still)
    harder = torque("2_2_without_gravity", qd=still, qdd=2 * motion.qdd)
    harder /= torque("2_2_without_gravity", qd=still)
    yield Remark(
        "conclusions",
        "dynamic loads are proportional to velocities and accelerations",
        f"2.2, twice the accelerations: torques × {harder[0]:.2f}, {harder[1]:.2f}; twice "
        f"the velocities: × {faster[0]:.2f}, {faster[1]:.2f} (quadratic)",
        bool(np.allclose(faster, 2) and np.allclose(harder, 2)),
    )
