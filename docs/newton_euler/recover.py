"""Recover by least squares what the document lost with its pictures, and print the residuals.

    python docs/newton_euler/recover.py

For every exercise with printed reactions: the unknowns start from random values,
the printed components are fitted, and the result stands beside the value that the
file under config/exercises uses. The standard deviations are what the rounding to
two decimals leaves open; an unknown that no printed number depends on is not determined.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from printed import EXERCISES, HALF_DECIMAL, REACTIONS, reactions
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from dvrk_gravity.newton_euler import (
    JointMotion,
    JointType,
    LinkJoint,
    Mechanism,
    inverse_dynamics,
    read,
    rotation_matrix,
)

ROUNDING = 0.01 / np.sqrt(12)  # standard deviation of a rounded second decimal
DEGREE = np.pi / 180


@dataclass(frozen=True)
class Problem:
    """One recovery.

    Attributes:
        title: Exercises whose printed numbers are fitted.
        names: Unknowns with their units.
        start: Random start from a generator.
        loads: Computed minus printed components, N and N·m, of the unknowns.
        file: The unknowns as the exercise file has them; NaN where it only represents.
        canonical: One way of writing unknowns that mean the same mechanism.
        starts: How many random starts.
    """

    title: str
    names: Sequence[str]
    start: Callable[[np.random.Generator], np.ndarray]
    loads: Callable[[np.ndarray], np.ndarray]
    file: np.ndarray
    canonical: Callable[[np.ndarray], np.ndarray] = lambda x: x
    starts: int = 40


def main() -> int:
    """Print every recovery, then the files' own residuals; 1 if a file misses a decimal."""
    for problem in (planar("2_1_without_gravity"), planar("2_2_with_gravity"), sliding(0.0)):
        report(problem)
    print("3.2 once more, Ixx of link 2 raised from 0 to 0.3:")
    print(f"  q2 = {solve(sliding(0.3))[0][1]:.4f} m: a round q2 needs Ixx = 0\n")
    printed_inertia, possible = spatial(0.8), spatial(0.4)
    report(printed_inertia)
    cost = max_residual(possible, solve(possible)[0])
    print("4.1 once more, Izz of links 1 and 2 lowered to 0.4, the most that a body can have:")
    print(f"  largest residual {cost:.4f}: the printed numbers need the impossible Izz\n")
    return report_files()


def solve(problem: Problem) -> list[np.ndarray]:
    """Return the distinct best solutions of a problem, best first, from all random starts."""
    generator = np.random.default_rng(1)
    found = [
        least_squares(problem.loads, problem.start(generator), method="lm", max_nfev=3000)
        for _ in range(problem.starts)
    ]
    found.sort(key=lambda fit: fit.cost)
    limit = 1.01 * found[0].cost + 1e-9
    return [problem.canonical(fit.x) for fit in found if fit.cost < limit]


def max_residual(problem: Problem, unknowns: np.ndarray) -> float:
    """Return the largest difference to a printed number."""
    return float(np.max(np.abs(problem.loads(unknowns))))


def report(problem: Problem) -> None:
    """Print one recovery: values, standard deviations, the file's values, residuals."""
    solutions = solve(problem)
    known = np.nan_to_num(problem.file)
    # Of equally good solutions the one nearest to the file is shown; all are counted.
    best = min(solutions, key=lambda x: float(np.nansum(wrapped(problem, x - problem.file) ** 2)))
    deviation, determined = uncertainty(problem, best)
    print(f"{problem.title}: {len(problem.loads(best))} printed components")
    print(f"  {'unknown':<22}{'fitted':>12}{'std. dev.':>12}{'in the file':>12}")
    shown = wrapped(problem, best - known) + known
    for k, name in enumerate(problem.names):
        scale = 1 / DEGREE if "deg" in name else 1.0
        file = "" if np.isnan(problem.file[k]) else f"{problem.file[k] * scale:.4f}"
        if determined[k]:
            values = f"{shown[k] * scale:12.4f}{deviation[k] * scale:12.4f}"
        else:
            values = f"{'not determined':>24}"
        print(f"  {name:<22}{values}{file:>12}")
    print(
        f"  largest residual {max_residual(problem, best):.4f}; equally good ends: "
        f"{len(solutions)} of {problem.starts} starts, {distinct(problem, solutions, determined)} "
        "distinct\n"
    )


def wrapped(problem: Problem, difference: np.ndarray) -> np.ndarray:
    """Return a difference of unknowns with its angles brought to -180 … 180 deg."""
    angles = np.array(["deg" in name for name in problem.names])
    return np.where(angles, (difference + np.pi) % (2 * np.pi) - np.pi, difference)


def uncertainty(problem: Problem, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return each unknown's standard deviation, and whether the printed numbers determine it."""
    step = 1e-6
    columns = [
        (problem.loads(x + step * unit) - problem.loads(x - step * unit)) / (2 * step)
        for unit in np.eye(len(x))
    ]
    jacobian = np.array(columns).T
    _, singular, directions = np.linalg.svd(jacobian, full_matrices=False)
    free = singular < 1e-4 * singular[0]  # directions that no printed number depends on
    variance = (ROUNDING / singular[~free]) ** 2 @ directions[~free] ** 2
    return np.sqrt(variance), np.all(np.abs(directions[free]) < 0.1, axis=0)


def distinct(problem: Problem, solutions: list[np.ndarray], determined: np.ndarray) -> int:
    """Return how many solutions differ by more than 0.05 rad or m in what is determined."""
    kept: list[np.ndarray] = []
    for x in solutions:
        if all(np.max(np.abs(wrapped(problem, x - y)[determined])) > 0.05 for y in kept):
            kept.append(x)
    return len(kept)


@cache
def exercise(name: str) -> tuple[Mechanism, JointMotion]:
    """Return what the exercise's file holds."""
    return read(EXERCISES / f"{name}.yaml")


def constraint_loads(name: str, mechanism: Mechanism, q: np.ndarray) -> np.ndarray:
    """Return computed minus printed constraint components of one exercise, flat."""
    _, motion = exercise(name)  # for the printed qd and qdd only
    found = inverse_dynamics(mechanism, q, motion.qd, motion.qdd).reactions
    constrained = np.ones(found.shape, dtype=bool)
    for i, joint in enumerate(mechanism.joints):
        constrained[i, 2 if joint.type is JointType.PRISMATIC else 5] = False
    return (found - reactions(name))[constrained]


def shortest(turn: np.ndarray) -> np.ndarray:
    """Return the rotation vector of the same rotation that is at most half a turn long."""
    return Rotation.from_rotvec(turn).as_rotvec()


def first_frame(about_x: float, then_about_y: float) -> np.ndarray:
    """Return the turn of frame 1 at q1 = 0, about x and then about its own y."""
    return rotation_matrix([about_x, 0, 0]) @ rotation_matrix([0, then_about_y, 0])


def planar(name: str) -> Problem:
    """Return exercise 2.1 or 2.2: two revolute joints, both angles unknown."""
    mechanism, motion = exercise(name)
    file = motion.q.copy()
    if not np.any(mechanism.gravity):
        file[0] = np.nan
    return Problem(
        title=name,
        names=("q1 [deg]", "q2 [deg]"),
        start=lambda generator: generator.uniform(-np.pi, np.pi, 2),
        loads=lambda q: constraint_loads(name, mechanism, q),
        file=file,
    )


def sliding(ixx: float) -> Problem:
    """Return exercise 3.2: q1, q2 and the frame of the prismatic joint unknown.

    Args:
        ixx: Ixx of link 2, kg·m².
    """
    name = "3_2_with_gravity"
    mechanism, motion = exercise(name)
    slider = replace(mechanism.links[1], inertia=np.diag([ixx, 0.3, 0.3]))
    mechanism = replace(mechanism, links=(mechanism.links[0], slider))
    first, second = mechanism.joints

    def loads(x: np.ndarray) -> np.ndarray:
        rotation = Rotation.from_rotvec(x[2:]).as_matrix()
        chain = replace(mechanism, joints=(first, LinkJoint(second.type, rotation)))
        return constraint_loads(name, chain, x[:2])

    def start(generator: np.random.Generator) -> np.ndarray:
        return np.array(
            [
                generator.uniform(-np.pi, np.pi),
                generator.uniform(-1, 1),
                *Rotation.random(random_state=generator).as_rotvec(),
            ]
        )

    turn = Rotation.from_matrix(second.rotation).as_rotvec()
    return Problem(
        title=name,
        names=("q1 [deg]", "q2 [m]", *(f"turn of frame 2 {a} [deg]" for a in "xyz")),
        start=start,
        loads=loads,
        file=np.concatenate([motion.q, turn]),
        canonical=lambda x: np.concatenate([x[:2], shortest(x[2:])]),
    )


def spatial(izz: float) -> Problem:
    """Return exercise 4.1, both poses at once: frames, angles and centres of mass unknown.

    Args:
        izz: Izz of links 1 and 2, kg·m².
    """
    names = ("4_1_without_gravity", "4_1_with_gravity")
    chains = [exercise(name) for name in names]
    links = list(chains[0][0].links)
    links[:2] = [replace(link, inertia=np.diag([0.2, 0.2, izz])) for link in links[:2]]

    def loads(x: np.ndarray) -> np.ndarray:
        moved = tuple(
            replace(link, com=com) for link, com in zip(links, x[9:].reshape(3, 3), strict=True)
        )
        turns = [first_frame(x[0], x[1])]
        turns += [Rotation.from_rotvec(x[k : k + 3]).as_matrix() for k in (3, 6)]
        joints = tuple(LinkJoint(JointType.REVOLUTE, turn) for turn in turns)
        parts = []
        for name, (mechanism, _) in zip(names, chains, strict=True):
            chain = replace(mechanism, links=moved, joints=joints)
            parts.append(constraint_loads(name, chain, np.array([x[2], 0.0, 0.0])))
        return np.concatenate(parts)

    def canonical(x: np.ndarray) -> np.ndarray:
        # Only the vertical's direction in frame 1 acts: two angles and q1 = 0 give it.
        up = (first_frame(x[0], x[1]) @ rotation_matrix([0, 0, x[2]])).T @ [0, 1, 0]
        tilt = [-np.arccos(np.clip(up[1], -1, 1)), np.arctan2(-up[0], up[2]), 0.0]
        return np.concatenate([tilt, shortest(x[3:6]), shortest(x[6:9]), x[9:]])

    def start(generator: np.random.Generator) -> np.ndarray:
        turns = Rotation.random(2, random_state=generator).as_rotvec().ravel()
        angles = generator.uniform(-np.pi, np.pi, 3)
        return np.concatenate([angles, turns, generator.uniform(-0.5, 0.5, 9)])

    mechanism, motion = chains[0]
    turned = [
        joint.rotation @ rotation_matrix([0, 0, q])
        for joint, q in zip(mechanism.joints[1:], motion.q[1:], strict=True)
    ]
    frames = Rotation.from_matrix(np.array(turned)).as_rotvec().ravel()
    coms = np.concatenate([link.com for link in mechanism.links])
    return Problem(
        title="4_1_without_gravity and 4_1_with_gravity together",
        names=(
            "frame 1 about x [deg]",
            "then about its y [deg]",
            "q1 [deg]",
            *(f"turn of frame {i} {a} [deg]" for i in (2, 3) for a in "xyz"),
            *(f"centre {i} {a} [m]" for i in (1, 2, 3) for a in "xyz"),
        ),
        start=start,
        loads=loads,
        file=np.concatenate([[-np.pi / 2, 0, np.nan], frames, coms]),
        canonical=canonical,
        starts=8,
    )


def report_files() -> int:
    """Print the largest residual of every file with printed reactions; 1 if one is too large.

    The second column has every angle rounded to four decimals of a radian, as the
    document's surviving fragment of a configuration (0.1745) shows them.
    """
    status = 0
    print("the files as they are: largest residual of all printed components")
    print(f"  {'':<22}{'exact degrees':>15}{'4 decimals':>12}")
    for name in REACTIONS:
        mechanism, motion = exercise(name)
        rounded = replace(
            mechanism,
            joints=tuple(
                LinkJoint(joint.type, rotation_matrix(np.round(angles(joint), 4)))
                for joint in mechanism.joints
            ),
        )
        worst = [
            float(np.max(np.abs(constraint_loads(name, chain, q))))
            for chain, q in ((mechanism, motion.q), (rounded, np.round(motion.q, 4)))
        ]
        status |= int(worst[0] > HALF_DECIMAL)
        print(f"  {name:<22}{worst[0]:15.4f}{worst[1]:12.4f}")
    return status


def angles(joint: LinkJoint) -> np.ndarray:
    """Return a joint's angles about x, y and z, rad."""
    if abs(joint.rotation[2, 0]) > 1 - 1e-9:  # y at 90 deg: x and z turn about one axis
        return np.array([0.0, np.pi / 2, 0.0])
    return Rotation.from_matrix(joint.rotation).as_euler("xyz")


if __name__ == "__main__":
    sys.exit(main())
